"""Splats relit like the mesh that they are bound to, and their files."""

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.progress import Stages
from splat2mesh.scene.color import luminance
from splat2mesh.splats.formats import can_hold, kind_of, sog_writing, write_splats
from splat2mesh.splats.splats import Splats

from ..engine.assumed_light import assumed_change
from ..gloss.scene_gloss import NewLight
from ..insert.inserts import shadowed
from ..light.environment import Environment
from ..splats import write_relit_ply
from ..splats.binding import ROUNDS, Binding
from ..splats.light_ratio import Usual
from ..splats.parts import blended_splats
from ..splats.sky import FarSplats, far_splats
from ..transfer.store import array_key
from .kinds import FILES
from .subject import WrittenScene

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Shaded, Shading
    from ..insert.inserts import InsertedLight

SHAPES = {"means_l.webp", "means_u.webp", "quats.webp", "scales.webp", sog_writing.SHAPE}


class BoundSplats(NamedTuple):
    """Splats bound to their mesh, and what a light changes of them.

    binding: their Binding. before: (V, 3) captured irradiance over pi. far: what shows the sky, or None. gloss: takes
    relit splats and a NewLight, and returns the splats with its reflections; None without.
    """

    binding: Binding
    before: Radiance
    far: FarSplats | None = None
    gloss: Callable[[Splats, NewLight], Splats] | None = None


class SplatLight(NamedTuple):
    """A light on splats. received: (V, 3) irradiance over pi. exposure: display value per unit of it. mirrored: what
    glossy ones mirror, or None. inserted: what objects change, or None. sky: the light itself, turned, or None to leave
    the far ones. sky_factor: display value per unit of its radiance. usual: the typical change, where it is known."""

    received: NDArray[np.floating]
    exposure: float = 1.0
    mirrored: NewLight | None = None
    inserted: "InsertedLight | None" = None
    sky: Environment | None = None
    sky_factor: float = 1.0
    usual: Usual | None = None


def relit(splats: BoundSplats, light: SplatLight, rounds: int = ROUNDS, stages: Stages | None = None) -> Splats:
    """Return splats in a light, row by row. rounds: of the fit in views."""
    stages = stages or Stages()
    with stages.stage("relight splats"):
        found = splats.binding.relit(splats.before, light.received, light.exposure, rounds, light.usual)
    if splats.gloss is not None and light.mirrored is not None:
        found = splats.gloss(found, light.mirrored)
    if light.inserted is not None:
        found = shadowed(light.inserted, found)
    if splats.far is None or light.sky is None:
        return found
    with stages.stage("relight splats"):
        return splats.far.under(found, light.sky, light.sky_factor)


class RelitSource:
    """The splats of a written scene, in any of its lights."""

    def __init__(self, written: WrittenScene) -> None:
        self._written, self._stages, self._cache = written, written.stages, written.relighter.cache
        self._of_parts: dict[int, tuple[Shaded, Splats]] = {}

    @cached_property
    def _far(self) -> FarSplats:
        written, splats = self._written, self._written.source
        assert splats is not None  # not called otherwise
        mirror = written.mirror()
        return far_splats(splats, written.scene, written.appearance, mirror, written.asked.sky)

    def of_frame(
        self, splats: Splats, path: Path, binding: Binding | None = None, look: "Appearance | None" = None
    ) -> "RelitSource":
        """That of other splats, row by row the same ones, of a file. binding, look: of them where they have moved, and
        all take the light of the whole; else they rest, and have other colours."""
        bound, look = self._written.binding, look or self._written.appearance
        frame = replace(self._written, splats=(splats, [path]), appearance=look, gloss=None)
        if binding is not None:
            frame = replace(frame, lit_parts=())
        other = RelitSource(replace(frame, binding=lambda: binding or bound().recoloured(splats)))
        other._far = self._far._replace(source=splats)
        return other

    def relit(self, shaded: "Shaded", usual: Usual | None = None) -> Splats:
        """The splats in the new light, as far as they take it, and parts in their own, row by row those of the source,
        in its frame. usual: of another pose of the scene."""
        found = self._where_new(shaded, usual)
        for number, part in enumerate(self._written.lit_parts):
            if part.shares.splats is not None:
                found = blended_splats(found, self._as_part(number, part.under(shaded)), part.shares.splats)
        return found

    def _as_part(self, number: int, own: "Shaded") -> Splats:
        """All splats in the light of a part, kept until that changes."""
        if number not in self._of_parts or self._of_parts[number][0] is not own:
            self._of_parts[number] = own, self._in_new_light(own)
        return self._of_parts[number][1]

    def _where_new(self, shaded: "Shaded", usual: Usual | None) -> Splats:
        """The splats with the new light where only a part takes it, or all but that."""
        found, source, part = self._in_new_light(shaded, usual), self._written.source, self._written.part
        if part is None or part.splats is None or source is None:
            return found
        if self._written.part_shadow is not None:
            source = self._written.binding().shaded(source, self._written.part_shadow(shaded))
        return blended_splats(source, found, part.splats)

    def _in_new_light(self, shaded: "Shaded", usual: Usual | None = None) -> Splats:
        far, look, light, exposure = self._far, self._written.appearance, shaded.light, shaded.exposure
        factor = exposure * shaded.backdrop
        if look.capture is not None and look.as_captured and shaded.environment > 0.0:
            # The sky is as bright beside what was captured as it was then.
            factor = look.capture["brightness"] / (light.mean_luminance or 1.0)
            if shaded.shading.received is None:
                return far.under(far.source, light, factor)
            factor *= float(luminance(assumed_change(light)))
        gloss, received = self._written.gloss, self.received(shaded.shading)
        mirrored = None if gloss is None else NewLight.of(shaded, received, self._written.lamp_light())
        shining = None if gloss is None else partial(gloss.relit, look)
        bound = BoundSplats(self._written.binding(), look.irradiance, far, shining)
        under = SplatLight(received, exposure, mirrored, shaded.inserted, light, factor, usual)
        return relit(bound, under, stages=self._stages)

    def without_objects(self, shaded: "Shaded") -> Splats:
        """The splats in the new light without what objects change in it."""
        shading = shaded.shading
        shading = shading._replace(radiance=shading.radiance / shaded.inserted.ratio)
        return self.relit(shaded._replace(shading=shading, inserted=None))

    def received(self, shading: "Shading", exposure: float = 1.0) -> NDArray[np.float32]:
        """(V, 3) irradiance over pi, unit of the radiance."""
        known = shading.received
        return self._written.appearance.received(shading.radiance, exposure) if known is None else known

    def write(self, folder: Path, relit: Splats) -> list[str]:
        """The splats in the new light, also in the format of their source: names of files beyond FILES."""
        with self._stages.stage("write"):
            source = self._written.source_file
            write_relit_ply(folder / FILES["splat"], relit, source)
            kind = kind_of(source) if source else "ply"
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
        key = array_key(splats.means, splats.scales, splats.quats_wxyz)
        kept = self._cache.restored(_restored_shapes, "sog", key)
        if kept is None:
            kept = make()
            self._cache.put("sog", key, **{name: np.frombuffer(data, np.uint8) for name, data in kept.items()})
        return kept


def _restored_shapes(arrays: Mapping[str, NDArray[Any]]) -> dict[str, bytes]:
    """The images as they were kept. Raises ValueError for others."""
    files = {name: each.tobytes() for name, each in arrays.items() if each.dtype == np.uint8}
    if set(files) != SHAPES or set(json.loads(files[sog_writing.SHAPE])) != {"means", "scales", "quats"}:
        raise ValueError("kept images are of another kind")
    return files
