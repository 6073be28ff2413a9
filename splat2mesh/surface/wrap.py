"""A closed surface around a mesh: the level set of its distance, with unreachable cavities filled; and convex parts of
it, as engines need for colliders."""

import math

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Floats, Integers, Points, Vector
from ..base.errors import InputError
from ..base.extras import needed
from ..render.raycaster import RayCaster

CELLS = 2e6
"""Voxels of the grid: of 4 cm in a room of 6 x 6 x 2.6 m."""

STEP = 2
"""Voxels along an edge of the lattice on which the surface is found: every second one, and those in their middles."""

CIRCUMRADIUS = STEP * math.sqrt(5.0) / 4.0
"""Of a tetrahedron of that lattice, in voxels: at most so much is the mean of the distances that is interpolated at a
point of the mesh."""

TOLERANCE = 0.35
"""Largest displacement of the closed surface by simplification, in voxels."""

MARGIN = CIRCUMRADIUS + TOLERANCE
"""Distance of the closed surface from the mesh, in voxels, so that every point of the mesh lies inside."""

BLOCK = 4
"""Side, in voxels, of the blocks of which those far from the mesh are skipped."""

PADDING = math.ceil(MARGIN) + 1
"""Voxels around the mesh: beyond the closed surface there is one of air, so that the outside is connected."""

FARTHEST = 2 * MARGIN
"""Distance of the closed surface from the mesh, in voxels, at most: MARGIN, CIRCUMRADIUS and TOLERANCE."""


CONVEX_CELLS = 1e5
"""Voxels of the closed surface that is cut into parts: the work of cutting grows with its faces."""


def closed_around(
    vertices: NDArray[np.floating],  # (V, 3)
    faces: NDArray[np.integer],  # (F, 3)
    eyes: NDArray[np.floating] | None = None,  # (E, 3) places that stay open, where the capture stood
    cells: float = CELLS,
) -> tuple[NDArray[np.float32], NDArray[np.int32], float]:
    """Vertices (V', 3) and faces (F', 3) of a closed, oriented surface around a mesh, and the side of a voxel.

    All of the mesh lies inside, and no point of the surface is farther from it than FARTHEST voxels, except where
    hollows that can be reached neither from outside nor from an eye are filled. A thin wall becomes as thick, and what
    is narrower than that between two is closed. Raises InputError for a mesh without extent, and without manifold3d.
    """
    manifold = needed("manifold3d", "a proxy")
    voxel = _voxel_of(vertices, cells)
    low = vertices.min(axis=0).astype(np.float64) - PADDING * voxel
    size = np.ceil(np.ptp(vertices.astype(np.float64), axis=0) / voxel).astype(int) + 2 * PADDING + 1
    size += (size - 1) % STEP
    field = _distances(RayCaster(vertices, faces), low, size, voxel) - MARGIN
    labels, _ = scipy.ndimage.label(field > 0.0)
    reached = {int(labels[0, 0, 0])} | _labels_at(eyes, labels, low, voxel)
    outside = np.isin(labels, sorted(reached - {0}))
    field[~outside & (field > 0.0)] = -MARGIN
    depth = np.pad(-field, 1, constant_values=-MARGIN)  # the lattice goes on by one voxel on each side

    def at(x: float, y: float, z: float) -> float:
        return depth.item(round(x) + 1, round(y) + 1, round(z) + 1)

    whole = manifold.Manifold.level_set(at, [0.0, 0.0, 0.0, *(size - 1.0)], STEP)
    simple = whole.simplify(TOLERANCE).to_mesh()
    points = low + voxel * np.asarray(simple.vert_properties, np.float64)[:, :3]
    return points.astype(np.float32), np.asarray(simple.tri_verts).astype(np.int32), voxel


def convex_parts(
    vertices: NDArray[np.floating],  # (V, 3)
    faces: NDArray[np.integer],  # (F, 3)
    eyes: NDArray[np.floating] | None = None,  # (E, 3) places that stay open
    cells: float = CONVEX_CELLS,
    seed: int = 0,
) -> tuple[list[tuple[NDArray[np.float32], NDArray[np.int32]]], float]:
    """(vertices, faces) of convex meshes whose union holds the mesh, and the voxel of the closed surface between.

    Wei et al., Approximate Convex Decomposition for 3D Meshes with Collision-Aware Concavity and Tree Search, 2022, by
    coacd. Raises InputError for a mesh without extent, and without coacd or manifold3d.
    """
    coacd = needed("coacd", "a convex proxy")
    points, triangles, voxel = closed_around(vertices, faces, eyes, cells=cells)
    coacd.set_log_level("off")
    whole = coacd.Mesh(points.astype(np.float64), triangles)
    found = coacd.run_coacd(whole, preprocess_mode="off", seed=seed)
    return [(np.asarray(corner, np.float32), np.asarray(face, np.int32)) for corner, face in found], voxel


def _voxel_of(vertices: Points, cells: float) -> float:
    """Side of a voxel, so that the grid around the vertices has about so many cells."""
    extent = np.ptp(vertices.astype(np.float64), axis=0)
    longest = extent.max() if len(vertices) else 0.0
    if not longest > 0.0:
        raise InputError("a proxy: expected a mesh with an extent, found one point")
    low, high = longest / cells, longest
    for _ in range(60):  # the number of cells falls as voxels grow
        middle = np.sqrt(low * high)
        low, high = (middle, high) if np.prod(extent / middle + 2 * PADDING + 1) > cells else (low, middle)
    return float(high)


def _distances(caster: RayCaster, low: Vector, size: Integers, voxel: float) -> NDArray[np.float32]:
    """Distance to the mesh in voxels, float32 of a shape; BLOCK where it is more than about that."""
    field = np.full(size, BLOCK, np.float32)
    blocks = np.indices(tuple(-(-size // BLOCK))).reshape(3, -1).T
    middles = low + voxel * (blocks * BLOCK + (BLOCK - 1) / 2)
    reach = voxel * (np.sqrt(3) * (BLOCK - 1) / 2 + 2 * MARGIN)
    steps = np.indices((BLOCK,) * 3).reshape(3, -1).T
    near = blocks[_distance(caster, middles) < reach]
    for part in np.array_split(near, max(1, len(near) // 20_000)):
        places = (part[:, None] * BLOCK + steps).reshape(-1, 3)
        places = places[(places < size).all(axis=1)]
        field[tuple(places.T)] = np.minimum(_distance(caster, low + voxel * places) / voxel, BLOCK)
    return field


def _distance(caster: RayCaster, points: Points) -> Floats:
    return np.linalg.norm(caster.closest(points).points - points, axis=1)


def _labels_at(eyes: Points | None, labels: Integers, low: Vector, voxel: float) -> set[int]:
    """The labels of the voxels around places, 0 in a wall."""
    if eyes is None or not len(eyes):
        return set()
    places = np.round((np.asarray(eyes, np.float64).reshape(-1, 3) - low) / voxel).astype(int)
    places = places[((places >= 0) & (places < labels.shape)).all(axis=1)]
    return set(labels[tuple(places.T)].tolist())
