"""Write the files of one light after another: meshes, splats, textures, a picture. Shared parts are made once."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.beside import Beside
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..engine.relighter import Shaded
from ..insert.inserts import InsertedLight, ShadowedSplats
from ..light.environment import Environment
from ..light.loading import light_of
from ..light.skies import BUILTIN
from ..output import mesh_files
from ..output.images import write_png
from ..output.inserted_glb import inserted_glb
from ..output.inserted_picture import PictureAsked, camera_of, with_objects
from ..output.joined_splats import append_splats
from ..output.kinds import FILES, OUTPUTS, PICTURE_SIZE, SHEET
from ..output.lamps_glb import PlacedLamps
from ..output.offered_lights import offered_pictures
from ..output.picture import RelitPicture
from ..output.sheet import sheet
from ..request import AnyLight
from .job import Job
from .live_files import LiveFiles
from .part_lights import PartLights
from .relit_source import RelitSource
from .scene_files import EngineFiles, LitFolder, write_around, write_clean, write_pass_files
from .textures import SceneTextures

BEFORE = "captured", "albedo"
"""Labels of the pictures before the lights on the sheet."""

INSERTED = "inserted.glb", "inserted.png"
"""Files of inserted objects, and of a picture of them in the scene."""

FileWriter = Callable[[LitFolder], list[str]]
"""Writes files of their own into the folder of a light, and returns their names."""


class Results:
    """Writes the results of a scene, light after light. job: of the first light. lights: those that a page holds beside
    the built-in ones. relit: the splats, in any light. shown: function of a light: as the mesh shows it, with parts."""

    def __init__(self, job: Job, lights: Sequence[AnyLight] = ()) -> None:
        self._job, self._known, self._scene, self._stages = job, job.known, job.known.scene, job.stages
        parts, self._splats = PartLights(job), job.inputs.shown_splats
        self.shown, self.relit, self._part = parts.shown, RelitSource(job, parts), parts.new
        # What is written as a splat is shown too.
        self._kinds = {*job.inputs.formats, *(["png"] if "splat" in job.inputs.formats else [])}
        self._shows_relit = self._splats is not None and any(OUTPUTS[kind].relit for kind in self._kinds)
        self._textures = SceneTextures(job, parts, self.relit)
        makers: dict[str, Callable[[], FileWriter]] = {
            "engines": lambda: EngineFiles(job).write,
            "around": lambda: partial(write_around, job, self.relit),
            "passes": lambda: partial(write_pass_files, job),
            "clean": lambda: partial(write_clean, job),
            "live": lambda: LiveFiles(job, self.relit, [light_of(each) for each in (*lights, *BUILTIN)]).write,
        }
        asked = {OUTPUTS[kind].writer for kind in self._kinds} | ({"engines"} if job.request.live_mesh else set())
        self._others: list[FileWriter] = [self._textures.write] if job.request.baked else []
        self._others += [make() for name, make in makers.items() if name in asked]
        self._last_picture: NDArray[np.uint8] | None = None
        self._on_sheet: list[tuple[str, NDArray[np.uint8]]] = []

    def write(self, folder: Path, shaded: Shaded) -> tuple[list[str], dict[str, Any]]:
        """Fill an existing folder: (names of the files, further entries of the report)."""
        names = [each.file for kind, each in OUTPUTS.items() if kind in self._kinds and not each.writer]
        facts: dict[str, Any] = {}
        with ExitStack() as begun:
            glb = splats = None
            mesh, exposure = self.shown(shaded), shaded.exposure
            if "glb" in self._kinds:
                facts["clipped_vertices"] = 0
                placed, _ = self._job.lamps_shown(mesh.light, exposure), self._textures.shows_vertices  # read before
                glb = begun.enter_context(Beside(partial(self._write_glb, folder / FILES["glb"], mesh, placed)))
            with self._stages.stage("write"):
                if "ply" in self._kinds:
                    mesh_files.write_ply(folder / FILES["ply"], self._scene, mesh.shading.radiance, exposure)
                if "npy" in self._kinds:
                    mesh_files.write_npy(folder / FILES["npy"], self._scene, mesh.shading.radiance)
            into = LitFolder(folder, shaded, self.relit.relit(shaded) if self._shows_relit else None, facts)
            if "splat" in self._kinds and into.relit is not None:
                splats = begun.enter_context(Beside(partial(self.relit.write, folder, into.relit)))
                if shaded.inserted is not None:
                    splats.result()  # objects are added to it
            others = [] if shaded.inserted is None else self._write_inserted(into)
            others += [name for write in self._others for name in write(into)]
            if "png" in self._kinds:
                self._write_preview(into)
            if glb is not None:
                facts["clipped_vertices"] = glb.result()
            return names + ([] if splats is None else splats.result()) + others, facts

    def _write_glb(self, path: Path, shaded: Shaded, placed: PlacedLamps) -> int:
        """Write relit.glb, in its texture where the scene has one; returns the number of vertices that are clipped."""
        radiance, exposure = shaded.shading.radiance, shaded.exposure
        extras: dict[str, Any] = {"environment": shaded.light.name, "angle_deg": shaded.light.rotation_deg}
        with self._stages.stage("write"):
            if self._textures.shows_vertices:
                return mesh_files.write_glb(path, self._scene, radiance, exposure, extras, placed)
            exposed = mesh_files.check_radiance(self._scene, radiance) * exposure
            clipped = int((exposed > 1.0).any(axis=1).sum())
            self._textures.write_relit(path, shaded, {"clipped_vertices": clipped, **extras}, placed)
            return clipped

    def _write_preview(self, into: LitFolder) -> None:
        with self._stages.stage("preview"):
            self._last_picture = self.painted(into.relit, into.shaded)
            write_png(into.path / FILES["png"], self._last_picture)
        shown = "splat" if into.relit is not None else "texture" if self._shows_texture else "mesh"
        into.facts["preview"] = {"shows": shown, "camera": self._picture.camera}

    @property
    def _shows_texture(self) -> bool:
        """Whether pictures of the mesh show the texture of --bake."""
        return bool(self._job.request.baked) and self._textures.is_whole

    def _write_inserted(self, into: LitFolder) -> list[str]:
        """Write the lit inserted objects, and a picture of them in the scene: names of the files."""
        shaded, relit, names = into.shaded, into.relit, []
        with self._stages.stage("write"):
            content = inserted_glb(shaded.inserted, shaded.exposure)
            if content:
                names.append(INSERTED[0])
                with staged_file(into.path / INSERTED[0]) as staging:
                    staging.write_bytes(content)
            if "splat" in self._kinds and relit is not None:
                splats = shaded.inserted.splats_put_in(shaded.exposure)
                if splats is not None:
                    append_splats(into.path / FILES["splat"], splats, relit.facts)
        if relit is None:
            return names
        with self._stages.stage("preview"):
            picture = self._new_picture(camera_of(shaded.inserted, self._scene))
            write_png(into.path / INSERTED[1], self._of_splats(picture, relit, shaded))
        return [*names, INSERTED[1]]

    def object_painter(
        self, shaded: Shaded, poses: list[InsertedLight]
    ) -> Callable[[InsertedLight], NDArray[np.uint8]]:
        """The function that draws moving objects under a light: splats if there are any, else the mesh.

        shaded: with the objects in any pose. poses: some of those to come."""
        points = np.concatenate([pose.standing.vertices for pose in poses])
        camera = camera_of(poses[len(poses) // 2], self._scene, points)
        if self._splats is None:
            return lambda pose: self._mesh_with(pose, shaded, camera)
        bound, picture = ShadowedSplats(poses, self.relit.without_objects(shaded)), self._new_picture(camera)
        return lambda pose: self._of_splats(picture, bound.under(pose), shaded._replace(inserted=pose))

    def _mesh_with(self, pose: InsertedLight, shaded: Shaded, camera: dict[str, Any]) -> NDArray[np.uint8]:
        """A picture of the mesh with objects, and what these change of its light. shaded: with them in any pose."""
        standing, drawn = pose.standing, Drawn(self._scene)
        colors = np.zeros(standing.vertices.shape, np.uint8)
        objects = Mesh(standing.vertices, standing.normals, standing.faces, colors)
        radiance = shaded.shading.radiance / shaded.inserted.ratio
        both = np.concatenate([drawn.colors(radiance * pose.ratio), pose.radiance])
        frame, capture = self._scene.scene_from_splat, self._scene.capture
        shown = Scene([*drawn.scene.chunks, objects], scene_from_splat=frame, capture=capture)
        picture = RelitPicture(shown, camera, PICTURE_SIZE)
        return np.asarray(picture.of_vertices(both, shaded.sky, shaded.exposure, inset=False), np.uint8)

    def _of_splats(self, picture: Any, relit: Splats, shaded: Shaded) -> NDArray[np.uint8]:
        """A picture of relit splats with the inserted objects."""
        light = self._behind(shaded)
        if shaded.inserted is not None:
            relit = with_objects(relit, shaded.inserted, PictureAsked(self._scene, picture.view, shaded.exposure))
        return picture.of_splats(relit, light, shaded.exposure * shaded.backdrop)

    def _new_picture(self, camera: dict[str, Any] | None) -> RelitPicture:
        """A RelitPicture of the scene; without a camera, by its own."""
        return RelitPicture(self._scene, camera, PICTURE_SIZE, indoors=self._known.appearance.room is not None)

    @cached_property
    def _picture(self) -> RelitPicture:
        return self._new_picture(None)

    def painted(self, relit: Splats | None, shaded: Shaded) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) uint8: of the relit splats, else of the texture, else of the mesh, as there are."""
        light = self._behind(shaded)
        exposure, behind = shaded.exposure, shaded.exposure * shaded.backdrop
        if relit is not None:
            return self._of_splats(self._picture, relit, shaded)
        mesh = self.shown(shaded)
        if self._shows_texture:
            return self._picture.of_texture(self._textures.baked.atlas, self._textures.picture(mesh), light, behind)
        return self._picture.of_vertices(mesh.shading.radiance, light, exposure)

    def _behind(self, shaded: Shaded) -> Environment | None:
        """The light that pictures show behind the scene; None where all but a part keeps the captured light."""
        return shaded.sky if self._part is None or self._part.kept else None

    def add_to_sheet(self, shaded: Shaded) -> None:
        """Keep the picture of a light that was just written, in half its size, for the sheet."""
        with self._stages.stage("sheet"):
            image, self._last_picture = self._last_picture, None
            if image is None:
                image = self.painted(None if self._splats is None else self.relit.relit(shaded), shaded)
            self._on_sheet.append((f"{shaded.light.name} {shaded.light.rotation_deg:g}°", _halved(image)))

    def write_sheet(self, folder: Path, last: int = 0) -> str:
        """Write the sheet of all lights kept, or of the last so many: its name."""
        with self._stages.stage("sheet"):
            write_png(folder / SHEET, sheet([*self._before, *self._on_sheet[-last:]]))
        return SHEET

    @cached_property
    def _before(self) -> list[tuple[str, NDArray[np.uint8]]]:
        """Names and pictures, in half their size, of what was captured and, where it was estimated, of its albedo,
        before plain grey; then of the lights that an estimate offered."""
        look = self._known.appearance
        if self._splats is None:
            found = [(BEFORE[0], self._picture.of_vertices(look.captured, None, 1.0))]
        else:
            found = [(BEFORE[0], self._picture.of_splats(self._splats, None, 1.0))]
        if look.prior is not None and not look.as_captured and look.albedo is not None:
            found.append((BEFORE[1], self._albedo_picture(look.albedo, look.irradiance)))
            found += offered_pictures(self._known.relighter, look, self._albedo_picture)
        return [(name, _halved(each)) for name, each in found]

    def _albedo_picture(self, albedo: Any, irradiance: NDArray[np.float32]) -> NDArray[np.uint8]:
        """The picture of an albedo (V, 3), and of splats without a light (V, 3) that they were captured in."""
        if self._splats is None:
            return np.asarray(self._picture.of_vertices(albedo, None, 1.0))
        white = np.ones_like(irradiance)
        return np.asarray(self._picture.of_splats(self._known.binding.relit(irradiance, white), None, 1.0))


def _halved(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture in half its size."""
    height, width = image.shape[0] // 2, image.shape[1] // 2
    blocks = image[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3).astype(np.float32)
    return np.asarray(np.rint(blocks.mean(axis=(1, 3))), np.uint8)
