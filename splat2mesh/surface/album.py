"""The pictures of a scene, all in one, and their values at points on its surface: colour, thickness, pixel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import ColorsSrgb, DepthMap, Directions, Floats, Indices, Integers, Points, Vector
from ..base.kernels import kernel
from ..base.threads import shared
from ..render.view import View, stacked
from ..scene.color import bytes_from_unit
from .sight import LEAST_COSINE, Sighting

TOLERANCE, TOLERANCE_OBJECT = 0.02, 0.01
"""Largest distance of a seen point from the rendered depth, in units of that depth; of an object, whose strings and
handles stand close to it, in units of its radius."""

GREY = bytes_from_unit(0.5)
"""Colour where no view looked."""

THINNEST = 0.002
"""Thickness, in units of the distance, below which no picture is trusted more for seeing a thinner surface."""

PER_GROUP = 100
"""Points of a group, about: which pictures may show any of them is asked once."""

ROUNDING = 1e-9
"""More than sums of three products lose, relative to their terms."""


@dataclass(frozen=True)
class RenderedPicture:
    """The kept arrays of a rendered view. color: (H, W, 3) uint8 sRGB, over its own alpha. depth: (H, W) float32 camera
    z, NaN where empty. thickness: (H, W) float32 of the surface along its normal, world units, NaN where unknown."""

    view: View
    color: np.ndarray
    depth: np.ndarray
    thickness: np.ndarray

    @classmethod
    def from_render(cls, view: View, color: Floats, depth: DepthMap, thickness: Floats) -> "RenderedPicture":
        """Keep a view's color (H, W, 3), sRGB in [0, 1], depth and thickness."""
        return cls(view, bytes_from_unit(color), depth, thickness.astype(np.float32))


