"""Cells of a surface, each as large as the pixels that saw it: the leaves of a sparse octree.

A cell of level l has the side finest * 2^l. Surfaces near the eyes get small cells, distant ones large cells,
and there are no cells where no view saw a surface. Keys pack a level and three whole coordinates, in units of the cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Indices, Integers, Vector
from ..base.distinct import distinct
from ..base.kernels import kernel
from ..splats.zorder import bits_apart
from .sight import FusionSight, Truncation

BITS = 19
"""Of each coordinate in a key; the level has what is left of 63."""

HALF = 1 << (BITS - 1)
MASK = (1 << BITS) - 1
OCTREE_LEVELS = 16
"""Levels at most: from a millimetre to 30 m."""

EMPTY = -1

RECENT = 1 << 13
"""Slots of a small table of cells that a view asked for last: pixels side by side ask for the same, and it stays in the
processor's cache, as that of all requested cells does not. That one begins as small and doubles as they become more."""


@kernel
def pack(level: int, x: int, y: int, z: int) -> np.int64:
    """The key of a cell; coordinates in [-HALF, HALF)."""
    return (((np.int64(level) << BITS | (x + HALF)) << BITS) | (y + HALF)) << BITS | (z + HALF)


@kernel
def unpack(key: int) -> tuple[int, int, int, int]:
    """Level and coordinates of a key."""
    z = (key & MASK) - HALF
    y = ((key >> BITS) & MASK) - HALF
    x = ((key >> (2 * BITS)) & MASK) - HALF
    return key >> (3 * BITS), x, y, z


@kernel
def slot(table: Indices, key: int) -> np.int64:
    """The slot of a key in the table, or the empty slot for it."""
    h = np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)
    at = np.int64(h >> np.uint64(20)) & (len(table) - 1)
    while table[at] != EMPTY and table[at] != key:
        at = (at + 1) & (len(table) - 1)
    return at


@kernel
def _insert_all(table: Indices, keys: Indices, count: int) -> int:
    """Put keys into a table; returns how many it holds then, or -1 when it is too full."""
    for key in keys:
        at = slot(table, key)
        if table[at] == EMPTY:
            table[at] = key
            count += 1
            if 2 * count > len(table):
                return -1
    return count


@kernel
def _mark(
    table: Indices,
    count: int,
    rays: Floats,
    depth: Floats,
    spread: Floats,
    eye: Vector,
    steps: Floats,
    finest: float,
    narrow: float,
    wide: float,
    levels: int,
) -> int:
    """Put the cells along each pixel's ray, within its truncation, into the table; -1 when it is too full."""
    recent = np.full(RECENT, EMPTY, np.int64)
    for p in range(len(depth)):
        level = min(max(int(np.floor(np.log2(steps[p] / finest) + 0.5)), 0), levels - 1)
        side = finest * 2.0**level
        length = np.sqrt(rays[p, 0] ** 2 + rays[p, 1] ** 2 + rays[p, 2] ** 2)
        reach = int(min(max(np.ceil(spread[p] / side), narrow), wide))
        last = np.int64(EMPTY)
        for k in range(-2 * reach, 2 * reach + 1):
            t = depth[p] + 0.5 * k * side / length
            x = np.int64(np.floor((eye[0] + t * rays[p, 0]) / side))
            y = np.int64(np.floor((eye[1] + t * rays[p, 1]) / side))
            z = np.int64(np.floor((eye[2] + t * rays[p, 2]) / side))
            if max(abs(x), abs(y), abs(z)) >= (HALF >> level) - 2:  # its corners would not fit into a key
                continue
            key = pack(level, x, y, z)
            if key == last:
                continue
            last = key
            near = (x + 17 * y + 289 * z + 4913 * level) & (RECENT - 1)
            if recent[near] == key:
                continue
            recent[near] = key
            at = slot(table, key)
            if table[at] == EMPTY:
                table[at] = key
                count += 1
                if 2 * count > len(table):
                    return -1
    return count


def requested_cells(
    sights: Sequence[FusionSight], steps: Iterable[Floats], origin: Vector, truncation: Truncation, most: int
) -> Indices | None:
    """Keys of the cells that the pixels of all views ask for: (C,) int64 sorted, or None for more than `most`. steps:
    list of (H, W), wanted sides of the cells, world units. origin: (3,) world."""
    largest = 1 << int(np.ceil(np.log2(2.1 * most)))
    table, count = np.full(min(RECENT, largest), EMPTY, np.int64), 0
    for sight, step in zip(sights, steps, strict=True):
        use = sight.weight > 0
        rays = sight.view.ray_directions()[use]
        seen = sight.plane[..., 3][use].astype(np.float64), sight.spread[use].astype(np.float64)
        arrays = *seen, sight.view.center - origin, step[use], *truncation[:3], OCTREE_LEVELS
        while (found := _mark(table, count, rays, *arrays)) < 0:
            if len(table) >= largest:
                return None
            held = table[table != EMPTY]
            table = np.full(2 * len(table), EMPTY, np.int64)
            count = _insert_all(table, held, 0)
        count = found
        if count > most:
            return None
    return np.sort(table[table != EMPTY])


