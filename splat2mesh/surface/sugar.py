"""Oriented surface points of a splat, by SuGaR's method: where rays of rendered views cross a level of the density
field.

Source: Guedon and Lepetit, "SuGaR: Surface-Aligned Gaussian Splatting" (CVPR 2024), section 4.2, without its training.
"""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from ..base.arrays import Directions, Floats, Integers, Points
from ..base.errors import InputError
from ..base.kernels import kernel
from ..base.meshlibrary import open3d
from ..base.threads import shared
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


class DensityGaussians(NamedTuple):
    """What makes up a density: means (N, 3), rotations (N, 3, 3), scales (N, 3) and opacities (N,), float32."""

    means: Points
    rotations: Floats
    scales: Floats
    opacities: Floats


class DensityField:
    """The density of a splat: the sum of opacity * exp(-mahalanobis^2 / 2) over the nearest Gaussians of a point."""

    def __init__(self, splats: Splats) -> None:
        self._origin = splats.means.mean(axis=0, dtype=np.float64)
        means = (splats.means - self._origin).astype(np.float32)
        scales = np.maximum(splats.scales, splats.scales.max(axis=1, keepdims=True) * 1e-3).astype(np.float32)
        self._gaussians = DensityGaussians(means, splats.rotation_matrices(), scales, splats.opacities)
        self._tree = scipy.spatial.cKDTree(means)

    def crossings(self, points: Points, directions: Directions) -> SurfacePoints:
        """First entries of rays into the level set near given points.

        points: (P, 3), on the rays, at the rendered depth. directions: (P, 3) unit, away from the eye.
        Returns SurfacePoints of the rays that enter it within REACH; normals are those of the field's gradient.
        """
        local = (points - self._origin).astype(np.float32, order="C")
        count = min(NEIGHBORS, self._tree.n)
        neighbors = self._tree.query(local, k=count, workers=-1)[1].reshape(len(local), count).astype(np.int32)
        offset, normal = np.full(len(local), np.nan, np.float32), np.zeros((len(local), 3), np.float32)
        ahead = directions.astype(np.float32, order="C")
        _enter_level(len(local), local, ahead, neighbors, self._gaussians, offset, normal)
        found = np.isfinite(offset)
        surface = points[found] + offset[found, None] * directions[found]
        return SurfacePoints(surface.astype(np.float32), normal[found])


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


@kernel
def _density(
    x: float, y: float, z: float, p: int, neighbors: Integers, gaussians: DensityGaussians
) -> tuple[float, float, float, float]:
    """Density at a point, of its row p of `neighbors`, and the gradient there: four numbers."""
    means, rotations, scales, opacities = gaussians
    total, right, up, back = 0.0, 0.0, 0.0, 0.0
    for i in range(neighbors.shape[1]):
        n = neighbors[p, i]
        dx, dy, dz = x - means[n, 0], y - means[n, 1], z - means[n, 2]
        exponent, gx, gy, gz = 0.0, 0.0, 0.0, 0.0
        for axis in range(3):
            along = rotations[n, 0, axis] * dx + rotations[n, 1, axis] * dy + rotations[n, 2, axis] * dz
            scaled = along / (scales[n, axis] * scales[n, axis])
            exponent += along * scaled
            gx += rotations[n, 0, axis] * scaled
            gy += rotations[n, 1, axis] * scaled
            gz += rotations[n, 2, axis] * scaled
        value = opacities[n] * math.exp(-0.5 * exponent)
        total += value
        right -= value * gx
        up -= value * gy
        back -= value * gz
    return total, right, up, back


@shared
@kernel
def _enter_level(
    begin: int,
    end: int,
    points: Points,
    directions: Directions,
    neighbors: Integers,
    gaussians: DensityGaussians,
    offsets: Floats,
    normals: Directions,
) -> None:
    """Offsets (P,) along the directions, left as they are where no level is entered, and normals (P, 3)."""
    rotations, scales = gaussians.rotations, gaussians.scales
    for p in range(begin, end):
        dx, dy, dz = directions[p, 0], directions[p, 1], directions[p, 2]
        n = neighbors[p, 0]
        variance = 0.0
        for axis in range(3):
            turned = rotations[n, 0, axis] * dx + rotations[n, 1, axis] * dy + rotations[n, 2, axis] * dz
            variance += (turned * scales[n, axis]) ** 2
        reach = REACH * math.sqrt(variance)
        before = math.inf
        for step in range(STEPS):
            t = reach * (2.0 * step / (STEPS - 1) - 1.0)
            x, y, z = points[p, 0] + t * dx, points[p, 1] + t * dy, points[p, 2] + t * dz
            density, gx, gy, gz = _density(x, y, z, p, neighbors, gaussians)
            if before < DENSITY_LEVEL <= density:
                t -= 2.0 * reach / (STEPS - 1) * (density - DENSITY_LEVEL) / (density - before)
                x, y, z = points[p, 0] + t * dx, points[p, 1] + t * dy, points[p, 2] + t * dz
                _, gx, gy, gz = _density(x, y, z, p, neighbors, gaussians)
                norm = math.sqrt(gx * gx + gy * gy + gz * gz)
                if norm > 0.0:
                    offsets[p] = t
                    side = 1.0 if gx * dx + gy * dy + gz * dz >= 0.0 else -1.0
                    nx, ny, nz = -side * gx / norm, -side * gy / norm, -side * gz / norm
                    normals[p, 0], normals[p, 1], normals[p, 2] = nx, ny, nz
                break
            before = density
