"""The check of an estimate of the capture's light: the scene relit by that light must look as captured.

Where it does not, the estimate is wrong, and a change of light would be wrong there too. So the check reduces the
change there, region by region.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Integers, Radiance
from splat2mesh.scene.color import srgb_from_linear

from ..transfer.occluder import Occluder
from . import samples

if TYPE_CHECKING:
    from ..transfer.bounces import Interreflection
    from .captured import Estimate

DOUBT = 0.35
"""Difference of the logarithm of what a region received, as relit and as estimated, at which half of a change is
applied: a third brighter or darker."""

DISTRUSTED = 0.5
"""Trust below which a vertex counts as left nearly as captured."""

REGION_RINGS = 3
"""Rounds in which doubts are averaged over neighbours: a region is some rings of vertices."""

_LEAST = 1e-3
"""Linear light below which differences are not seen."""

_BEST_DB = 99.0  # of what agrees to the bit


def self_relight(
    occluder: Occluder,
    captured: NDArray[np.float32],
    found: "Estimate",
    interreflection: "Interreflection",
    seen: Floats | None = None,
) -> dict[str, NDArray[Any]]:
    """The error of the capture relit by its own estimated light: a dict of arrays.

    found: Estimate. interreflection: that it was made with. seen: (V,) what each vertex counts, its
    area without. self_relight_db: PSNR of sRGB colours over vertices neither black nor clipped, of captured colours
    times their change of light, as splats and textures are relit: only bounces are off. mesh_self_relight_db:
    the same of albedo times light, as meshes are lit; its error includes light that no albedo explains.
    trust: (V,) float32. distrusted_share: part of the visible surface.
    """
    from ..transfer.bounces import with_bounces

    areas = samples.vertex_areas(occluder) if seen is None else np.asarray(seen, np.float64)
    if not found.separable:
        trust = np.ones(len(captured), np.float32)
        best = {"self_relight_db": np.array(_BEST_DB), "mesh_self_relight_db": np.array(_BEST_DB)}
        return {**best, "trust": trust, "distrusted_share": np.array(0.0)}
    direct = found.irradiance - interreflection.bounce(captured)  # as its environment gives it
    radiance, _ = with_bounces(np.maximum(direct, np.float32(0.0)), found.albedo, interreflection)
    trust = trust_in(radiance, captured, occluder.faces)
    before = np.maximum(found.irradiance, np.float32(1e-12))
    after = drawn_to_none(before, radiance / found.albedo, trust)
    known = np.where((captured.max(axis=1) < 1.0) & (captured.max(axis=1) > _LEAST), areas, 0.0)
    return {
        "self_relight_db": np.array(_decibels(captured * (after / before), captured, known)),
        "mesh_self_relight_db": np.array(_decibels(radiance, captured, known)),
        "trust": trust,
        "distrusted_share": np.array(float(areas[trust < DISTRUSTED].sum() / max(areas.sum(), 1e-30))),
    }


def trust_in(modelled: Radiance, captured: Radiance, faces: Integers, half: float = DOUBT) -> NDArray[np.float32]:
    """(V,) float32 in (0, 1]: trust in a model that says (V, 3) was captured where (V, 3) was, by region.

    half: as DOUBT.
    """
    doubt = np.abs(np.log((modelled.mean(axis=1) + _LEAST) / (captured.mean(axis=1) + _LEAST)))
    return (1.0 / (1.0 + (_of_region(faces, doubt) / half) ** 2)).astype(np.float32)


def _decibels(shown: Radiance, captured: Radiance, weights: Floats) -> float:
    """PSNR of linear colours (V, 3) as sRGB."""
    off = srgb_from_linear(np.clip(shown, 0.0, 1.0)) - srgb_from_linear(np.clip(captured, 0.0, 1.0))
    error = float((weights * np.square(off).mean(axis=1)).sum()) / max(float(weights.sum()), 1e-30)
    return min(-10.0 * math.log10(max(error, 1e-12)), _BEST_DB)


def drawn_to_none(before: Radiance, after: Radiance, trust: Floats) -> NDArray[np.float32]:
    """(V, 3) float32: `after` where trust (V,) is 1, `before`, as bright as `after` is on the whole, where it is 0.

    Between them the logarithms are blended.
    """
    before, after = (np.maximum(values, np.float32(1e-12)) for values in (before, after))
    level = np.exp(np.median(np.log(after) - np.log(before)).astype(np.float32))
    share = trust[:, None]
    return np.where(share < 1.0, after**share * (level * before) ** (1.0 - share), after).astype(np.float32)


def _of_region(faces: Integers, values: Floats) -> Floats:
    """Values (V,) averaged over the faces around each vertex, a few times over."""
    count = np.maximum(3.0 * np.bincount(faces.ravel(), minlength=len(values)), 1.0)
    for _ in range(REGION_RINGS):
        around = values[faces].sum(axis=1)
        values = sum(np.bincount(faces[:, corner], around, len(values)) for corner in range(3)) / count
    return values
