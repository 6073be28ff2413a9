"""A mesh as convex parts that together enclose it, as engines need for colliders."""

import numpy as np
from numpy.typing import NDArray

from ..base.extras import needed
from .wrap import closed_around

CELLS = 1e5
"""Voxels of the closed surface that is cut into parts: the work of cutting grows with its faces."""

CONCAVITY = 0.05
"""Largest concavity of a part, in sizes of the whole: the default of CoACD."""


def convex_parts(
    vertices: NDArray[np.floating],  # (V, 3)
    faces: NDArray[np.integer],  # (F, 3)
    eyes: NDArray[np.floating] | None = None,  # (E, 3) places that stay open
    cells: float = CELLS,
    seed: int = 0,
) -> tuple[list[tuple[NDArray[np.float32], NDArray[np.int32]]], float]:
    """(vertices, faces) of convex meshes whose union holds the mesh, and the voxel of the closed surface between.

    Wei et al., Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and Tree Search, 2022, by
    coacd. Raises InputError for a mesh without extent, and without coacd or manifold3d.
    """
    coacd = needed("coacd", "a convex proxy")
    points, triangles, voxel = closed_around(vertices, faces, eyes, cells)
    coacd.set_log_level("off")
    whole = coacd.Mesh(points.astype(np.float64), triangles)
    found = coacd.run_coacd(whole, threshold=CONCAVITY, preprocess_mode="off", seed=seed)
    return [(np.asarray(corner, np.float32), np.asarray(face, np.int32)) for corner, face in found], voxel
