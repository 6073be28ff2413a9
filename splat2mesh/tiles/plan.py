"""How a city is cut: one frame and one lattice for all of it, and tiles as rectangles of lattice blocks.

The lattice starts at the origin; a block is as wide as the largest cell, so the content of a block depends on what
is seen in and around it, not on the tile that computes it.
"""

import math
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from hashlib import sha256
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats, Mask
from ..base.cells import CELLS, keys_of
from ..base.errors import InputError
from ..surface.octree import HALF
from .memory import BASE_GB, check_memory
from .store import Store

FILE = "plan.json"
"""File of a city's folder with the request and the plan."""

FAR, DISTANT = "far.ply", "distant.ply"
"""Files of a tile's folder: its coarse mesh for other tiles, and a coarser one for the whole city."""

CELL_LEVELS = 3
"""Doublings from the finest cell to the largest one, the block."""

LEAST_PIXEL = 0.36
"""Size of a pixel that counts, over the distance of splats on the surface, at least. Dense captures of needles have
training pixels far below, which would call for cells and stations that no splat supports."""

PER_CUBE, LEAST_PER_CUBE, CUBE_ROUNDS = 30, 3, 5
"""Splats of the sample, on average and at least, in a cube that a surface goes through; and rounds in which the size of
the cubes is found."""

STATION_REACH, STATION_SPACING = 1.3, 0.8
"""Range of a station and spacing of stations, in units of the distance at which two training pixels fill
one of a view of REFERENCE_PIXELS."""

REFERENCE_PIXELS = 192
"""Side of the views of normal detail; each looks over 90 degrees."""

RING = 6
"""Blocks around a tile's core in which its surface is found too: what a vertex on the border and its normal depend on
lies within five."""

CARVE = 6
"""Blocks in front of a surface, along z, that count as seen to be free."""

INFLUENCE = math.ceil(math.sqrt(3) * CARVE)
"""Blocks from the surface point of a pixel within which it gives evidence of space: marks reach 3, truncation and free
space CARVE along z, which is sqrt 3 times as far along the ray in the corner of a view."""

GB_PER_SPLAT = 5.0e-6
"""Of the peak of a process, what a splat of the core and its halo adds: 2e-6 in generated cities,
3.6e-6 in a trained plaza whose trees are fog, with eleven vertices of the raw surface for each splat."""

USUAL_SPLATS, MOST_SPLATS, LEAST_SPLATS = 400_000, 1_000_000, 5_000
"""Of a tile with its halo: where no memory is given, since more tiles can share more machines; at most, whatever the
memory; and at least, since a smaller tile is mostly halo."""


@dataclass
class CityPlan:
    """The facts on a city that every task has. Scene frame: right-handed, y up, the splats' unit.

    scene_from_splat: 4 x 4, rows first. up_from: what decided up. pixel: size of a training pixel, or what counts as
    one where splats are far apart for it. trained: of a training pixel. finest: side of the smallest cell. low, high:
    (3,) box of what counts as the city. tiles: [x0, z0, x1, z1] each, in blocks. counts: expected splats of each core.
    fog: of the surfaces, by a sample. pixels: side of the views.
    """

    scene_from_splat: list[list[float]]
    up_from: str
    pixel: float
    finest: float
    low: list[float]
    high: list[float]
    tiles: list[list[int]]
    counts: list[int]
    pieces: list[Any]
    splats: int
    pixels: int = REFERENCE_PIXELS
    trained: float = 0.0
    fog: float = 0.0
    settings: dict[str, Any] = field(default_factory=dict)

    @property
    def block(self) -> float:
        """Side of a block, scene units."""
        return self.finest * 2.0**CELL_LEVELS

    @property
    def reach(self) -> float:
        """Range of a station."""
        return STATION_REACH * REFERENCE_PIXELS * self.pixel

    @property
    def spacing(self) -> float:
        """Distance between stations."""
        return STATION_SPACING * REFERENCE_PIXELS * self.pixel

    def core(self, tile: int) -> NDArray[np.float64]:
        """The rectangle of a tile: (2, 2) lowest and highest x and z."""
        return self._cores[tile]

    def near(self, tile: int, distance: float) -> list[int]:
        """The tiles whose cores reach into the core of a tile grown by a distance, itself among them, in order."""
        low, high = grown(self.core(tile), distance)
        touching = (self._cores[:, 0] < high).all(axis=1) & (self._cores[:, 1] > low).all(axis=1)
        return np.flatnonzero(touching).tolist()

    def seers(self, tile: int) -> list[int]:
        """The tiles whose stations may see a tile's ring."""
        return self.near(tile, self.reach + (RING + INFLUENCE) * self.block)

    @cached_property
    def _cores(self) -> NDArray[np.float64]:
        return np.array(self.tiles, np.float64).reshape(-1, 2, 2) * self.block

    def owner_of(self, places: NDArray) -> NDArray[np.int64]:
        """The tile that each place belongs to: (N, 2) x and z -> (N,), -1 outside all."""
        block = np.floor(np.asarray(places, np.float64) / self.block).astype(np.int64)
        corners = np.array(self.tiles)
        low, high = corners[:, :2].min(axis=0), corners[:, 2:].max(axis=0)
        map_ = np.full(high - low + 2, -1, np.int64)  # with a border of none
        for number, (x0, z0, x1, z1) in enumerate(corners - np.tile(low - 1, 2)):
            map_[x0:x1, z0:z1] = number
        return map_[tuple((np.clip(block, low - 1, high) - low + 1).T)]


