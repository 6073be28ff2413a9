"""The view-dependent part, patch by patch: sums of squares that give any light's fit to the mirrored directions.

In linear light a pixel shows c = d + f(cosine) F sum_l a_l L_lm Y_lm(mirrored): d is the light that a place sends
everywhere; it cancels in differences from the place's mean over its views. The rest is linear in F a_l L_lm, so sums
over pixels, taken once, show how well any light and any roughness explain them.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Matrix3
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb

from ..sh import harmonics
from ..splats.binding import Binding
from ..splats.looks import Looks
from .ggx import fresnel_rise
from .pixels import SurfacePixels

BANDS = 5
"""Of the reflected light that is resolved. Harmonics of degree 3 in every Gaussian, turned differently over a curved
surface, show a little more together than each alone."""

PATCHES = 60
"""Into which the surface is divided by place and colour; parts of one material are found to be alike afterwards."""

PLACE = 2.5
"""Weight of diagonals beside display colours when it is divided."""

LEAST_PIXELS = 500
"""Pixels from which a patch counts."""

PLANE = 0.01
"""`PatchFits.curved` of patches that always count as planes: a trained table top has up to .012, its objects .03 to
.45, and patches of one ball .01 to .03."""

KINDS = 2  # dielectric and metal: with and without Fresnel's rise


class PatchFits(NamedTuple):
    """Sums over the pixels of P patches. K = BANDS^2 - 1: all coefficients but the mean, which no difference shows.

    patch: (M,) int32, the patch of each node. gram: (P, 2, 2, K, K), moments: (P, 2, 2, K, 3) and power: (P, 2, 3), of
    each patch, each half of its places and, except for power, each kind: dielectric, metal. pixels: (P,) how many.
    curved: (P,) 0 where a patch is plane, towards 1 where its normals face everywhere.
    """

    patch: NDArray[np.int32]
    gram: NDArray[np.float64]
    moments: NDArray[np.float64]
    power: NDArray[np.float64]
    pixels: NDArray[np.int64]
    curved: NDArray[np.float64]

    @property
    def informative(self) -> NDArray[np.bool_]:
        """(P,) bool: the patches whose reflections are sure to be some: the more curved half, or more where most are.

        Over a plane, the mirrored direction is the direction of view, and what harmonics show where no camera stood
        looks like a reflection. Parts of one large ball are all curved alike, and little.
        """
        seen = self.pixels > 0
        usual = float(np.median(self.curved[seen])) if seen.any() else 0.0
        return seen & (self.curved >= max(usual, PLANE))

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]]) -> "PatchFits":
        """Restore from `_asdict`. Raises InputError or KeyError for arrays that do not fit."""
        found = cls(*(np.asarray(arrays[name]) for name in cls._fields))
        patches, size = len(found.pixels), BANDS**2 - 1
        shapes: list[tuple[int, ...]] = [(len(found.patch),), (patches, 2, KINDS, size, size)]
        shapes += [(patches, 2, KINDS, size, 3), (patches, 2, 3), (patches,), (patches,)]
        if [np.shape(each) for each in found] != shapes:
            raise InputError("kept reflections are of another surface")
        if not all(np.isfinite(each).all() for each in found) or found.patch.max(initial=0) >= max(patches, 1):
            raise InputError("kept reflections are not finite")
        return found


def observed(
    binding: Binding,
    looks: Looks | None,  # Looks at the drawn splats of the Binding
    scene_from_splat: Matrix3,  # rotation
    colors: Floats,  # (V, 3) captured display colours of the vertices, in [0, 1]
    seed: int = 0,
) -> PatchFits | None:
    """The PatchFits of a splat whose harmonics show more than one colour; None where nothing depends on the view."""
    if looks is None or binding.splats.degree == 0:
        return None
    means, sh = (binding.drawn(values) for values in (binding.splats.means, binding.splats.sh))
    patch = _patches(binding, colors, seed)
    found = [_seen(binding, looks, means, sh, number, scene_from_splat) for number in range(len(looks.eyes))]
    node, color, mirrored, cosine = (np.concatenate([each[i] for each in found]) for i in range(4))
    patches = int(patch.max()) + 1
    size = BANDS**2 - 1
    gram, moments = np.zeros((patches, 2, KINDS, size, size)), np.zeros((patches, 2, KINDS, size, 3))
    power, pixels = np.zeros((patches, 2, 3)), np.zeros(patches, np.int64)
    of_pixel = patch[node]
    order = np.argsort(of_pixel, kind="stable")
    ends = np.searchsorted(of_pixel[order], np.arange(patches + 1))
    for number in range(patches):
        mine = order[ends[number] : ends[number + 1]]
        if len(mine) < LEAST_PIXELS:
            continue
        pixels[number] = len(mine)
        sums = _sums(node[mine], color[mine], mirrored[mine], cosine[mine])
        gram[number], moments[number], power[number] = sums
    curved = _curved(binding, patch, node, patches)
    return PatchFits(patch, gram, moments, power, pixels, curved)


def _seen(
    binding: Binding,
    looks: Looks,
    means: NDArray[np.float32],
    sh: NDArray[np.float32],
    number: int,
    scene_from_splat: Matrix3,
) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Node, linear colour, mirrored direction in the scene and cosine of the pixels of a view that mirror the sky."""
    pixels = SurfacePixels.of_view(looks, binding.surface, number)
    shown = linear_from_srgb(pixels.blending.drawn_toward(means, sh, pixels.eye))[pixels.known]
    open_sky = ~np.isfinite(pixels.hits(binding.surface, pixels.mirrored).distance)
    pixels, shown = pixels.take(open_sky), shown[open_sky]
    return pixels.nodes, shown.astype(np.float64), pixels.mirrored @ scene_from_splat.T, pixels.cosine


