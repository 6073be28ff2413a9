"""The library in one line: a scene or a splat under a new light, and the albedo of a scene.

relight_splat("a.ply", "sunset", angle_deg=45).save("b.ply")
"""

import os
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.api import convert
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import check_output
from splat2mesh.base.progress import Stages
from splat2mesh.base.version import __version__ as __version__
from splat2mesh.capture import capture_of
from splat2mesh.options import ConvertOptions
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.folder import META
from splat2mesh.scene.foreign import AnyScene
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import WRITERS, write_splats
from splat2mesh.splats.splats import Splats

from .engine.appearance import Appearance, appearance_of
from .engine.light_mix import LightKind
from .engine.relighter import Relighter, Shaded
from .jobs.first_look import first_picture
from .jobs.folders import first_light, meshed_request, planned_request, splat_to_mesh
from .jobs.job import Job
from .jobs.session import check_session, session_of
from .jobs.writer import Writer, report_of
from .light.environment import Environment
from .light.loading import light_of
from .light.tonemap import tone_map
from .options import LightingOptions
from .output.lamps_picture import lamps_picture
from .planning.plan import Plan
from .request import AUTO, AnyLight, RelightRequest
from .splats import write_relit_ply
from .viewer.waiting import Served, first_look

if TYPE_CHECKING:
    import pyvista

    from .gloss.gloss_plan import GlossPlan
    from .planning.lamp_plan import RayPlan
    from .viewer.request import SessionRequest


@dataclass(frozen=True, eq=False)
class RelitScene:
    """A scene in a new light.

    scene: the Scene. radiance: (V, 3) float32, linear radiance that leaves its vertices. exposure: display value per
    unit of radiance. light: the rotated Environment. report: what was done and how, JSON-clean.
    """

    scene: Scene
    radiance: NDArray[np.float32]
    exposure: float
    light: Environment
    report: dict[str, Any]
    _writer: Writer
    _shaded: Shaded

    @cached_property
    def colors_srgb(self) -> NDArray[np.uint8]:
        """(V, 3) as shown: exposed, highlights compressed, sRGB."""
        return self._bytes(self.radiance)

    def _bytes(self, radiance: NDArray[np.float32]) -> NDArray[np.uint8]:
        return np.round(tone_map(radiance * np.float32(self.exposure)) * 255.0).astype(np.uint8)

    def save(self, folder: str | os.PathLike[str], overwrite: bool = False) -> dict[str, Any]:
        """Write the files of `formats`, and report.json: the report with files and times.

        A folder with results of the same settings is completed. Raises InputError for a folder with anything else,
        except for results with `overwrite`.
        """
        return self._writer.write(self._shaded, folder, overwrite)

    def to_pyvista(self) -> "pyvista.PolyData":
        """The mesh for PyVista, with "radiance" (V, 3) linear and "rgb" (V, 3) uint8 at its points, and its normals.

        `relit.to_pyvista().plot(scalars="rgb", rgb=True, lighting=False)` shows it.
        """
        import pyvista  # which takes a second

        drawn = Drawn(self.scene)
        shown = drawn.scene
        faces = np.empty((len(shown.faces), 4), np.int64)
        faces[:, 0], faces[:, 1:] = 3, shown.faces
        mesh = pyvista.PolyData(np.array(shown.vertices), faces.ravel())
        mesh.point_data["Normals"] = np.array(shown.normals)
        mesh.point_data["radiance"] = drawn.colors(self.radiance)
        mesh.point_data["rgb"] = self._bytes(mesh.point_data["radiance"])
        return mesh


@dataclass(frozen=True, eq=False)
class RelitSplat:
    """A splat in a new light.

    splats: Splats, row by row those of the source, in its frame; only their colours differ. mesh: the RelitScene that
    lights them. report: what was done and how, JSON-clean.
    """

    splats: Splats
    mesh: RelitScene
    report: dict[str, Any]
    _sources: list[Path]

    def save(self, path: str | os.PathLike[str], overwrite: bool = False) -> None:
        """Write the splats in the format of the name: .ply, .spz, .compressed.ply or .sog.

        From a .ply to a .ply all but the colours stays the same to the bit. Raises InputError for other names, and
        for a file that exists, unless `overwrite`.
        """
        name = Path(path).name.lower()
        kinds = sorted((kind for kind in WRITERS if name.endswith(f".{kind}")), key=len)
        if not kinds:
            endings = " ".join(f".{kind}" for kind in WRITERS)
            raise InputError(f"{path}: not a splat format that can be written; expected a name that ends in {endings}")
        check_output(path, overwrite)
        if kinds[-1] == "ply":
            write_relit_ply(path, self.splats, self._sources[0] if len(self._sources) == 1 else None)
        else:
            write_splats(path, self.splats, kinds[-1])


