"""The colours of a splat on a surface: pictures of it projected onto points, each weighted by its view of them.

A picture counts most for points that it shows frontally and, in a place, from near. It does not count for
occluded points, or where it shows another surface.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import ColorsSrgb, Directions, Floats, Indices, Points
from ..base.kernels import kernel
from ..base.threads import shared
from ..render.footprints import EVERYWHERE, TILE
from ..render.rasterize import rasterize
from ..render.view import View, stacked
from ..scene.color import bytes_from_unit
from ..surface.album import groups_of, may_see
from ..surface.extract import Look
from ..surface.sight import LEAST_COSINE

DepthIn: TypeAlias = Callable[[View], Floats]
"""The camera z (H, W) of a surface in a view, infinite without one."""

LEAST_ALPHA = 0.5
"""Opacity below which a pixel shows no surface."""

RAYS = 2
"""Rays along a side of a tile that meet the surface there."""

DEEPEST = 1.05
"""Factor on the depth of a picture's deepest pixel, behind which it shows nothing."""


class Pictures(NamedTuple):
    """M pictures of P pixels in all, one after the other, row by row.

    poses: (M, 3, 4) float64 camera_from_world. lenses: (M, 4) float64 fx, fy, cx, cy. sizes: (M, 2) int64 height and
    width. starts: (M,) int64 first pixel of each. colors: (P, 3) uint8 sRGB. depth: (P,) float32 camera z, NaN where
    no surface is. deepest: (M,) float64, z behind which each shows nothing.
    """

    poses: NDArray[np.float64]
    lenses: NDArray[np.float64]
    sizes: NDArray[np.int64]
    starts: NDArray[np.int64]
    colors: ColorsSrgb
    depth: NDArray[np.float32]
    deepest: NDArray[np.float64]

    @classmethod
    def of(
        cls, looks: Sequence[Look], pixels: int, surface: DepthIn | None, tolerance: tuple[float, float]
    ) -> "Pictures":
        """Pictures of some Look, `pixels` along the longer side, up to a surface if there is one. tolerance: as of
        `shown`. What is looked at after the first, the far background, may lie behind it and is drawn whole."""
        views = [view.resized(pixels) for look in looks for view in look.views]
        stack = stacked(views)
        ends = np.append(stack.starts[1:], stack.sizes.prod(axis=1).sum())
        colors, depth = np.zeros((ends[-1], 3), np.uint8), np.full(ends[-1], np.nan, np.float32)
        deepest, number = np.zeros(len(views)), 0
        for look in looks:
            for plane in look.near:
                reach = deepest_of(views[number], surface, tolerance) if surface and look is looks[0] else EVERYWHERE
                seen = rasterize(look.splats, views[number], float(plane), reach)
                solid = seen.alpha > LEAST_ALPHA
                part = slice(stack.starts[number], ends[number])
                color = seen.color / np.maximum(seen.alpha, LEAST_ALPHA)[..., None]
                colors[part] = bytes_from_unit(color).reshape(-1, 3)
                depth[part] = np.where(solid, seen.depth_median, np.nan).ravel()
                deepest[number] = DEEPEST * np.nan_to_num(depth[part]).max()
                number += 1
        return cls(*stack, colors, depth, deepest)

    def shown(
        self, points: Points, normals: Directions, nearness: float, tolerance: tuple[float, float]
    ) -> tuple[NDArray[np.float32], NDArray]:
        """The colours of the pictures at points (N, 3) with unit normals (N, 3): sRGB (N, 3) float32 in [0, 255], and
        whether any shows it, (N,) bool. It is a mean whose weights are cosine^2 / distance^nearness.
        tolerance: how far from the depth of a pixel a point may lie and still be shown there, in units of its distance
        and of the splats."""
        places = points.astype(np.float64)
        result, weights = np.zeros((len(points), 3), np.float32), np.zeros(len(points), np.float32)
        order, groups = groups_of(places)
        typical = float(np.median(self.deepest))
        asked = _Asked(places, normals.astype(np.float64), order, groups, typical, nearness, *tolerance)
        _show(len(groups) - 1, asked, self, result, weights)
        seen = weights > 0.0
        result[seen] /= weights[seen, None]
        return result, seen