def apart(places: NDArray, weights: NDArray) -> float:
    """Distance of splats if they lay even on the surface: places, (N, 3) of a sample; weights, (N,) splats that each
    stands for. The surface has as many squares as there are cubes with splats in them."""
    low, high = np.percentile(places, [1, 99], axis=0)
    inside = ((places >= low) & (places <= high)).all(axis=1)
    within = places[inside] - (low + high) / 2
    area = max(float(np.sort(high - low)[1:].prod()), 1e-30)
    for _ in range(CUBE_ROUNDS):
        side = max(math.sqrt(area * PER_CUBE / max(len(within), 1)), float((high - low).max()) / (CELLS - 2))
        counts = np.unique(keys_of(np.floor(within / side)), return_counts=True)[1]
        area = side**2 * max(int((counts >= LEAST_PER_CUBE).sum()), 1)
    return math.sqrt(area / max(float(weights[inside].sum()), 1.0))


def grown(box: Floats, distance: float) -> NDArray[np.float64]:
    """A box, (2, 2) lowest and highest x and z, with so much more around it."""
    return box + np.array([[-distance], [distance]])


def folder_of(tile: int) -> str:
    """The folder of a tile."""
    return f"tiles/{tile:05d}"


@lru_cache(2)
def plan_at(root: str, key: str) -> CityPlan:
    """The plan of a city at the root of a Store. key: its checksum, by which a worker recognises one that it has
    read."""
    return CityPlan(**Store(root).read_json(FILE, key)["plan"])


def known_plan(store: Store) -> tuple[str, CityPlan]:
    """The key of a city's plan, and the plan."""
    key = sha256(store.read(FILE)).hexdigest()
    return key, plan_at(store.root, key)


def splats_for(memory_gb: float | None, wanted: int | None = None) -> int:
    """Splats that a tile and its halo may hold. Raises InputError for a memory that the libraries alone fill."""
    if wanted is not None:
        return wanted
    if memory_gb is None:
        return USUAL_SPLATS
    check_memory(memory_gb, BASE_GB + LEAST_SPLATS * GB_PER_SPLAT)
    return int(min((memory_gb - BASE_GB) / GB_PER_SPLAT, MOST_SPLATS))


def cut(
    places: NDArray,  # (N, 2) x and z of a sample of the splats, scene frame
    weights: NDArray,  # (N,) splats that each stands for
    bounds: NDArray,  # (2, 2) lowest and highest x and z of the city
    block: float,
    halo: float,  # how far beyond its core a tile needs splats
    most: int,  # splats of a core and its halo
) -> tuple[list[list[int]], list[int]]:
    """Rectangles of blocks that cover a city, each with its halo of at most `most` splats where that can be, and the
    splats of each core. Cuts go across the longer side, at half of the splats."""
    first, last = np.floor(bounds / block).astype(np.int64) + np.array([[0], [1]])
    if max(np.abs(first).max(), np.abs(last).max()) * 2**CELL_LEVELS >= HALF - 2**CELL_LEVELS:
        raise InputError(
            f"the city spans {np.ptp(bounds, axis=0).max():g} units in cells of {block / 2**CELL_LEVELS:g}: too many"
        )
    least = max(3 * RING, math.ceil(halo / block / 4))
    whole = [int(first[0]), int(first[1]), int(last[0]), int(last[1])]
    pending: list[tuple[list[int], NDArray]] = [(whole, np.array([*places.T, weights]))]
    done = []
    while pending:
        (x0, z0, x1, z1), splats = pending.pop()
        box = np.array([[x0, z0], [x1, z1]]) * block
        splats = splats[:, within_box(splats[:2].T, grown(box, halo))]
        own = splats[:, within_box(splats[:2].T, box)]
        axis = 0 if x1 - x0 >= z1 - z0 else 1
        start, stop = ((x0, x1), (z0, z1))[axis]
        if splats[2].sum() <= most or stop - start < 2 * least:
            done.append(([x0, z0, x1, z1], round(float(own[2].sum()))))
            continue
        middle = round(float(np.median(own[axis])) / block) if own.size else (start + stop) // 2
        middle = min(max(middle, start + least), stop - least)
        below, above = [x0, z0, x1, z1], [x0, z0, x1, z1]
        below[axis + 2] = above[axis] = middle
        pending += [(above, splats), (below, splats)]
    return [tile for tile, _ in done], [count for _, count in done]


def within_box(places: Floats, box: Floats) -> Mask:
    """(N,) bool: which places (N, 2), x and z, lie in a box (2, 2) from its lowest to below its highest."""
    return ((places >= box[0]) & (places < box[1])).all(axis=1)