class Album(NamedTuple):
    """M pictures of P pixels in all, one after the other, row by row.

    poses: (M, 3, 4) float64 camera_from_world. lenses: (M, 4) float64 fx, fy, cx, cy. sizes: (M, 2) int64 height and
    width. starts: (M,) int64 first pixel of each. colors: (P, 3) uint8 sRGB. depth: (P,) float32 camera z, NaN where
    empty. allowed: (P,) float32, how far a point that shows there may lie before or behind, along z. thickness: (P,)
    float32 along the normal, world units.
    """

    poses: NDArray[np.float64]
    lenses: NDArray[np.float64]
    sizes: NDArray[np.int64]
    starts: NDArray[np.int64]
    colors: ColorsSrgb
    depth: NDArray[np.float32]
    allowed: NDArray[np.float32]
    thickness: NDArray[np.float32]

    @classmethod
    def of(cls, shots: Sequence[Sighting]) -> "Album":
        """The pictures of some Sightings of a place, whose surfaces may be thick."""
        depth = np.concatenate([shot.seen.depth.ravel() for shot in shots])
        spread = np.concatenate([shot.seen.spread.ravel() for shot in shots])
        return cls(
            *stacked([shot.view for shot in shots]),
            np.concatenate([bytes_from_unit(shot.seen.color).reshape(-1, 3) for shot in shots]),
            depth,
            np.fmax(np.float32(TOLERANCE) * depth, spread),
            np.concatenate([shot.thickness.ravel().astype(np.float32) for shot in shots]),
        )

    @classmethod
    def joined(cls, albums: "Sequence[Album]") -> "Album":
        """The pictures of a list of albums, in order."""
        parts = {name: np.concatenate([getattr(album, name) for album in albums]) for name in cls._fields}
        pixels = parts["sizes"].prod(axis=1)
        return cls(**{**parts, "starts": pixels.cumsum() - pixels})

    @classmethod
    def of_object(cls, pictures: Sequence[RenderedPicture], radius: float) -> "Album":
        """The pictures of an object of a radius, world units."""
        depth = np.concatenate([picture.depth.ravel() for picture in pictures])
        return cls(
            *stacked([picture.view for picture in pictures]),
            np.concatenate([picture.color.reshape(-1, 3) for picture in pictures]),
            depth,
            np.full_like(depth, TOLERANCE_OBJECT * radius),
            np.concatenate([picture.thickness.ravel() for picture in pictures]),
        )

    def look_up(
        self, points: Points, normals: Directions
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """The colours, thickness and pixels of the pictures at points (N, 3) with normals (N, 3), world.

        Returns colours (N, 3) float32 sRGB in [0, 255], the mean weighted by cosine^2 / z^4, NaN where no picture
        sees the point; thickness (N,) float32 in world units, inf there; and the size of the smallest pixel that saw it
        (N,) float32, world units, inf there.
        """
        colors = np.full((len(points), 3), np.nan, np.float32)
        thickness, pixel = np.full(len(points), np.inf, np.float32), np.full(len(points), np.inf, np.float32)
        places = points.astype(np.float64)
        asked = Asked(places, normals.astype(np.float64), *groups_of(places))
        _look_up(len(asked.groups) - 1, asked, self, self._deepest(), Shown(colors, thickness, pixel))
        return colors, thickness, pixel

    def _deepest(self) -> NDArray[np.float64]:
        """(M,) float64, z behind which no point shows in each picture."""
        behind = self.depth.astype(np.float64) + self.allowed
        return np.maximum.reduceat(np.nan_to_num(behind, nan=0.0), self.starts) * (1 + 1e-9)


def filled_in(colors: Floats, points: Points) -> tuple[ColorsSrgb, int]:
    """Colours (N, 3) uint8 of points (N, 3), NaN ones taken from the nearest that is none, and the number of these."""
    unseen = np.isnan(colors[:, 0])
    if unseen.all():
        colors = np.full_like(colors, GREY)
    elif unseen.any():
        nearest = scipy.spatial.cKDTree(points[~unseen]).query(points[unseen])[1]
        colors = colors.copy()
        colors[unseen] = colors[~unseen][nearest]
    return np.round(colors).astype(np.uint8), int(unseen.sum())


def groups_of(points: Points) -> tuple[Indices, Indices]:
    """Points (N, 3) by cubes of space: their order (N,), and where each group begins in it, and the end, (G + 1,)."""
    if not len(points):
        return np.zeros(0, np.int64), np.zeros(1, np.int64)
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    side = max(np.sqrt(np.sort(extent)[1:].prod() * PER_GROUP / len(points)), extent.max() / 2**20, 1e-300)
    x, y, z = np.floor((points - low) / side).astype(np.int64).T
    key = (x << 42) | (y << 21) | z
    order = np.argsort(key, kind="stable")
    new = np.flatnonzero(np.diff(key[order])) + 1
    return order, np.concatenate([[0], new, [len(points)]])


@kernel
def may_see(pose: Floats, lens: Floats, size: Integers, deepest: float, middle: Vector, half: Vector) -> bool:
    """Whether any point of a box, (3,) its middle and half its sides, may show in a picture."""
    z, reach_z, terms_z = _along(pose, 2, 1.0, 0.0, middle, half)
    if z + reach_z < -ROUNDING * terms_z or z - reach_z > deepest + ROUNDING * terms_z:
        return False
    for row in range(2):  # the planes through the eye and two sides of the picture
        for side in range(2):
            edge = size[1 - row] if side else 0.0
            at, reach, terms = _along(pose, row, lens[row], lens[2 + row] - edge, middle, half)
            reach += ROUNDING * terms
            if (side == 1 and at > reach) or (side == 0 and at < -reach):
                return False
    return True


@kernel
def _along(
    pose: Floats, row: int, scale: float, deep: float, middle: Vector, half: Vector
) -> tuple[float, float, float]:
    """`scale` times a row of a pose and `deep` times its last one, on a box: value in its middle, how far others differ
    from it, and the sum of the absolute terms."""
    at = scale * pose[row, 3] + deep * pose[2, 3]
    reach, terms = 0.0, abs(scale * pose[row, 3]) + abs(deep * pose[2, 3])
    for k in range(3):
        a, b = scale * pose[row, k], deep * pose[2, k]
        at += (a + b) * middle[k]
        reach += abs(a + b) * half[k]
        terms += (abs(a) + abs(b)) * (abs(middle[k]) + half[k])
    return at, reach, terms


class Asked(NamedTuple):
    """Points (N, 3) and normals (N, 3) float64, world, that are looked up: their order (N,) by groups that lie
    together, and where each group begins in it, and the end, (G + 1,) int64."""

    points: NDArray[np.float64]
    normals: NDArray[np.float64]
    order: Indices
    groups: Indices


class Shown(NamedTuple):
    """The output for each point, as in `Album.look_up`."""

    colors: NDArray[np.float32]
    thickness: NDArray[np.float32]
    pixel: NDArray[np.float32]


@shared
@kernel
def _look_up(begin: int, end: int, asked: Asked, album: Album, deepest: Floats, shown: Shown) -> None:
    """Look the points of some groups up in the pictures that may show any of them. deepest: (M,) of `_deepest`."""
    points, order, groups = asked.points, asked.order, asked.groups
    for g in range(begin, end):
        members = order[groups[g] : groups[g + 1]]
        low, high = points[members[0]].copy(), points[members[0]].copy()
        for i in members:
            for k in range(3):
                low[k], high[k] = min(low[k], points[i, k]), max(high[k], points[i, k])
        middle, half = (low + high) / 2, (high - low) / 2
        seers, count = np.empty(len(album.poses), np.int64), 0
        for m in range(len(album.poses)):
            if may_see(album.poses[m], album.lenses[m], album.sizes[m], deepest[m], middle, half):
                seers[count] = m
                count += 1
        for i in members:
            _look_up_one(i, asked, seers[:count], album, deepest, shown)


@kernel
def _look_up_one(i: int, asked: Asked, seers: Indices, album: Album, deepest: Floats, shown: Shown) -> None:
    """Look one point up in some pictures, `seers`."""
    points, normals = asked.points, asked.normals
    lenses, depth, colors, thickness = album.lenses, album.depth, album.colors, album.thickness
    x, y, z = points[i, 0], points[i, 1], points[i, 2]
    red = green = blue = weights = thick = trusts = 0.0
    for m in seers:
        p = album.poses[m]
        cz = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
        if cz <= 0 or cz > deepest[m]:
            continue
        cx = p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]
        cy = p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]
        u, v = lenses[m, 0] * cx / cz + lenses[m, 2], lenses[m, 1] * cy / cz + lenses[m, 3]
        height, width = album.sizes[m, 0], album.sizes[m, 1]
        if not (0 <= u < width and 0 <= v < height):
            continue
        at = album.starts[m] + int(v) * width + int(u)
        allowed = album.allowed[at]
        if not abs(depth[at] - cz) < allowed:
            continue
        # The cosine between the normal and the way back to the eye, both in the camera's frame.
        nx = p[0, 0] * normals[i, 0] + p[0, 1] * normals[i, 1] + p[0, 2] * normals[i, 2]
        ny = p[1, 0] * normals[i, 0] + p[1, 1] * normals[i, 1] + p[1, 2] * normals[i, 2]
        nz = p[2, 0] * normals[i, 0] + p[2, 1] * normals[i, 1] + p[2, 2] * normals[i, 2]
        cosine = -(nx * cx + ny * cy + nz * cz) / np.sqrt(cx * cx + cy * cy + cz * cz)
        if cosine < LEAST_COSINE:
            continue
        shown.pixel[i] = min(shown.pixel[i], cz / lenses[m, 0])
        if thickness[at] == thickness[at]:
            trust = cosine * cosine / (thickness[at] + THINNEST * cz) ** 2
            thick += trust * thickness[at]
            trusts += trust
        # Between the four pixels around, as far as they show this surface.
        left, top = int(np.floor(u - 0.5)), int(np.floor(v - 0.5))
        fu, fv = u - 0.5 - left, v - 0.5 - top
        weight = cosine * cosine / cz**4
        for q in range(4):
            column, row = left + (q & 1), top + (q >> 1)
            share = (fu if q & 1 else 1 - fu) * (fv if q >> 1 else 1 - fv)
            if 0 <= column < width and 0 <= row < height:
                k = album.starts[m] + row * width + column
                if abs(depth[k] - cz) < 2 * allowed:
                    red += weight * share * colors[k, 0]
                    green += weight * share * colors[k, 1]
                    blue += weight * share * colors[k, 2]
                    weights += weight * share
    if weights > 0:
        shown.colors[i, 0], shown.colors[i, 1], shown.colors[i, 2] = red / weights, green / weights, blue / weights
    if trusts > 0:
        shown.thickness[i] = thick / trusts
