"""The colours of a scene's texels without the light of the capture: from mesh.glb, from its splat, or from vertices."""

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import ColorsSrgb, Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Stages
from splat2mesh.base.threads import ROWS_AT_ONCE
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.splats.cleaning import clean
from splat2mesh.texture.atlas import Atlas
from splat2mesh.texture.looks import looks_from, looks_of
from splat2mesh.texture.texture import texture_of

from ..albedo import Prior, albedo_of

if TYPE_CHECKING:
    from splat2mesh.render.view import View
    from splat2mesh.scene.scene import Scene
    from splat2mesh.splats.splats import Splats

_ATLAS = tuple(each.name for each in fields(Atlas))


@dataclass(frozen=True, eq=False)
class KnownColors:
    """Knowledge of the light in captured colours; without any they are treated as albedo.

    irradiance: (V, 3) on the capture day, unit of the captured colours. prior: of `albedo_of`, which divides by it.
    albedo: (V, 3) if known; then it is not taken from splats.
    """

    irradiance: Radiance | None = None
    prior: Prior | None = None
    albedo: Radiance | None = None


@dataclass(frozen=True)
class Baked:
    """A texture of T texels for a scene of V vertices. albedo: (T, 3) float16 linear.

    unseen: number of texels that no view of the splat shows; they have the colours of the vertices.
    """

    atlas: Atlas
    albedo: NDArray[np.float16]
    unseen: int = 0

    @classmethod
    def of(cls, atlas: Atlas, captured: ColorsSrgb, known: KnownColors, unseen: int = 0) -> "Baked":
        """That of captured colours (T, 3) uint8. Raises InputError for arrays in `known` that do not fit."""
        irradiance, albedo = (
            None if given is None else _per_vertex(given, atlas, name)
            for given, name in ((known.irradiance, "irradiance"), (known.albedo, "albedo"))
        )
        found = np.empty((len(captured), 3), np.float16)
        linear = linear_from_srgb(np.arange(256, dtype=np.float32) / np.float32(255.0))
        for start in range(0, len(captured), ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            part = linear[captured[rows]]
            if albedo is not None:
                part = atlas.interpolate(albedo, rows)
            elif irradiance is not None and known.prior is not None:
                part = albedo_of(part, atlas.interpolate(irradiance, rows), known.prior)
            found[rows] = part
        return cls(atlas, found, unseen)

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> "Baked":
        """The result of `arrays`, read back."""
        atlas: dict[str, Any] = {name: arrays[f"atlas_{name}"] for name in _ATLAS}
        for name in ("vertices", "size", "texel_size"):
            atlas[name] = atlas[name].item()
        atlas["chunks"] = [range(*ends) for ends in atlas["chunks"].tolist()]
        return cls(Atlas(**atlas), arrays["albedo"], int(arrays["unseen"]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The same as named arrays, to be kept."""
        atlas = {f"atlas_{name}": np.asarray(getattr(self.atlas, name)) for name in _ATLAS if name != "chunks"}
        atlas["atlas_chunks"] = np.array([[chunk.start, chunk.stop] for chunk in self.atlas.chunks])
        return {**atlas, "albedo": self.albedo, "unseen": np.array(self.unseen)}

    def relit(self, irradiance: Radiance | None = None, exposure: float = 1.0) -> ColorsSrgb:
        """The picture under a light, (size, size, 3) uint8 sRGB: (V, 3) linear irradiance of the vertices, and display
        value per unit. Without any, the albedo.

        irradiance: exit radiance that each vertex would have were it white itself. What exceeds 1 is clipped.
        Raises InputError for another shape and for values that are not finite.
        """
        if irradiance is not None:
            irradiance = _per_vertex(irradiance, self.atlas, "irradiance")
        colors = np.empty((len(self.albedo), 3), np.uint8)
        for start in range(0, len(colors), ROWS_AT_ONCE):
            rows = slice(start, start + ROWS_AT_ONCE)
            shown: Any = self.albedo[rows].astype(np.float32)
            if irradiance is not None:
                shown = self.albedo[rows] * (self.atlas.interpolate(irradiance, rows) * np.float32(exposure))
            colors[rows] = bytes_from_unit(srgb_from_linear(np.clip(shown, 0.0, 1.0)))
        return self.atlas.image(colors)


def bake(
    scene: "Scene",
    splats: "Splats | None" = None,  # as `source_splats` reads them; None: colours of the vertices alone
    known: KnownColors = KnownColors(),
    size: int | None = None,  # of the texture in texels; by default as fine as the splat
    views: "list[View] | None" = None,  # in the frame of the splats; chosen by default
    stages: Stages | None = None,
    seed: int = 0,  # of the choice
) -> Baked:
    """A Baked texture of the chunks of a scene, unwrapped and coloured anew.

    Raises InputError for arrays that do not fit, a size out of range and splats that cannot be used or lie elsewhere.
    """
    looks = []
    if splats is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # making the scene has warned already
            splats, _ = clean(splats)
        looks = looks_of(scene, splats, seed) if views is None else looks_from(views, splats)
    made = texture_of(scene, looks, size, stages, background=False)
    if looks and made.unseen == len(made.colors):
        raise InputError("no view of the splat shows the mesh: is it the splat that this scene was made from?")
    return Baked.of(made.atlas, made.colors, known, made.unseen)


def _per_vertex(values: ArrayLike, atlas: Atlas, name: str) -> NDArray[np.float32]:
    """(V, 3) float32, or InputError."""
    values = np.asarray(values, np.float32)
    if values.shape != (atlas.vertices, 3):
        raise InputError(
            f"{name} must have shape ({atlas.vertices}, 3), one RGB per scene vertex; found {values.shape}"
        )
    if not np.isfinite(values).all():
        count = int((~np.isfinite(values).all(axis=1)).sum())
        raise InputError(f"{name} of {count} vertices is not finite")
    return values
