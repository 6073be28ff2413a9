"""Light from single directions with hard shadows: one ray for every vertex and every sun above its horizon."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Advance

from ..light.environment import Suns
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
    vertex normal sees and a face that rises above the normal's plane does not, as in `raytraced_scene`.
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
        cosine = cosines(normals[part], directions)
        vertex, sun = np.nonzero(cosine > 0.0)
        if len(vertex):
            rays = np.concatenate([origins[part].take(vertex, axis=0), directions.take(sun, axis=0)], axis=1)
            hidden = occluder.occluded(rays)
            cosine[vertex[hidden], sun[hidden]] = 0.0
            ordered[part] = np.einsum("vs,sc->vc", cosine.astype(np.float64), weights)
        advance(len(cosine))
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


def cosines(normals: NDArray[np.float32], directions: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of the angles between normals (V, 3) and suns (S, 3), (V, S), 0 for suns behind."""
    found = normals[:, 0, None] * directions[:, 0]
    for axis in (1, 2):
        found += normals[:, axis, None] * directions[:, axis]
    return np.maximum(found, np.float32(0.0), out=found)
