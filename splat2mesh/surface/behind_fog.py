"""Vertices moved from a fog of Gaussians towards the surface behind it.

Training leaves Gaussians before a surface, the more the less texture it has, so the level at which depth maps are least
noisy lies before it. At a later level depth is noisy, and so are normals, by which a relit room loses half a dB. So
normals, planes and colours are those of the early level, and vertices move at the end, by a field that is smooth over
as much as the fog is thick. In thick fog they move no further: it is what is seen there, and what is lit.
"""

import numpy as np
import scipy

from ..base.arrays import Directions, Faces, Floats, Points
from .fair import edge_uses, solved

SHARE = 0.75
"""Of the thickness: how far the surface lies behind the level of the depth maps (`scripts/fit fog`, on a trained
garden, a trained room and a generated one: their least gain is largest by it)."""


def behind_fog(
    points: Points,  # (V, 3)
    normals: Directions,  # (V, 3)
    faces: Faces,  # (F, 3)
    thickness: Floats,  # (V,) of the surface there, infinite where it is unseen, which moves nothing
    most: float,  # thickness that counts at most
    fog: float,  # length over which moves are smooth
) -> Points:
    """Points moved against their normals by a SHARE of the thickness, all in one unit.

    The field is that of Helmholtz's equation on the graph of the edges: the moves that are wanted are it, less the
    square of the length times its Laplacian.
    """
    edges = edge_uses(faces, len(points))
    edges.data[:] = 1
    rings = np.maximum(np.diff(edges.indptr), 1).astype(np.float64)
    edge = np.median(np.linalg.norm(np.subtract(*points[faces[:, :2].T].astype(np.float64)), axis=1))
    reach = (fog / max(edge, 1e-300)) ** 2
    depth = np.where(np.isfinite(thickness), np.minimum(thickness, most), 0.0)
    wanted = (SHARE * rings * depth)[:, None] * normals.astype(np.float64)
    moves = solved((scipy.sparse.diags_array((1 + reach) * rings) - reach * edges).tocsr(), wanted)
    return (points - moves).astype(points.dtype)
