"""The pictures of a place, all in one, and what they tell of points on its surface: colour, thickness, pixel.

As `color` does for objects; but how near a point must lie to the rendered surface goes by its distance and by how thick
that surface is, and who looked from near counts far more than who looked from afar.
"""

from dataclasses import dataclass

import numba
import numpy as np
from scipy.spatial import cKDTree

from ..scene.color import bytes_from_unit

TOLERANCE = 0.02
"""How far from the rendered depth a point may lie and still count as seen, in units of that depth."""

LEAST_COSINE = 0.05
"""Cosine of the angle at which a point must at least be seen."""

THINNEST = 0.002
"""Thickness, in units of the distance, below which no picture is trusted more for seeing a thinner surface."""

GREY = 127.5
"""Colour where nobody looked at all."""


@dataclass(frozen=True)
class Album:
    """M pictures of P pixels in all, one after the other, row by row.

    poses: (M, 3, 4) float64 camera_from_world. lenses: (M, 4) float64 fx, fy, cx, cy. sizes: (M, 2) int64 height and
    width. starts: (M,) int64 first pixel of each. colors: (P, 3) uint8 sRGB. depth: (P,) float32 camera z, NaN where
    empty. spread: (P,) float32 along z, thickness: (P,) float32 along the normal, world units.
    """

    poses: np.ndarray
    lenses: np.ndarray
    sizes: np.ndarray
    starts: np.ndarray
    colors: np.ndarray
    depth: np.ndarray
    spread: np.ndarray
    thickness: np.ndarray

    @classmethod
    def of(cls, views, seen, thickness):
        """From lists of View, of what each sees (FieldDepth), and of the thickness (H, W) there."""
        sizes = np.array([[view.height, view.width] for view in views])
        return cls(
            np.array([view.camera_from_world[:3] for view in views]),
            np.array([[view.fx, view.fy, view.cx, view.cy] for view in views], float),
            sizes,
            np.concatenate([[0], sizes.prod(axis=1).cumsum()[:-1]]),
            np.concatenate([bytes_from_unit(each.color).reshape(-1, 3) for each in seen]),
            np.concatenate([each.depth.ravel() for each in seen]),
            np.concatenate([each.spread.ravel() for each in seen]),
            np.concatenate([each.ravel().astype(np.float32) for each in thickness]),
        )

    @classmethod
    def of_pictures(cls, pictures):
        """From a list of color.Picture; how deep a surface reaches is taken from its thickness."""
        sizes = np.array([picture.depth.shape for picture in pictures])
        thickness = np.concatenate([picture.thickness.ravel() for picture in pictures])
        return cls(
            np.array([picture.view.camera_from_world[:3] for picture in pictures]),
            np.array([[p.view.fx, p.view.fy, p.view.cx, p.view.cy] for p in pictures], float),
            sizes,
            np.concatenate([[0], sizes.prod(axis=1).cumsum()[:-1]]),
            np.concatenate([picture.color.reshape(-1, 3) for picture in pictures]),
            np.concatenate([picture.depth.ravel() for picture in pictures]),
            thickness,
            thickness,
        )

    def look_up(self, points, normals):
        """What the pictures show at points (N, 3) with normals (N, 3), world.

        Returns colours (N, 3) float32 sRGB in [0, 255], the mean weighted by cosine^2 / z^4, NaN where no picture
        sees the point; thickness (N,) float32 in world units, inf there; and the size of the smallest pixel that saw it
        (N,) float32, world units, inf there.
        """
        colors = np.full((len(points), 3), np.nan, np.float32)
        thickness, pixel = np.full(len(points), np.inf, np.float32), np.full(len(points), np.inf, np.float32)
        arrays = self.poses, self.lenses, self.sizes, self.starts, self.colors, self.depth, self.spread, self.thickness
        points, normals = points.astype(np.float64), normals.astype(np.float64)
        _look_up(points, normals, *arrays, self._deepest(), colors, thickness, pixel)
        return colors, thickness, pixel

    def _deepest(self):
        """(M,) float64, z behind which no point shows in each picture."""
        behind = self.depth + np.maximum(TOLERANCE * self.depth.astype(np.float64), self.spread)
        return np.maximum.reduceat(np.nan_to_num(behind, nan=0.0), self.starts) * (1 + 1e-9)


def filled_in(colors, points):
    """Colours (N, 3) uint8 of points (N, 3), NaN ones taken from the nearest that is none, and the number of these."""
    unseen = np.isnan(colors[:, 0])
    if unseen.all():
        colors = np.full_like(colors, GREY)
    elif unseen.any():
        nearest = cKDTree(points[~unseen]).query(points[unseen])[1]
        colors = colors.copy()
        colors[unseen] = colors[~unseen][nearest]
    return np.round(colors).astype(np.uint8), int(unseen.sum())


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _look_up(
    points,
    normals,
    poses,
    lenses,
    sizes,
    starts,
    colors,
    depth,
    spread,
    thickness,
    deepest,
    out_color,
    out_thickness,
    out_pixel,
):
    for i in numba.prange(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        red = green = blue = weights = thick = trusts = 0.0
        for m in range(len(poses)):
            p = poses[m]
            cz = p[2, 0] * x + p[2, 1] * y + p[2, 2] * z + p[2, 3]
            if cz <= 0 or cz > deepest[m]:
                continue
            cx = p[0, 0] * x + p[0, 1] * y + p[0, 2] * z + p[0, 3]
            cy = p[1, 0] * x + p[1, 1] * y + p[1, 2] * z + p[1, 3]
            u, v = lenses[m, 0] * cx / cz + lenses[m, 2], lenses[m, 1] * cy / cz + lenses[m, 3]
            height, width = sizes[m, 0], sizes[m, 1]
            if not (0 <= u < width and 0 <= v < height):
                continue
            at = starts[m] + int(v) * width + int(u)
            allowed = max(TOLERANCE * depth[at], spread[at])
            if not abs(depth[at] - cz) < allowed:
                continue
            # The cosine between the normal and the way back to the eye, both in the camera's frame.
            nx = p[0, 0] * normals[i, 0] + p[0, 1] * normals[i, 1] + p[0, 2] * normals[i, 2]
            ny = p[1, 0] * normals[i, 0] + p[1, 1] * normals[i, 1] + p[1, 2] * normals[i, 2]
            nz = p[2, 0] * normals[i, 0] + p[2, 1] * normals[i, 1] + p[2, 2] * normals[i, 2]
            cosine = -(nx * cx + ny * cy + nz * cz) / np.sqrt(cx * cx + cy * cy + cz * cz)
            if cosine < LEAST_COSINE:
                continue
            out_pixel[i] = min(out_pixel[i], cz / lenses[m, 0])
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
                    k = starts[m] + row * width + column
                    if abs(depth[k] - cz) < 2 * allowed:
                        red += weight * share * colors[k, 0]
                        green += weight * share * colors[k, 1]
                        blue += weight * share * colors[k, 2]
                        weights += weight * share
        if weights > 0:
            out_color[i, 0], out_color[i, 1], out_color[i, 2] = red / weights, green / weights, blue / weights
        if trusts > 0:
            out_thickness[i] = thick / trusts
