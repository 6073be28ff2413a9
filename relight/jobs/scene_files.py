"""Files of a job beside its relit surfaces: for engines, its surrounding light, render passes, splats without
floaters."""

import warnings
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.splats.formats import can_hold, kind_of, write_splats
from splat2mesh.splats.formats.selected import write_selected
from splat2mesh.splats.splats import Splats

from ..engine.nine import nine_coefficients
from ..engine.relighter import Shaded
from ..insert.probe import ProbedScene
from ..light.loading import CapturedLight
from ..output.catcher_files import write_catcher
from ..output.kinds import FILES, PICTURE_SIZE
from ..output.lamps_glb import ShownLight
from ..output.live_glb import FILE, PLAYCANVAS_FROM_SPLAT, write_live_glb, write_proxy_glb
from ..output.pass_files import write_passes
from ..output.preview import Preview
from ..output.probe_files import write_probes
from ..output.splat_glb import write_splat_glb
from ..splats import albedo_splats, normals_of, shown_as_sky, write_relit_ply
from .job import Job
from .object_surroundings import light_under
from .relit_source import RelitSource

PROXY, COLLISION = "proxy.glb", "albedo_splat.collision.glb"


@dataclass(frozen=True, eq=False)
class LitFolder:
    """A folder that exists, for the results of one light. relit: the splats in it, where a result needs them. facts:
    further entries of the report, to which writers add."""

    path: Path
    shaded: Shaded
    relit: Splats | None = None
    facts: dict[str, Any] = field(default_factory=dict)


def write_around(job: Job, source: RelitSource, into: LitFolder) -> list[str]:
    """Write those of `kinds.AROUND`: probes of the surrounding light, and the changes that objects make to it; returns
    the names of the files."""
    if into.relit is None:
        return []
    names: list[str] = []
    asked, known, kinds, shaded = job.request, job.known, job.inputs.formats, into.shaded
    with job.stages.stage("around"):
        if "probe" in kinds:
            light = light_under(shaded, job.mix)
            probed = ProbedScene(into.relit, known.scene, known.relighter.occluder, light, shaded.exposure)
            names += write_probes(into.path, probed, asked.probe_at, asked.probe_grid)
        if "catcher" in kinds and shaded.inserted is not None:
            looks = source.without_objects(shaded), into.relit
            names += write_catcher(into.path, *looks, known.scene, shaded.inserted, job.inputs.splat_file)
    return names


def write_clean(job: Job, into: LitFolder) -> list[str]:
    """Write the splats without floaters, with their entry in the report; returns the names of the files.

    The rows of a PLY stay as they are to the bit, with all their properties; what was read of any other kind is
    written as a PLY, and where that kind has a writer as that too.
    """
    name, keep, splats = FILES["clean-splat"], job.known.kept_splats, job.inputs.shown_splats
    source = job.inputs.splat_file
    assert splats is not None
    into.facts["clean_splat"] = {"splats": len(keep), "floaters": int(np.count_nonzero(~keep))}
    kind = "tiles" if source is None else kind_of(source)
    with job.stages.stage("write"):
        if source is not None and kind == "ply":
            write_selected(into.path / name, source, keep)
            return [name]
        kept = splats.take(np.flatnonzero(keep))
        write_splats(into.path / name, kept)
        if not can_hold(kind, kept):
            return [name]
        write_splats(into.path / f"clean_splat.{kind}", kept, kind)
    return [name, f"clean_splat.{kind}"]


def write_pass_files(job: Job, into: LitFolder) -> list[str]:
    """Write the passes of every camera; returns the names of the files."""
    known, exposure = job.known, np.float32(into.shaded.exposure)
    with job.stages.stage("passes"):
        parts = {name: part * exposure for name, part in job.light_parts(into.shaded).items()}
        first, views = Preview(known.scene, None, *PICTURE_SIZE), known.pass_views
        pictures = [first] if views is None else [first.at(view) for view in views]
        return write_passes(into.path, pictures, known.albedo, known.scene.normals, parts, job.request.color_space)


class EngineFiles:
    """Writes results of a job that engines read, and live.glb where it is asked for."""

    def __init__(self, job: Job) -> None:
        self._job, self._known, self._stages = job, job.known, job.stages

    def write(self, into: LitFolder) -> list[str]:
        """Write the files of one light; returns their names."""
        known, shaded, kinds = self._known, into.shaded, self._job.inputs.formats
        light, exposure = shaded.light, shaded.exposure
        lit = ShownLight(light, exposure * shaded.backdrop, self._job.lamps_shown(light, exposure))
        names: list[str] = self._write_live(into.path, lit) if self._job.request.live_mesh else []
        if "albedo-splat" in kinds:
            names += self._write_albedo(into.path)
        if into.relit is None:
            return names
        with self._stages.stage("write"):
            if "splat-glb" in kinds:
                extras = {"environment": light.name, "angle_deg": light.rotation_deg, "exposure": exposure}
                write_splat_glb(into.path / FILES["splat-glb"], into.relit, known.scene.scene_from_splat, extras)
                names.append(FILES["splat-glb"])
            if "usd" in kinds:
                from ..output.usd import write_usd

                looks = {"relit": into.relit}
                if "albedo-splat" in kinds:
                    looks["albedo"] = self._albedo[0]
                names += write_usd(into.path, looks, known.scene, known.albedo, lit, known.roughness)
        return names

    def _write_live(self, folder: Path, lit: ShownLight) -> list[str]:
        if lit.placed.lamps or isinstance(lit.light, CapturedLight):
            message = (
                "live.glb shows the light of an environment alone, neither captured light nor placed lamps on its mesh"
            )
            warnings.warn(f"{message}; lamps are in the file as lights, for other objects", DataWarning, stacklevel=2)
        nine = self._nine
        with self._stages.stage("write"):
            known = self._known
            write_live_glb(folder / FILE, known.scene, known.albedo, nine, lit, known.roughness)
        return [FILE]

    @cached_property
    def _nine(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        with self._stages.stage("live mesh"):
            return nine_coefficients(self._known.relighter, self._known.appearance.albedo)

    @cached_property
    def _albedo(self) -> tuple[Splats, NDArray[np.float32]]:
        """The splats with the light of the capture removed, and their normals (N, 3)."""
        splats, look, asked = self._job.inputs.shown_splats, self._known.appearance, self._job.request
        assert splats is not None  # no kind that needs them gets here without
        binding, mirror = self._known.binding, self._known.mirror
        rows = shown_as_sky(splats, self._known.scene, look, mirror)
        with self._stages.stage("albedo splats"):
            sky, used = "keep" if asked.sky == "keep" else "drop", None if look.as_captured else binding
            return albedo_splats(splats, used, look, rows, asked.harmonics, sky), normals_of(binding)

    def _write_albedo(self, folder: Path) -> list[str]:
        """The splats as albedo, and the mesh in their frame and in that of PlayCanvas."""
        (splats, normals), known = self._albedo, self._known
        back = np.asarray(np.linalg.inv(known.scene.scene_from_splat), np.float64)
        with self._stages.stage("write"):
            write_relit_ply(folder / FILES["albedo-splat"], splats, self._job.inputs.splat_file, normals)
            write_proxy_glb(folder / PROXY, known.scene, back, known.albedo, known.roughness)
            write_proxy_glb(folder / COLLISION, known.scene, PLAYCANVAS_FROM_SPLAT @ back)
        return [FILES["albedo-splat"], PROXY, COLLISION]
