"""The raw surface of a tile and its ring on the lattice of the whole city, equal to the bit in all tiles that hold it.

A cell's vertex depends on the cells around it and on the views that show them. All tiles read the same views, in the
same order, and find the same cells; so on either side of a border the surface comes out the same.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices, Mask
from ..base.distinct import distinct
from ..scene.mesh import edge_ends, edge_keys
from ..surface.adaptive import BATCH, ENOUGH_WEIGHT, integrate, packed
from ..surface.dualmesh import dual_mesh
from ..surface.octree import BITS, HALF, MASK, corners_of, leaves_of, requested_cells
from ..surface.sight import FusionSight, Truncation
from .memory import give_back
from .plan import CARVE, CELL_LEVELS, RING, CityPlan

MOST_CELLS = 24_000_000
"""Most cells of a tile: a table of 400 MB."""

SMOOTHING_ROUNDS, SMOOTHING_STEP = 2, 0.5
"""Rounds in which vertices on borders move towards the mean of their neighbours, and how far."""


class Raw(NamedTuple):
    """The surface of a tile and its ring. V vertices, F faces. points: (V, 3) float64. faces: (F, 3) int32. cells: (V,)
    side of each vertex's cell. owner: (F,) tile of each face, -1 for none."""

    points: NDArray[np.float64]
    faces: NDArray[np.int32]
    cells: Floats
    owner: NDArray[np.int64]


def raw_surface(sights: list[FusionSight], plan: CityPlan, tile: int) -> Raw:
    """Fuse sights within the core of a tile and RING blocks around it. Vertices stand in the order of their cells. The
    list of sights is empty afterwards, since their data are a large part of a process's memory."""
    empty = Raw(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0), np.zeros(0, np.int64))
    sights[:] = [sight for sight in sights if (sight.weight > 0).any()]
    if not sights:
        return empty
    origin = np.zeros(3)
    steps = (sight.step for sight in sights)
    truncation = Truncation(plan.finest, carve=CARVE * plan.block)
    requested = requested_cells(sights, steps, origin, truncation, MOST_CELLS)
    maps = packed(sights, origin)
    sights.clear()
    give_back()
    if requested is None:
        raise MemoryError(f"more than {MOST_CELLS:,} cells in one tile: lower `memory` for smaller tiles")
    requested = requested[_within(requested, plan.tiles[tile])]
    if not len(requested):
        return empty
    leaves = leaves_of(requested)
    del requested
    give_back()
    corners = corners_of(leaves)
    values, weights = np.zeros(len(corners.positions), np.float32), np.zeros(len(corners.positions), np.float32)
    dealt = np.random.default_rng(0).permutation(-(-len(values) // BATCH))
    integrate(len(dealt), corners, dealt, truncation, maps, values, weights)
    del maps
    vertices, faces, levels = dual_mesh(leaves, corners, values, weights, ENOUGH_WEIGHT)
    points = vertices * plan.finest
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    return Raw(points, faces, plan.finest * 2.0**levels, plan.owner_of(((a + b + c) / 3)[:, [0, 2]]))


def _within(keys: Indices, rectangle: list[int]) -> Mask:
    """Which cells lie in a rectangle of blocks grown by the ring."""
    level = keys >> (3 * BITS)
    x, z = ((keys >> (2 * BITS)) & MASK) - HALF, (keys & MASK) - HALF
    block_x, block_z = x >> (CELL_LEVELS - level), z >> (CELL_LEVELS - level)
    x0, z0, x1, z1 = rectangle
    return (block_x >= x0 - RING) & (block_x < x1 + RING) & (block_z >= z0 - RING) & (block_z < z1 + RING)


def seam_of(raw: Raw, tile: int) -> NDArray[np.bool_]:
    """(V,) bool: the vertices between faces of a tile and faces of others."""
    mine, theirs = (np.zeros(len(raw.points), bool) for _ in range(2))
    mine[raw.faces[raw.owner == tile]] = True
    theirs[raw.faces[(raw.owner != tile) & (raw.owner >= 0)]] = True
    return mine & theirs


def smoothed(raw: Raw) -> NDArray[np.float64]:
    """(V, 3) points, each some way to the mean of its neighbours; those on open borders stay. Sums go in the order of
    vertices, which is that of their cells: so they are equal in all tiles that hold them."""
    keys, uses = np.unique(edge_keys(raw.faces, len(raw.points)), return_counts=True)
    first, second = edge_ends(keys, len(raw.points)).T
    open_ = np.zeros(len(raw.points), bool)
    open_[first[uses == 1]] = open_[second[uses == 1]] = True
    here, there = np.concatenate([first, second]), np.concatenate([second, first])
    count = np.bincount(here, minlength=len(raw.points))
    moving = np.asarray(~open_ & (count > 0))[:, None]
    points = raw.points
    for _ in range(SMOOTHING_ROUNDS):
        sums = np.stack([np.bincount(here, points[there, axis], len(points)) for axis in range(3)], axis=1)
        mean = sums / np.maximum(count, 1)[:, None]
        points = np.where(moving, points + SMOOTHING_STEP * (mean - points), points)
    return points


def seam_edges(raw: Raw, tile: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The edges at which a face of a tile meets one of another: (E, 2) vertices, smaller first, and (E,) the other."""
    count, seam = len(raw.points), seam_of(raw, tile)
    near = np.flatnonzero(seam[raw.faces] & seam[np.roll(raw.faces, -1, axis=1)])
    key, owner = edge_keys(raw.faces, count).ravel()[near], raw.owner[near // 3]
    mine = distinct(key[owner == tile])
    shared = np.searchsorted(mine, key, side="right") > np.searchsorted(mine, key)
    other = (owner != tile) & (owner >= 0) & shared
    pairs = np.unique(np.stack([key[other], owner[other]], axis=1), axis=0)
    return edge_ends(pairs[:, 0], count), pairs[:, 1]
