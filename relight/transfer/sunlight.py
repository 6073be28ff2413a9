"""Light from single directions with hard shadows: one ray for every vertex and every sun above its horizon."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_slices

from ..light.suns import Suns
from .neighbors import along_curve
from .occluder import BATCH_RAYS, Occluder


def sunlight(
    occluder: Occluder,
    rows: slice | Indices,  # slice or (V,) indices into the occluder's vertices
    suns: Suns,
    advance: Advance = lambda count: None,  # called with the number of vertices done
) -> NDArray[np.float32]:
    """Exit radiance of white vertices under suns alone: (V, 3) float32, sum of weight / pi max(0, n d) visible.

    Exact up to float32: a ray is traced wherever n d > 0; surfaces that face away take none. Rays begin at the
    occluder's origins, off the surface. A vertex's own faces count like any others: they hide a sun that the
    vertex normal sees and a face that rises above the normal's plane does not, as in `raytraced`.
    A vertex's row depends on its position, its normal, the suns in their order and the occluder alone: its sum runs
    over the suns as they stand, in float64. Raises InputError for directions that are not unit vectors.
    """
    origins, normals = occluder.origins[rows], occluder.normals[rows]
    directions, weights = shining(suns)
    order = along_curve(origins)
    origins, normals = origins[order], normals[order]
    ordered = np.zeros((len(origins), 3), np.float32)
    batch = max(1, BATCH_RAYS // max(1, len(directions)))
    for start in range(0, len(origins), batch):
        part = slice(start, start + batch)
        count = len(normals[part])
        ends = np.zeros(count + 1, np.int64)
        in_slices(_count, count, normals[part], directions, ends)
        np.cumsum(ends, out=ends)
        rays = np.zeros((ends[-1], 6), np.float32)
        sun = np.zeros(ends[-1], np.int32)
        in_slices(_aim, count, origins[part], normals[part], directions, ends, rays, sun)
        if len(rays):
            hidden = occluder.occluded(rays)
            in_slices(_sum, count, normals[part], weights, ends, rays, sun, hidden, ordered[part])
        advance(count)
    radiance = np.empty_like(ordered)
    radiance[order] = ordered
    return radiance


def shining(suns: Suns) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
    """Directions (S, 3) float32 and weights / pi (S, 3) float64 of the suns that shine at all.

    Raises InputError for directions that are not unit vectors.
    """
    lit = (suns.weights > 0.0).any(axis=1)
    directions = np.ascontiguousarray(suns.directions[lit], np.float32)
    length = np.linalg.norm(directions, axis=1)
    if not (np.abs(length - 1.0) < 1e-5).all():
        found = length[~(np.abs(length - 1.0) < 1e-5)][0]
        raise InputError(f"directions of suns must be unit vectors, found one of length {found}")
    return directions, np.ascontiguousarray(suns.weights[lit] / np.pi, np.float64)


@kernel
def _count(
    begin: int, end: int, normals: NDArray[np.float32], directions: NDArray[np.float32], ends: NDArray[np.int64]
) -> None:
    """Number of suns before each vertex v, into ends[v + 1]."""
    for v in range(begin, end):
        nx, ny, nz = normals[v]
        before = 0
        for s in range(len(directions)):
            before += nx * directions[s, 0] + ny * directions[s, 1] + nz * directions[s, 2] > np.float32(0)
        ends[v + 1] = before


@kernel
def _aim(
    begin: int,
    end: int,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    directions: NDArray[np.float32],
    ends: NDArray[np.int64],
    rays: NDArray[np.float32],
    sun: NDArray[np.int32],
) -> None:
    for v in range(begin, end):
        nx, ny, nz = normals[v]
        ray = ends[v]
        for s in range(len(directions)):
            dx, dy, dz = directions[s]
            if nx * dx + ny * dy + nz * dz > np.float32(0):
                rays[ray, 0], rays[ray, 1], rays[ray, 2] = origins[v]
                rays[ray, 3], rays[ray, 4], rays[ray, 5] = dx, dy, dz
                sun[ray] = s
                ray += 1


@kernel
def _sum(
    begin: int,
    end: int,
    normals: NDArray[np.float32],
    weights: NDArray[np.float64],
    ends: NDArray[np.int64],
    rays: NDArray[np.float32],
    sun: NDArray[np.int32],
    hidden: Mask,
    radiance: NDArray[np.float32],
) -> None:
    for v in range(begin, end):
        nx, ny, nz = normals[v]
        red, green, blue = 0.0, 0.0, 0.0
        for ray in range(ends[v], ends[v + 1]):
            if not hidden[ray]:
                cosine = np.float64(nx * rays[ray, 3] + ny * rays[ray, 4] + nz * rays[ray, 5])
                red += weights[sun[ray], 0] * cosine
                green += weights[sun[ray], 1] * cosine
                blue += weights[sun[ray], 2] * cosine
        radiance[v, 0], radiance[v, 1], radiance[v, 2] = red, green, blue