def _patches(binding: Binding, colors: Floats, seed: int) -> NDArray[np.int32]:
    """(M,) the patch of each node: k-means of places and colours."""
    surface = binding.surface
    shown = surface.of_vertices(np.asarray(colors, np.float64))
    features = np.concatenate([surface.points / surface.diagonal * PLACE, shown], axis=1)
    rng = np.random.default_rng(seed)
    used = np.flatnonzero(surface.used)
    sample = features[rng.choice(used, min(8000, len(used)), replace=False)]
    centers, _ = scipy.cluster.vq.kmeans2(sample, min(PATCHES, len(sample)), iter=15, minit="++", rng=rng)
    return scipy.spatial.cKDTree(centers).query(features)[1].astype(np.int32)


def _sums(
    node: NDArray[np.int32], color: Floats, mirrored: Floats, cosine: Floats
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """gram (2, 2, K, K), moments (2, 2, K, 3) and power (2, 3) of a patch's pixels."""
    _, place = np.unique(node, return_inverse=True)
    size = BANDS**2 - 1
    gram, moments = np.zeros((2, KINDS, size, size)), np.zeros((2, KINDS, size, 3))
    power = np.zeros((2, 3))
    # A change with the angle alone, as at grazing angles where the splat shows what lies behind, is no evidence.
    angle = _less_mean(np.stack([cosine, cosine**2, (1.0 - cosine) ** 5], axis=1), place)
    basis = harmonics.evaluate(mirrored, BANDS)[:, 1:]
    own = _less_mean(color, place)
    for kind in range(KINDS):
        lobe = basis * fresnel_rise(cosine, np.full(len(cosine), bool(kind)))[:, None]
        both = np.concatenate([_less_mean(lobe, place), own], axis=1)
        both -= angle @ np.linalg.lstsq(angle, both)[0]
        for half in range(2):
            rows = both[place % 2 == half]
            gram[half, kind] = rows[:, :size].T @ rows[:, :size]
            moments[half, kind] = rows[:, :size].T @ rows[:, size:]
            if kind == 0:
                power[half] = (rows[:, size:] ** 2).sum(axis=0)
    return gram, moments, power


def _less_mean(values: Floats, place: NDArray[np.integer]) -> Floats:
    """Values (N, C) less the mean of those of the same place."""
    counts = np.bincount(place)
    means = np.stack([np.bincount(place, column) for column in values.T], axis=1) / counts[:, None]
    return values - means[place]


def _curved(binding: Binding, patch: NDArray[np.int32], node: NDArray[np.int32], patches: int) -> NDArray[np.float64]:
    """(P,) one less the length of the mean normal of the nodes that were seen."""
    seen = np.unique(node)
    normals, of = binding.surface.normals[seen], patch[seen]
    total = np.stack([np.bincount(of, column, patches) for column in normals.T.astype(np.float64)], axis=1)
    counts = np.maximum(np.bincount(of, minlength=patches), 1)
    return 1.0 - np.linalg.norm(total, axis=1) / counts