def relight_scene(
    scene: "AnyScene | RelightRequest",
    env: AnyLight = AUTO,
    options: LightingOptions | str | None = None,
    *,
    angle_deg: float | None = None,
    stages: Stages | None = None,
    **changes: Any,
) -> RelitScene:
    """Light a scene, as the command does. Only `save` writes files.

    Parameters
    ----------
    scene : Scene, path, mesh or RelightRequest
        A Scene; the path of a scene folder or mesh file; a mesh of trimesh or open3d; or a request,
        which contains the rest.
    env : Environment, path or name
        An `.exr` or `.hdr` file, "studio", "overcast", "sunset", "noon", or "captured", the light of the capture.
    options : LightingOptions or str, optional
        LightingOptions or the name of a method.
    angle_deg : float
        Turns the light about the vertical, counter-clockwise from above.
    stages : Stages, optional
        Times the work.
    **changes
        Fields of LightingOptions and RelightRequest, such as tolerance=0.02, albedo="white" or formats=("npy",).

    Raises
    ------
    InputError
        For what cannot be read or used.

    Notes
    -----
    The cache of a scene folder keeps reusable results.
    """
    if angle_deg is not None:
        changes["angles_deg"] = (angle_deg,)
    return _relit(Writer(Job(RelightRequest.of(scene, env, options, **changes), stages)))


def relight_splat(
    splat: Scene | str | os.PathLike[str],
    env: AnyLight = AUTO,
    options: LightingOptions | str | None = None,
    *,
    angle_deg: float = 0.0,
    source: str | os.PathLike[str] | None = None,
    meshing: ConvertOptions | Mapping[str, Any] | None = None,
    stages: Stages | None = None,
    **changes: Any,
) -> RelitSplat:
    """Relight a splat: `relight_splat("a.ply", "sunset", angle_deg=45).save("b.ply")`.

    Parameters
    ----------
    splat : path or Scene
        A splat file of any readable format, or a layout of several: it is meshed first. Or a Scene or scene folder
        that was made from one.
    source : path, optional
        The splat of such a scene. Default: the file that the scene names.
    meshing : ConvertOptions or mapping, optional
        How the splat is meshed, such as {"detail": "draft"}.
    env, options, angle_deg, stages, **changes
        As for `relight_scene`.

    Raises
    ------
    InputError
        For what cannot be read or used.
    """
    stages = stages or Stages()
    wanted = meshing if isinstance(meshing, ConvertOptions) else ConvertOptions(**(meshing or {}))
    scene = _meshed(splat, wanted, stages)
    fixed: dict[str, Any] = {"angles_deg": (angle_deg,), "formats": ("glb", "png", "splat"), "splat": source}
    job = Job(RelightRequest.of(scene, env, options, **{**changes, **fixed}), stages)
    found = job.inputs.splats
    writer = Writer(job)
    relit = _relit(writer)
    return RelitSplat(writer.results.relit.relit(relit._shaded), relit, relit.report, found[1] if found else [])


class RelightPlan(NamedTuple):
    """The result of `plan_relight`.

    plan: the Plan of the environment; None without one, or where the splat is not meshed yet. note: what it leaves
    open, or "". lamps, lamp_bounces: RayPlans of the lamps and of their first bounce, or None. lamp_count: how many.
    lamps_picture: (H, W, 3) uint8, the captured lamps of a closed room with their numbers; None without any. gloss: the
    GlossPlan of the scene; None where nothing is glossy, or before gloss was measured. mirrored_floor: entry of the
    report for a floor that mirrors in the splats, or None.
    """

    plan: Plan | None
    note: str
    lamps: "RayPlan | None" = None
    lamp_count: int = 0
    lamps_picture: NDArray[np.uint8] | None = None
    gloss: "GlossPlan | None" = None
    lamp_bounces: "RayPlan | None" = None
    mirrored_floor: dict[str, Any] | None = None

    def table(self) -> list[str]:
        """Return it as lines of text."""
        lines = [] if self.plan is None else self.plan.table()
        lines += [f"  {self.note}"] * bool(self.note) if lines else [self.note] * bool(self.note)
        lines += [] if self.gloss is None else self.gloss.table()
        if self.mirrored_floor is not None:
            lines.append(f"mirrored floor: {self.mirrored_floor['splats']:,} splats take the light of what it mirrors")
        lines += [] if self.lamps is None else self.lamps.table(self.lamp_count)
        return lines + ([] if self.lamp_bounces is None else self.lamp_bounces.table())


