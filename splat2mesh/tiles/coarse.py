"""Coarse twins of a tile: its occluder for the light of other tiles, and its display mesh from afar.

Quadric decimation keeps the walls of houses best. It leaves trees as thousands of pieces, which it can neither join nor
drop; merging the vertices of a cell keeps their shade. So what decimation cannot make small is merged.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Indices
from ..base.cells import CELLS, keys_of
from ..options import LEAST_VERTICES
from ..scene.mesh import Mesh, vertex_normals
from ..surface.decimate import decimate

TOTAL = 120_000
"""Vertices of the coarse city, which every worker holds, of all tiles together."""

FEW, SHARE = 1_500, 0.06
"""Vertices of the twin that tiles not far away see: as many as of the coarse city, but no more than a share of its own
and no fewer than a few. A tile of fewer is its own twin."""

ALLOWED = 1.25
"""Vertices of a twin, over those wanted, from which decimation counts as failed."""


def twins(mesh: Mesh, tiles: int) -> tuple[Mesh, Mesh | None]:
    """Vertices of a tile's twins in a city of so many tiles: for near tiles, and for the whole city, where that is
    less."""
    most = max(LEAST_VERTICES, TOTAL // max(tiles, 1))
    far = coarse(mesh, max(FEW, min(most, round(SHARE * len(mesh.vertices)))))
    return far, None if len(far.vertices) <= ALLOWED * most else coarse(far, most)


def coarse(mesh: Mesh, wanted: int) -> Mesh:
    """A Mesh of about so many vertices with the occlusion of the mesh, and the colours of the nearest vertices."""
    if len(mesh.vertices) <= wanted:
        return mesh
    points, faces = decimate(mesh.vertices.astype(np.float64), mesh.faces, wanted)
    if not 0 < len(points) <= ALLOWED * wanted:
        points, faces = merged_in_cells(mesh.vertices.astype(np.float64), mesh.faces, wanted)
    if not len(faces):
        return mesh
    nearest = scipy.spatial.cKDTree(mesh.vertices).query(points)[1]
    normals = vertex_normals(points, faces)
    return Mesh(points.astype(np.float32), normals, faces.astype(np.int32), mesh.colors_srgb[nearest])


def merged_in_cells(
    points: NDArray,  # (V, 3) float64
    faces: NDArray,  # (F, 3) integers
    wanted: int,  # vertices at most
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """A mesh in which all vertices within a cell of a grid are one, their mean; the grid is the finest that serves.

    Faces within two cells go, and of those with the same corners all but the first.
    Source: Rossignac, Borrel, "Multi-resolution 3D approximations for rendering complex scenes", 1993.
    """
    low = points.min(axis=0)
    longest = 1.001 * float(np.ptp(points, axis=0).max()) or 1.0
    few, many = 1, CELLS // 2  # cells along the longest side

    def cells(along: int) -> Indices:
        return keys_of(np.floor((points - low) / (longest / along)))

    while many - few > 1:
        middle = (few + many) // 2
        if len(np.unique(cells(middle))) > wanted:
            many = middle
        else:
            few = middle
    _, cell = np.unique(cells(few), return_inverse=True)
    held = np.bincount(cell)
    means = np.stack([np.bincount(cell, points[:, axis]) / held for axis in range(3)], axis=1)
    corners = np.sort(cell[faces], axis=1)
    rows = np.flatnonzero((corners[:, 0] < corners[:, 1]) & (corners[:, 1] < corners[:, 2]))
    key = (corners[rows, 0] * len(held) + corners[rows, 1]) * len(held) + corners[rows, 2]
    first = rows[np.sort(np.unique(key, return_index=True)[1])]
    used, kept = np.unique(cell[faces[first]], return_inverse=True)
    return means[used], kept.reshape(-1, 3).astype(np.int32)
