"""Bake the captured colour of the splat and its albedo into every texel of a scene's texture."""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import ColorsSrgb, Mask, Matrix4, Points, Radiance
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.progress import Stages
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.splats.cleaning import clean
from splat2mesh.surface.extract import dilated, training_pixel
from splat2mesh.texture.atlas import Atlas, check_size

from ..albedo import Prior, albedo_of
from .projected import seen_colors, views_of
from .unwrap import size_for, unwrap

if TYPE_CHECKING:
    from splat2mesh.render.view import View
    from splat2mesh.scene.scene import Scene
    from splat2mesh.splats.splats import Splats

FILL_FROM, FILL_SAMPLES = 4, 200_000
"""Nearest texels that fill an unseen one, and the most texels to choose them from."""

_ATLAS = tuple(each.name for each in fields(Atlas))


@dataclass(frozen=True)
class Baked:
    """A texture of T texels for a scene of V vertices. captured, albedo: (T, 3) float32 linear.

    unseen: number of texels that no view of the splat shows; they were filled from those around.
    """

    atlas: Atlas
    captured: NDArray[np.float32]
    albedo: NDArray[np.float32]
    unseen: int = 0

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, NDArray[Any]]) -> "Baked":
        """The result of `arrays`, read back."""
        atlas: dict[str, Any] = {name: arrays[f"atlas_{name}"] for name in _ATLAS}
        for name in ("vertices", "size", "texel_size"):
            atlas[name] = atlas[name].item()
        atlas["chunks"] = [range(*ends) for ends in atlas["chunks"].tolist()]
        return cls(Atlas(**atlas), arrays["captured"], arrays["albedo"], int(arrays["unseen"]))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The same as named arrays, to be kept."""
        atlas = {f"atlas_{name}": np.asarray(getattr(self.atlas, name)) for name in _ATLAS if name != "chunks"}
        atlas["atlas_chunks"] = np.array([[chunk.start, chunk.stop] for chunk in self.atlas.chunks])
        return {**atlas, "captured": self.captured, "albedo": self.albedo, "unseen": np.array(self.unseen)}

    def image(self, colors: Radiance) -> ColorsSrgb:
        """Linear colours of texels (T, 3) as a picture: (size, size, 3) uint8 sRGB."""
        return self.atlas.image(bytes_from_unit(srgb_from_linear(np.asarray(colors, np.float32))))

    def relit(self, irradiance: Radiance, exposure: float) -> ColorsSrgb:
        """The picture under a light: (V, 3) linear irradiance of the vertices, and display value per unit.

        irradiance: exit radiance that each vertex would have were it white itself. What exceeds 1 is clipped.
        Raises InputError for another shape and for values that are not finite.
        """
        irradiance = _per_vertex(irradiance, self.atlas, "irradiance")
        return self.image(self.albedo * self.atlas.interpolate(irradiance) * np.float32(exposure))


@dataclass(frozen=True, eq=False)
class KnownColors:
    """Knowledge of the light in captured colours; without any they are treated as albedo.

    irradiance: (V, 3) on the capture day, unit of the captured colours. prior: of `albedo_of`, which divides by it.
    albedo: (V, 3) if known; then it is not taken from splats.
    """

    irradiance: Radiance | None = None
    prior: Prior | None = None
    albedo: Radiance | None = None


def bake(
    scene: "Scene",
    splats: "Splats | None" = None,  # as `source_splats` reads them; None: colours of the vertices alone
    known: KnownColors = KnownColors(),
    size: int | None = None,  # of the texture in texels; by default as fine as the splat
    views: "list[View] | None" = None,  # in the frame of the splats; chosen by default
    stages: Stages | None = None,
    seed: int = 0,  # of the choice
) -> "Baked":
    """A Baked texture of a scene. Warns of texels that no view of the splat shows.

    Raises InputError for arrays that do not fit, a size out of range and splats that cannot be used.
    """
    stages = stages or Stages()
    if splats is not None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # making the scene has warned already
            splats, _ = clean(splats)
        pixel = training_pixel(splats)
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    unit = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    with stages.stage("unwrap"):
        if size is None:
            size = size_for(scene, _edge(scene) / 2 if splats is None else pixel * unit)
        atlas = unwrap(scene, check_size(size))
    irradiance, albedo = (
        None if given is None else _per_vertex(given, atlas, name)
        for given, name in ((known.irradiance, "irradiance"), (known.albedo, "albedo"))
    )
    unseen = 0
    if splats is None:
        with stages.stage("texels"):
            captured = atlas.interpolate(linear_from_srgb(scene.colors_srgb / np.float32(255.0)))
    else:
        with stages.stage("views"):
            if views is None:
                splats, views = views_of(scene, splats, atlas.texel_size / unit, seed)
            else:
                splats = dilated(splats, pixel)
        with stages.stage("texels", total=len(views)) as advance:
            captured, seen = _captured(scene, matrix, splats, views, atlas, advance)
        unseen = int((~seen).sum())
    if unseen:
        warnings.warn(
            f"no view of the splat shows {unseen} of {len(captured)} texels; they take the surrounding colour",
            DataWarning,
            stacklevel=2,
        )
    if albedo is not None:
        return Baked(atlas, captured, atlas.interpolate(albedo), unseen)
    if irradiance is None:
        return Baked(atlas, captured, captured, unseen)
    return Baked(atlas, captured, albedo_of(captured, atlas.interpolate(irradiance), known.prior), unseen)


def surface_points(scene: "Scene", atlas: Atlas) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Positions of texels and their smooth normals, scene frame: (T, 3) float32 each."""
    normals = atlas.interpolate(scene.normals)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    flat = lengths[:, 0] < 1e-6  # where opposing normals cancel, use the face's normal
    if flat.any():
        a, b, c = (scene.vertices[scene.faces[atlas.face[flat], corner]] for corner in range(3))
        normals[flat] = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return atlas.interpolate(scene.vertices), normals / np.maximum(lengths, 1e-30)


