"""Oriented surface points of a splat, by SuGaR's method: where rays of rendered views cross a level of the density
field.

Source: Guedon and Lepetit, "SuGaR: Surface-Aligned Gaussian Splatting" (CVPR 2024), section 4.2, without its training.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy

from ..base.arrays import Directions, Floats, Integers, Points
from ..base.errors import InputError
from ..base.meshlibrary import open3d
from ..base.threads import in_batches
from ..render.rasterize import Rendering
from ..render.view import View
from ..splats.splats import REACH, Splats
from .volume import NEIGHBORS

DENSITY_LEVEL = 0.3
"""Density at which the surface lies: SuGaR's value."""

STEPS = 21
"""Samples of the density in that range."""


TRIM_DENSITY = 3.0
"""Octree levels by which a vertex's sampling density may lie below the median before it counts as invented."""


@dataclass(frozen=True)
class SurfacePoints:
    """Points on a surface. points: (P, 3) float32. normals: (P, 3) float32, unit, towards the side that was seen."""

    points: np.ndarray
    normals: np.ndarray


class DensityField:
    """The density of a splat: the sum of opacity * exp(-mahalanobis^2 / 2) over the nearest Gaussians of a point."""

    def __init__(self, splats: Splats) -> None:
        self._origin = splats.means.mean(axis=0, dtype=np.float64)
        means = (splats.means - self._origin).astype(np.float32)
        scales = np.maximum(splats.scales, splats.scales.max(axis=1, keepdims=True) * 1e-3).astype(np.float32)
        self._forms = splats.rotation_matrices().swapaxes(1, 2) / scales[:, :, None]  # a Gaussian becomes a unit ball
        self._means, self._scales, self._opacities = means, scales, splats.opacities
        self._tree = scipy.spatial.cKDTree(means)

    def crossings(self, points: Points, directions: Directions) -> SurfacePoints:
        """First entries of rays into the level set near given points.

        points: (P, 3), on the rays, at the rendered depth. directions: (P, 3) unit, away from the eye.
        Returns SurfacePoints of the rays that enter it within REACH; normals are those of the field's gradient.
        """
        local, ahead = (points - self._origin).astype(np.float32), directions.astype(np.float32)
        count = min(NEIGHBORS, self._tree.n)
        neighbors = self._tree.query(local, count, workers=-1)[1].reshape(len(local), count)
        offset, normal = np.full(len(local), np.nan, np.float32), np.zeros((len(local), 3), np.float32)

        def enter(rows: slice) -> None:
            offset[rows], normal[rows] = self._entered(local[rows], ahead[rows], neighbors[rows])

        in_batches(enter, len(local))
        found = np.isfinite(offset)
        surface = points[found] + offset[found, None] * directions[found]
        return SurfacePoints(surface.astype(np.float32), normal[found])

    def _entered(self, points: Points, directions: Directions, neighbors: Integers) -> tuple[Floats, Floats]:
        """Offsets (P,) at which rays enter the level, NaN where they do not, and normals (P, 3) there. neighbors: (P,
        k) Gaussians that count."""
        forms, opacities = self._forms[neighbors], self._opacities[neighbors]
        # Along a ray the distance from a Gaussian, in its standard deviations, squared, is a parabola.
        start = np.einsum("nkij,nkj->nki", forms, points[:, None] - self._means[neighbors])
        slope = np.einsum("nkij,nj->nki", forms, directions)
        square, linear, constant = ((a * b).sum(axis=2) for a, b in ((slope, slope), (start, slope), (start, start)))
        nearest = slope[:, 0] * self._scales[neighbors[:, 0]] ** 2
        steps = REACH * np.linalg.norm(nearest, axis=1)[:, None] * np.linspace(-1.0, 1.0, STEPS, dtype=np.float32)
        density = np.stack(
            [
                (opacities * np.exp(-0.5 * ((square * t + 2 * linear) * t + constant))).sum(axis=1)
                for t in steps.T[:, :, None]
            ],
            axis=1,
        )
        entries = (density[:, :-1] < DENSITY_LEVEL) & (density[:, 1:] >= DENSITY_LEVEL)
        rows, at = np.arange(len(points)), entries.argmax(axis=1)
        before, after = density[rows, at], density[rows, at + 1]
        with np.errstate(all="ignore"):  # of rays that do not enter
            share = (DENSITY_LEVEL - before) / (after - before)
            offset = steps[rows, at] + share * (steps[rows, at + 1] - steps[rows, at])
            place = start + offset[:, None, None] * slope
            weight = opacities * np.exp(-0.5 * (place * place).sum(axis=2))
            outward = np.einsum("nk,nkij,nki->nj", weight, forms, place)
            outward *= -np.sign((outward * directions).sum(axis=1, keepdims=True))
            outward /= np.linalg.norm(outward, axis=1, keepdims=True)
        return np.where(entries.any(axis=1) & np.isfinite(outward[:, 0]), offset, np.nan), outward


def surface_points(field: DensityField, view: View, rendering: Rendering, stride: int = 1) -> SurfacePoints:
    """Surface points of one rendered view. stride: take every so many pixels in both directions."""
    depth = rendering.depth_median[stride // 2 :: stride, stride // 2 :: stride]
    solid = np.isfinite(depth) & (rendering.alpha[stride // 2 :: stride, stride // 2 :: stride] > 0.5)
    rays = view.ray_directions()[stride // 2 :: stride, stride // 2 :: stride][solid]
    length = np.linalg.norm(rays, axis=1, keepdims=True)
    return field.crossings(view.center + rays * depth[solid, None], rays / length)


def poisson(surface: SurfacePoints, depth: int) -> Any:
    """Screened Poisson surface of SurfacePoints, without the parts that no point supports.

    depth: levels of the octree. Returns an open3d TriangleMesh. Raises InputError when the points make no surface.
    Source: Kazhdan and Hoppe, "Screened Poisson Surface Reconstruction" (2013).
    """
    o3d = open3d()

    if len(surface.points) == 0:
        raise InputError("no surface points were found: is this a splat of a solid object?")
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(surface.points.astype(np.float64)))
    cloud.normals = o3d.utility.Vector3dVector(surface.normals.astype(np.float64))
    # One thread: several sum in any order, and the surface differs from run to run.
    mesh, density = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(cloud, depth=depth, n_threads=1)
    density = np.asarray(density)
    if len(density) == 0:
        raise InputError(f"{len(surface.points)} surface points make no surface: is this a splat of a solid object?")
    mesh.remove_vertices_by_mask(density < np.median(density) - TRIM_DENSITY)
    return mesh