def deepest_of(view: View, surface: DepthIn, tolerance: tuple[float, float]) -> NDArray[np.float32]:
    """Camera z up to which each tile of a view shows a surface, 0 where it shows none: (tiles,) float32. surface: gives
    its camera z in a view. tolerance: how far behind it splats may lie, in units of the distance and of the splats."""
    down, across, step = -(-view.height // TILE), -(-view.width // TILE), TILE / RAYS
    lens = {name: getattr(view, name) / step for name in ("fx", "fy", "cx", "cy")}
    met = surface(replace(view, width=RAYS * across, height=RAYS * down, **lens))
    met = np.where(np.isfinite(met), (1.0 + tolerance[0]) * met + tolerance[1], 0.0).astype(np.float32)
    # The tiles around tell of edges that pass between the rays.
    return scipy.ndimage.maximum_filter(met.reshape(down, RAYS, across, RAYS).max(axis=(1, 3)), 3).ravel()


class _Asked(NamedTuple):
    """Points (N, 3) and normals (N, 3), their order (N,) by groups that lie together, where each group begins in it and
    the end (G + 1,), how nearness counts, (typical / distance)^nearness, and the tolerance of depths."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    order: Indices
    groups: Indices
    typical: float
    nearness: float
    relative: float
    absolute: float


@shared
@kernel
def _show(begin: int, end: int, asked: _Asked, pictures: Pictures, result: Floats, weights: Floats) -> None:
    points = asked.points
    for g in range(begin, end):
        members = asked.order[asked.groups[g] : asked.groups[g + 1]]
        low, high = points[members[0]].copy(), points[members[0]].copy()
        for i in members:
            for k in range(3):
                low[k], high[k] = min(low[k], points[i, k]), max(high[k], points[i, k])
        middle, half = (low + high) / 2, (high - low) / 2
        for m in range(len(pictures.poses)):
            if may_see(pictures.poses[m], pictures.lenses[m], pictures.sizes[m], pictures.deepest[m], middle, half):
                _add(members, m, asked, pictures, result, weights)


@kernel
def _add(members: Indices, m: int, asked: _Asked, pictures: Pictures, result: Floats, weights: Floats) -> None:
    """Add to some points what one picture shows there."""
    p, lens, height, width = pictures.poses[m], pictures.lenses[m], pictures.sizes[m, 0], pictures.sizes[m, 1]
    for i in members:
        x, y, z = asked.points[i, 0], asked.points[i, 1], asked.points[i, 2]
        cx = p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]
        cy = p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]
        cz = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
        facing = 0.0
        for k in range(3):
            along = p[0, k] * cx + p[1, k] * cy + p[2, k] * cz  # from the eye to the point, in the world
            facing -= asked.normals[i, k] * along
        if cz <= 0.0 or facing <= 0.0:
            continue
        cosine = facing / np.sqrt(cx * cx + cy * cy + cz * cz)
        u, v = lens[0] * cx / cz + lens[2] - 0.5, lens[1] * cy / cz + lens[3] - 0.5
        if cosine < LEAST_COSINE or not (0.0 <= u < width - 1 and 0.0 <= v < height - 1):
            continue
        left, top = int(u), int(v)
        right, below = u - left, v - top
        red = green = blue = 0.0
        for q in range(4):  # all four pixels must show this surface, or colours mix
            at = pictures.starts[m] + (top + (q >> 1)) * width + left + (q & 1)
            if not abs(pictures.depth[at] - cz) < asked.relative * cz + asked.absolute:
                break
            share = (right if q & 1 else 1.0 - right) * (below if q >> 1 else 1.0 - below)
            red += share * pictures.colors[at, 0]
            green += share * pictures.colors[at, 1]
            blue += share * pictures.colors[at, 2]
        else:
            weight = cosine * cosine * (asked.typical / cz) ** asked.nearness
            result[i, 0] += weight * red
            result[i, 1] += weight * green
            result[i, 2] += weight * blue
            weights[i] += weight