def plan_relight(request: RelightRequest, stages: Stages | None = None) -> RelightPlan:
    """Plan a request without doing its work or writing files.

    Lamps need the light of the capture, which is then estimated. Raises InputError for what cannot be planned: a method
    without settings to choose, a room that no environment changes.
    """
    found = planned_request(request)
    if found is None:
        note = f"{request.scene} is meshed first: splat2mesh {request.scene} --plan shows how. "
        return RelightPlan(None, note + "Light is planned once that is done.")
    planned, at_hand = found
    job = Job(planned.under(first_light(planned)), stages, at_hand)
    lamps, bounces, count, picture = None, None, 0, None
    if job.inputs.asked_lamps and job.mix.lamp_light is not None:
        lamps, bounces, count = job.mix.lamp_light.plan, job.mix.lamp_light.bounce_plan, len(job.inputs.asked_lamps)
    if job.known.scene.capture.get("from") == "inside" and job.room is not None and job.room.lamps_found:
        picture = lamps_picture(job.known.scene, job.known.lamps_found)
    if job.light_kind is LightKind.CAPTURED:
        note = "" if lamps else "the captured light needs no rays, and there is nothing to plan"
        return RelightPlan(None, note, lamps, count, picture, None, bounces, job.known.mirrored_floor)
    plan, note = job.planned()
    if plan is None and job.known.appearance.as_captured and lamps is None:
        raise InputError("what an environment changes in this room is assumed, so there is nothing to plan")
    if plan is None and lamps is None:
        raise InputError(f"`method` {job.inputs.options.method} has nothing to plan; leave it at auto")
    gloss = (
        None
        if note or job.known.gloss is None or not job.known.gloss.known
        else job.known.gloss.plan(job.known.appearance)
    )
    return RelightPlan(plan, note, lamps, count, picture, gloss, bounces, job.known.mirrored_floor)


def view_request(
    request: RelightRequest, *, screenshot: str | os.PathLike[str] | None = None, stages: Stages | None = None
) -> None:
    """Open the session of a request, or write its picture without a window. A splat is meshed first."""
    from .viewer import view

    stages = stages or Stages()
    session = _session(request, stages, None if screenshot else first_look)
    view(session, screenshot=screenshot)


def serve_request(
    request: RelightRequest,
    port: int = 0,
    announce: Callable[[str], None] = lambda url: None,
    stages: Stages | None = None,
) -> None:
    """Show the session of a request in a browser of this machine until it is quit. announce: receives its address."""
    from .viewer import serve

    place = Served.at(port)
    announced: list[str] = []

    def told(url: str) -> None:
        if not announced:
            announced.append(url)
            announce(url)

    session = _session(request, stages or Stages(), lambda picture: first_look(picture, place, told))
    serve(session, port=place, announce=told)


def estimate_albedo(
    scene: "AnyScene | Relighter", capture_env: "AnyLight | None" = None, *, seed: int = 0
) -> Appearance:
    """Remove the captured light from the colours of a scene. Returns an Appearance, whose `albedo` is (V, 3) linear.

    scene: as for `relight_scene`, or a Relighter, whose cache is used and whose rays are kept. capture_env: the light
    of the capture, if known. Where light and colours cannot be separated, the albedo is the captured colour,
    with a DataWarning. Raises InputError for what cannot be read or used.
    """
    relighter = scene if isinstance(scene, Relighter) else Relighter(scene, seed=seed)
    if capture_env is not None and not isinstance(capture_env, Environment):
        capture_env = light_of(capture_env)
    return appearance_of("estimated", capture_env, relighter)


def _relit(writer: Writer) -> RelitScene:
    shaded = next(writer.job.shaded())
    light, shading, exposure = writer.results.shown(shaded)[:3]
    report = report_of(writer.job, shaded)
    return RelitScene(writer.job.known.scene, shading.radiance, exposure, light, report, writer, shaded)


def _session(
    request: RelightRequest,
    stages: Stages,
    shown: Callable[[NDArray[np.uint8]], AbstractContextManager[None]] | None,
) -> "SessionRequest":
    """The session of a request. shown: shows the first look at a splat while it is meshed and lit; None without."""
    check_session(request)
    splat, capture, picture = splat_to_mesh(request), None, None
    if splat is not None and shown is not None:
        capture = capture_of(splat, request.meshing, stages)
        picture = first_picture(request.under(first_light(request)), capture, stages)
    with nullcontext() if picture is None or shown is None else shown(picture):
        request, at_hand, _ = meshed_request(request, stages, capture)
        session = session_of(Job(request.under(first_light(request)), stages, at_hand))
    stages.close()
    return session


def _meshed(splat: Scene | str | os.PathLike[str], options: ConvertOptions, stages: Stages) -> Scene | Path:
    """Return the scene itself where it is one, else that of the splat."""
    if isinstance(splat, Scene):
        return splat
    path = Path(splat)
    return path if (path / META).is_file() else convert(path, options, stages=stages)
