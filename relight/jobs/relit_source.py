"""The splats of a job in any of its lights, and their files."""

import json
from collections.abc import Callable, Mapping
from copy import copy
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance
from splat2mesh.splats.formats import can_hold, kind_of, sog_writing, write_splats
from splat2mesh.splats.splats import Splats

from ..engine.appearance import Appearance
from ..engine.assumed_light import assumed_change
from ..engine.relighter import Shaded, Shading
from ..gloss.scene_gloss import NewLight
from ..output.kinds import FILES
from ..output.relit_splats import BoundSplats, SplatLight, relit
from ..splats import write_relit_ply
from ..splats.binding import Binding
from ..splats.parts import blended_splats
from ..splats.sky import FarSplats, far_splats
from ..transfer.store import array_key
from .job import Job
from .part_lights import PartLights

if TYPE_CHECKING:
    from ..splats.light_ratio import Usual

SHAPES = {"means_l.webp", "means_u.webp", "quats.webp", "scales.webp", sog_writing.SHAPE}


class RelitSource:
    """The splats of a job's scene, in any of its lights. parts: of the same job."""

    def __init__(self, job: Job, parts: PartLights) -> None:
        self._job, self._parts, self._lit, self._look = job, parts, parts.lit, job.known.appearance
        self._splats, self._file, self._gloss = job.inputs.shown_splats, job.inputs.splat_file, job.known.gloss
        self._binding: Callable[[], Binding] = lambda: job.known.binding
        self._far: FarSplats | None = None

    def of_frame(
        self, splats: Splats, path: Path, binding: Binding | None = None, look: Appearance | None = None
    ) -> "RelitSource":
        """That of other splats, row by row the same ones, of a file. binding, look: of them where they have moved, and
        all take the light of the whole; else they rest, and have other colours."""
        other, bound = copy(self), self._binding
        other._splats, other._file, other._gloss = splats, path, None
        other._look, other._lit = look or self._look, self._lit if binding is None else []
        other._binding = lambda: binding or bound().recoloured(splats)
        other._far = self._found_far()._replace(source=splats)
        return other

    def _found_far(self) -> FarSplats:
        if self._far is None:
            assert self._splats is not None  # not called otherwise
            known = self._job.known
            self._far = far_splats(self._splats, known.scene, self._look, known.mirror, self._job.request.sky)
        return self._far

    def relit(self, shaded: Shaded, usual: "Usual | None" = None) -> Splats:
        """The splats in the new light, as far as they take it, and parts in their own, row by row those of the source,
        in its frame. usual: of another pose of the scene."""
        found, part = self._in_new_light(shaded, usual), self._parts.new
        if part is not None and part.splats is not None and self._splats is not None:
            shade, source = self._parts.shadow_on_rest(shaded), self._splats
            found = blended_splats(
                source if shade is None else self._binding().shaded(source, shade), found, part.splats
            )
        for each in self._lit:
            if each.shares.splats is not None:
                found = blended_splats(found, self._in_new_light(each.under(shaded)), each.shares.splats)
        return found

    def _in_new_light(self, shaded: Shaded, usual: "Usual | None" = None) -> Splats:
        far, look, light, exposure = self._found_far(), self._look, shaded.light, shaded.exposure
        factor = exposure * shaded.backdrop
        if look.capture is not None and look.as_captured and shaded.environment > 0.0:
            # The sky is as bright beside what was captured as it was then.
            factor = look.capture["brightness"] / (light.mean_luminance or 1.0)
            if shaded.shading.received is None:
                return far.under(far.source, light, factor)
            factor *= float(luminance(assumed_change(light)))
        gloss, received = self._gloss, self.received(shaded.shading)
        mirrored = None if gloss is None else NewLight.of(shaded, received, self._job.lamp_light)
        shining = None if gloss is None else partial(gloss.relit, look)
        bound = BoundSplats(self._binding(), look.irradiance, far, shining)
        under = SplatLight(received, exposure, mirrored, shaded.inserted, light, factor, usual)
        return relit(bound, under, stages=self._job.stages)

    def without_objects(self, shaded: Shaded) -> Splats:
        """The splats in the new light without what objects change in it."""
        shading = shaded.shading
        shading = shading._replace(radiance=shading.radiance / shaded.inserted.ratio)
        return self.relit(shaded._replace(shading=shading, inserted=None))

    def received(self, shading: Shading, exposure: float = 1.0) -> NDArray[np.float32]:
        """(V, 3) irradiance over pi, unit of the radiance."""
        return self._look.received(shading.radiance, exposure) if shading.received is None else shading.received

    def write(self, folder: Path, relit: Splats) -> list[str]:
        """The splats in the new light, also in the format of their source: names of files beyond FILES."""
        with self._job.stages.stage("write"):
            write_relit_ply(folder / FILES["splat"], relit, self._file)
            kind = kind_of(self._file) if self._file else "ply"
            if kind == "ply" or not can_hold(kind, relit):
                return []
            name = f"relit_splat.{kind}"
            if kind == "sog":
                sog_writing.write(folder / name, relit, self._shapes)
            else:
                write_splats(folder / name, relit, kind)
        return [name]

    def _shapes(self, splats: Splats, make: Callable[[], dict[str, bytes]]) -> dict[str, bytes]:
        """The images of a SOG that no light changes, kept."""
        cache = self._job.known.relighter.cache
        key = array_key(splats.means, splats.scales, splats.quats_wxyz)
        kept = cache.restored(_restored_shapes, "sog", key)
        if kept is None:
            kept = make()
            cache.put("sog", key, **{name: np.frombuffer(data, np.uint8) for name, data in kept.items()})
        return kept


def _restored_shapes(arrays: Mapping[str, NDArray[Any]]) -> dict[str, bytes]:
    """The images as they were kept. Raises ValueError for others."""
    files = {name: each.tobytes() for name, each in arrays.items() if each.dtype == np.uint8}
    if set(files) != SHAPES or set(json.loads(files[sog_writing.SHAPE])) != {"means", "scales", "quats"}:
        raise ValueError("kept images are of another kind")
    return files