def _captured(
    scene: "Scene", matrix: Matrix4, splats: "Splats", views: "list[View]", atlas: Atlas, advance: Callable[[int], Any]
) -> tuple[NDArray[np.float32], Mask]:
    """Linear colours of the splats at all texels, (T, 3) float32, and whether any view shows each, (T,) bool."""
    points, normals = surface_points(scene, atlas)
    back = np.linalg.inv(matrix)
    points = (points @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
    turned = normals @ matrix[:3, :3]  # normals go by the inverse transpose of the points' matrix
    normals = (turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-30)).astype(np.float32)
    vertices = (scene.vertices @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
    colors, seen = seen_colors(splats, views, vertices, scene.faces, points, normals, advance)
    if not seen.any():
        raise InputError("no view of the splat shows the mesh: is it the splat that this scene was made from?")
    colors = linear_from_srgb(np.clip(colors, 0.0, 1.0))
    if not seen.all():
        colors[~seen] = _filled(points, colors, seen)
    return colors, seen


def _filled(points: Points, colors: NDArray[np.float32], seen: Mask) -> NDArray[np.float32]:
    """Colours for unseen texels: means of the nearest seen ones, weighted by the inverse squared distance."""
    from scipy.spatial import cKDTree

    rows = np.flatnonzero(seen)
    rows = rows[:: 1 + len(rows) // FILL_SAMPLES]
    distance, index = cKDTree(points[rows]).query(points[~seen], min(FILL_FROM, len(rows)), workers=-1)
    distance, index = distance.reshape(len(distance), -1), index.reshape(len(index), -1)
    weights = 1.0 / np.maximum(distance, 1e-12) ** 2
    weights /= weights.sum(axis=1, keepdims=True)
    return np.einsum("nk,nkc->nc", weights, colors[rows[index]]).astype(np.float32)


def _edge(scene: "Scene") -> float:
    """Median length of an edge, scene unit."""
    ends = scene.vertices[scene.faces]
    return float(np.median(np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)))


def _per_vertex(values: ArrayLike, atlas: Atlas, name: str) -> NDArray[np.float32]:
    """(V, 3) float32, or InputError."""
    values = np.asarray(values, np.float32)
    if values.shape != (atlas.vertices, 3):
        raise InputError(
            f"{name} must have shape ({atlas.vertices}, 3), one RGB per scene vertex; found {values.shape}"
        )
    if not np.isfinite(values).all():
        raise InputError(f"{name} of {int((~np.isfinite(values)).any(axis=1).sum())} vertices is not finite")
    return values
