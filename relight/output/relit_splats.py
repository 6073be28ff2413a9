"""Splats relit like the mesh that they are bound to, and their files."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance
from splat2mesh.splats.formats import can_hold, kind_of, sog_writing, write_splats
from splat2mesh.splats.splats import Splats

from ..engine.assumed_light import assumed_change
from ..light.captured import CapturedLight
from ..transfer.store import array_key
from .kinds import FILES
from .subject import WrittenScene

if TYPE_CHECKING:
    from ..engine.relighter import Shaded, Shading
    from ..insert.inserts import InsertedLight
    from ..splats.floor_mirror import FloorMirror

SHAPES = {"means_l.webp", "means_u.webp", "quats.webp", "scales.webp", sog_writing.SHAPE}

LEAST_LIGHT = 1e-6
"""Mean luminance of an environment below which its sky is black."""


class RelitSource:
    """The splats of a written scene, in any of its lights."""

    def __init__(self, written: WrittenScene) -> None:
        self._appearance, self._bound, self._gloss = written.appearance, written.binding, written.gloss
        self._splats: Splats | None
        self._splats, self._paths = written.splats or (None, [])
        self._scene, self._stages, self._sky = written.relighter.scene, written.relighter.stages, written.sky
        self._sky_rows: Any = None
        self._far: Any = None
        self._mirror, self._cache = written.mirror, written.relighter.cache

    def relit(self, shaded: "Shaded") -> Splats:
        """The splats in the new light, row by row those of the source, in its frame."""
        from ..splats import shown_as_sky, under_sky
        from ..splats.sky import dimmed

        assert self._splats is not None  # not called otherwise
        if self._sky_rows is None:
            mirror, self._far = self._mirror(), self._scene.background_splats
            self._far = self._far if mirror is None else mirror.spared(self._far)
            self._sky_rows = shown_as_sky(self._splats, self._scene, self._appearance, mirror, self._cache)
        light, shading, exposure, backdrop = shaded[:4]
        inserted = shaded.inserted
        rows, frame = self._sky_rows, self._scene.scene_from_splat
        capture = self._appearance.capture
        if capture is not None and self._appearance.kept and shaded.environment > 0.0:
            # The sky is as bright beside what was captured as it was then.
            behind = capture["brightness"] / max(light.mean_luminance, LEAST_LIGHT)
            if shading.received is None:
                return under_sky(self._splats, rows, light, frame, behind, self._sky)
            backdrop = behind / exposure * float(luminance(assumed_change(light)))
        binding = self._bound()
        with self._stages.stage("relight splats"):
            received = self.received(shading)
            relit = binding.relit(self._appearance.irradiance, received, exposure)
        if self._gloss is not None:
            relit = self._gloss.relit(relit, self._appearance, shaded, received)
        if inserted is not None:
            from ..insert.shadowed import shadowed

            relit = shadowed(inserted, relit, self.floor_under(inserted, exposure))
        with self._stages.stage("relight splats"):
            if isinstance(light, CapturedLight) and self._sky == "new":  # no lamp reaches that far
                return dimmed(relit, self._splats, self._far, exposure * backdrop)
            return under_sky(relit, rows, light, frame, exposure * backdrop, self._sky)

    def floor_under(self, inserted: "InsertedLight", exposure: float) -> "FloorMirror | None":
        """The floor that mirrors, in the light on objects; None without one. exposure: of the light."""
        from ..insert.polished import floor_under

        mirror = self._mirror()
        return None if mirror is None else floor_under(mirror, inserted, exposure)

    def put_in(self, inserted: "InsertedLight", exposure: float) -> Splats | None:
        """The splats among the objects, and images of them in a floor that mirrors; None without."""
        splats, floor = inserted.splats_put_in(exposure), self.floor_under(inserted, exposure)
        if splats is None or floor is None:
            return splats
        from splat2mesh.splats.joining import joined

        from ..insert.polished import images_of

        return joined([splats, images_of(splats, floor, self._scene)])

    def without_objects(self, shaded: "Shaded") -> Splats:
        """The splats in the new light without what objects change in it."""
        shading = shaded.shading
        shading = shading._replace(radiance=shading.radiance / shaded.inserted.ratio)
        return self.relit(shaded._replace(shading=shading, inserted=None))

    def received(self, shading: "Shading", exposure: float = 1.0) -> NDArray[np.float32]:
        """(V, 3) irradiance over pi, unit of the radiance."""
        known = shading.received
        return self._appearance.received(shading.radiance, exposure) if known is None else known

    def write(self, folder: Path, relit: Splats) -> list[str]:
        """The splats in the new light, also in the format of their source: names of files beyond FILES."""
        from ..splats import write_relit_ply

        with self._stages.stage("write"):
            source = self._paths[0] if len(self._paths) == 1 else None
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