def leaves_of(requested: Indices) -> Indices:
    """The leaves of the octree in which all requested cells are nodes: (L,) int64 sorted keys. Where coarse and fine
    cells overlap the coarse ones are split, and keep their other children."""
    by_level: list[Indices] = [np.zeros(0, np.int64)] * OCTREE_LEVELS
    levels = requested >> (3 * BITS)
    for level in range(OCTREE_LEVELS):
        by_level[level] = requested[levels == level]
    ancestors: list[Indices] = [np.zeros(0, np.int64)]
    for level in range(1, OCTREE_LEVELS):
        below = np.concatenate([by_level[level - 1], ancestors[level - 1]])
        ancestors.append(distinct(_parents(below)).astype(np.int64, copy=False))
    leaves: list[Indices] = []
    nodes: Indices = np.zeros(0, np.int64)
    for level in range(OCTREE_LEVELS - 1, -1, -1):
        nodes = distinct(np.concatenate([by_level[level], nodes])).astype(np.int64, copy=False)
        internal = np.isin(nodes, ancestors[level], assume_unique=True)
        leaves.append(nodes[~internal])
        nodes = _children(nodes[internal])
    return np.sort(np.concatenate(leaves))


def _parents(keys: Indices) -> Indices:
    level, x, y, z = unpack.py_func(keys)
    return pack.py_func(level + 1, x >> 1, y >> 1, z >> 1)


def _children(keys: Indices) -> Indices:
    level, x, y, z = (each[:, None] for each in unpack.py_func(keys))
    c = np.arange(8)
    return pack.py_func(level - 1, 2 * x + (c >> 2), 2 * y + (c >> 1 & 1), 2 * z + (c & 1)).ravel()


class Corners(NamedTuple):
    """The corners of leaves, each once, neighbours in space near one another.

    positions: (P, 3) int32 in units of the finest cell. levels: (P,) int8, of the smallest leaf at each.
    of_leaf: (L, 8) int32, corner c of a leaf lies at + (c >> 2, c >> 1 & 1, c & 1).
    """

    positions: NDArray[np.int32]
    levels: NDArray[np.int8]
    of_leaf: NDArray[np.int32]


def corners_of(leaves: Indices) -> Corners:
    """The Corners of leaves, (L,) int64 keys."""
    size = 1 << int(np.ceil(np.log2(max(16, 3 * len(leaves)))))  # two for each leaf, where they lie side by side
    while (found := _numbered(leaves, size)) is None:
        size *= 2
    positions, levels, of_leaf = found
    del found
    order = np.argsort(_morton(positions), kind="stable")
    rank = np.empty(len(order), np.int32)
    rank[order] = np.arange(len(order), dtype=np.int32)
    return Corners(positions[order], levels[order], rank[of_leaf])


def _numbered(leaves: Indices, size: int) -> tuple[NDArray[np.int32], NDArray[np.int8], NDArray[np.int32]] | None:
    """Corners in the order in which leaves have them: positions, levels, of_leaf; None where a table of `size` rows
    gets too full."""
    table, values = np.full(size, EMPTY, np.int64), np.zeros(size, np.int32)
    positions, levels = np.zeros((size // 2, 3), np.int32), np.zeros(size // 2, np.int8)
    of_leaf = np.zeros((len(leaves), 8), np.int32)
    count = _number_corners(leaves, table, values, positions, levels, of_leaf)
    return None if count < 0 else (positions[:count], levels[:count], of_leaf)


@kernel
def _number_corners(
    leaves: Indices, table: Indices, values: Integers, positions: Integers, levels: Integers, of_leaf: Integers
) -> int:
    count = 0
    for i in range(len(leaves)):
        level, x, y, z = unpack(leaves[i])
        for c in range(8):
            px, py, pz = (x + (c >> 2)) << level, (y + (c >> 1 & 1)) << level, (z + (c & 1)) << level
            key = pack(0, px, py, pz)
            at = slot(table, key)
            if table[at] == EMPTY:
                if count == len(positions):
                    return -1
                table[at], values[at] = key, count
                positions[count, 0], positions[count, 1], positions[count, 2] = px, py, pz
                levels[count] = level
                count += 1
            n = values[at]
            of_leaf[i, c] = n
            levels[n] = min(levels[n], level)
    return count


def _morton(positions: Integers) -> NDArray[np.uint64]:
    """The place of each position (P, 3) on a Z-order curve."""
    key = np.zeros(len(positions), np.uint64)
    for axis in range(3):
        value = (positions[:, axis] + HALF).astype(np.uint64)
        key |= (bits_apart(value >> 10) << 30 | bits_apart(value & 1023)) << axis
    return key
