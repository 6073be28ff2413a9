"""The splat without the light of the capture, and normals, for a renderer that lights splats."""

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.sphere import NO_DIRECTION
from splat2mesh.splats.splats import Splats

from .binding import Binding

if TYPE_CHECKING:
    from ..engine.appearance import Appearance


def albedo_splats(
    splats: Splats,  # as captured
    binding: Binding | None,  # of them; None where the scene stays as captured
    appearance: "Appearance",  # of the scene
    background: NDArray[np.int64],  # (M,) rows that are far background
    harmonics: str = "zero",  # what depends on the view: "zero" or "keep"
    sky: str = "drop",  # what is far background: "drop" gives it no opacity, "keep" leaves it as captured
) -> Splats:
    """The splats under light that is 1 on every surface: their colours are albedo, sRGB. Row i is splat i.

    It is the relighting of `Binding.relit` with the light ratio 1 over what every vertex received on the capture day;
    albedo above 0.8 runs into 1, as light does there. With "zero" the splats are of degree 0. The far background is a
    picture of light, which has no albedo.
    """
    bare = splats
    if binding is not None:
        own = appearance.albedo
        unlit = np.ones_like(appearance.irradiance) if own is None else own
        bare = binding.relit(appearance.irradiance, appearance.received(unlit))
    sh, opacities = bare.sh.copy(), splats.opacities.copy()
    if sky == "keep":
        sh[background] = splats.sh[background]
    else:
        opacities[background] = 0.0
    if harmonics == "zero":
        sh = sh[:, :1]
    return replace(splats, opacities=opacities, sh=sh)


def normals_of(binding: Binding) -> NDArray[np.float32]:
    """Normals (N, 3) float32 of the splats of a Binding, unit, in their own frame: those of the mesh at their places.

    Where these cancel, as between the two sides of a leaf, it is the splat's own shortest axis, away from the middle
    of the mesh. Reflections of a floor have that of the floor. Splats that cannot be lit have (0, 0, 0).
    """
    surface, places = binding.surface, binding.places
    mean = places.interpolate(surface.normals)
    length = np.linalg.norm(mean, axis=1, keepdims=True)
    shown = binding.shown
    shortest = shown.scales.argmin(axis=1)
    axes = np.take_along_axis(shown.rotation_matrices(), shortest[:, None, None], axis=2)[:, :, 0]
    middle = surface.points.mean(axis=0, dtype=np.float64)
    axes *= np.where(np.einsum("nc,nc->n", axes, shown.means - middle) < 0.0, -1.0, 1.0)[:, None]
    normals = np.zeros((len(binding.lit), 3), np.float32)
    shown_normals = np.where(length > NO_DIRECTION, mean / np.maximum(length, NO_DIRECTION), axes)
    if binding.mirrored is not None:
        shown_normals[binding.mirrored.rows] = binding.mirrored.normal
    normals[binding.lit] = shown_normals
    return normals
