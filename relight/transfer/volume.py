"""Leaves and grass: light that reaches them through one another, and that they send on to all sides alike.

A leaf's own normal, as a splat tells it, is noise. So what is a volume has a phase that does not depend on direction:
its exit radiance is albedo times the mean over the sphere of the light that gets there, and of that in a direction d
the part exp(-tau(d)) does (Beer-Lambert), with tau from the coarse grid of the scene's optical depth. Surfaces keep
their clamped cosine and their rays; what is in between takes a share of both.
Under a constant sky of radiance 1 what nothing hides gives exactly 1, as a surface does.

A grid has no detail, and its light none: it is marched from probes among the vertices, between which they interpolate.
"""

from functools import cached_property

import numpy as np
from numba import njit

from ..sh import harmonics
from ..sh.sphere import fibonacci_sphere
from .store import array_key
from .sunlight import shining
from .threads import in_slices

LEAST = 0.02
"""Volume from which a vertex takes any part: less is a rounding of a surface."""

WHOLLY = 0.98
"""Volume from which a vertex is nothing else, and needs no rays."""

DIRECTIONS = 256
"""Of the sphere, marched from every probe: their sum has an error of 0.3% of all light in 8 bands, on a garden."""

CLEARANCE = 0.75
"""Cells between a probe and where its march begins: leaves that are seen are those before the others."""

NEAR = 12
"""Cells that a march stays in one grid: then it goes on in the next one, whose cells are twice as wide. What is far off
is seen as a cone sees it, and a direction stands for many."""

PROBE = 2.0
"""Cells between probes."""

OPAQUE = 8.0
"""Optical depth at which a march ends: 0.03% of the light is left."""

_BATCH = 1 << 20  # marches in memory at once


class Foliage:
    """What of a scene is a volume, and how light reaches it.

    rows: (R,) int64, the vertices that take part. share: (R, 1) float32 in [0, 1], how far each is a volume.
    key: short text that differs for any two of a geometry.
    """

    def __init__(
        self,
        vertices,  # (V, 3) scene frame
        volume,  # (V,) in [0, 1]
        depth,  # OpticalDepth, scene frame
    ):
        self.rows = np.flatnonzero(volume > LEAST)
        self.share = volume[self.rows, None].astype(np.float32)
        self.share[self.share >= WHOLLY] = 1.0
        self._points, self._depth = vertices[self.rows].astype(np.float64), depth
        self.key = array_key(volume, *depth)
        self._count = len(volume)

    @classmethod
    def of_scene(cls, scene):
        """That of a Scene, or None where it has no leaves or grass, or its folder does not say how thick they are."""
        measured = scene.measured
        if measured is None or measured.depth is None or not (measured.foliage > LEAST).any():
            return None
        return cls(scene.vertices, measured.foliage, measured.depth)

    @property
    def solid(self):
        """(V,) bool: the vertices that are a surface at least in part."""
        solid = np.ones(self._count, bool)
        solid[self.rows[self.share[:, 0] == 1.0]] = False
        return solid

    @property
    def marches(self):
        """How many marches a transfer takes."""
        return DIRECTIONS * len(self._lattice.points)

    def mixed(self, transfer):
        """A transfer (V, K) of surfaces, in place, with what is a volume taking its share of the volume's."""
        bands = int(np.sqrt(transfer.shape[1]))
        own = self._lattice.interpolate(self.probes(bands))
        transfer[self.rows] += self.share * (own - transfer[self.rows])
        return transfer

    def with_suns(self, light, suns):
        """Light (V, 3) float32 that suns give surfaces, in place, with volumes taking their share of the volume's."""
        directions, weights = shining(suns)
        if len(directions):
            free = transmittance(self._depth, self._lattice.points, directions)
            own = self._lattice.interpolate((free @ (0.25 * weights)).astype(np.float32))
            light[self.rows] += self.share * (own - light[self.rows])
        return light

    def seen(self, rows, directions):
        """Of vertices (S,) along directions (D, 3): how far they are a volume, (S,), and what light gets through to
        them as one, (S, D) float32, marched from the vertices themselves."""
        share = np.zeros(self._count, np.float32)
        share[self.rows] = self.share[:, 0]
        place = np.zeros(self._count, np.int64)
        place[self.rows] = np.arange(len(self.rows))
        found = np.zeros((len(rows), len(directions)), np.float32)
        thick = np.flatnonzero(share[rows] > 0.0)
        found[thick] = transmittance(self._depth, self._points[place[rows[thick]]], directions)
        return share[rows], found

    def probes(self, bands):
        """Transfer (P, K) float32 of the probes: the mean over the sphere of exp(-tau) times the harmonics."""
        directions = fibonacci_sphere(DIRECTIONS)
        basis = (harmonics.evaluate(directions, bands) / DIRECTIONS).astype(np.float32)
        points = self._lattice.points
        found = np.zeros((len(points), bands**2), np.float32)
        step = max(1, _BATCH // DIRECTIONS)
        for start in range(0, len(points), step):
            part = slice(start, start + step)
            found[part] = transmittance(self._depth, points[part], directions) @ basis
        return found

    @cached_property
    def _lattice(self):
        return _Lattice(self._points, PROBE * float(self._depth.cells[0]))


class _Lattice:
    """Points (R, 3) gathered in cells of a side: a probe for each cell, between which points interpolate.

    points: (P, 3) float64, the mean of each cell's.
    """

    def __init__(self, points, side):
        low = points.min(axis=0) - side
        at = (points - low) / side
        size = np.ceil(at.max(axis=0)).astype(np.int64) + 2
        keys = np.ravel_multi_index(at.astype(np.int64).T, size)
        self._keys, cell, count = np.unique(keys, return_inverse=True, return_counts=True)
        self.points = np.stack([np.bincount(cell, column) / count for column in points.T], axis=1)
        base = np.floor(at - 0.5).astype(np.int64)
        beyond = at - 0.5 - base
        columns, weights = [], []
        for corner in np.ndindex(2, 2, 2):
            key = np.ravel_multi_index((base + corner).T, size)
            found = np.minimum(np.searchsorted(self._keys, key), len(self._keys) - 1)
            weight = np.where(corner, beyond, 1.0 - beyond).prod(axis=1)
            columns.append(found)
            weights.append(np.where(self._keys[found] == key, weight, 0.0))
        weights = np.stack(weights, axis=1)
        self._columns = np.stack(columns, axis=1)
        self._weights = (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)

    def interpolate(self, values):
        """(P, C) float32 of probes -> (R, C) float32 of the points."""
        result = np.zeros((len(self._columns), values.shape[1]), np.float32)
        for corner in range(8):
            result += self._weights[:, corner, None] * values[self._columns[:, corner]]
        return result


def transmittance(
    depth,  # OpticalDepth
    points,  # (M, 3) in its frame
    directions,  # (D, 3) unit vectors
):
    """The part of the light of each direction that gets to each point, exp(-tau): (M, D) float32.

    A march takes the depth of the cell in the middle of each step, a cell long, of wider cells the farther it gets.
    Nothing is outside of the grids.
    """
    found = np.zeros((len(points), len(directions)), np.float32)
    in_slices(
        _march,
        len(points),
        np.ascontiguousarray(points, np.float64),
        np.ascontiguousarray(directions, np.float64),
        *depth,
        found,
    )
    return found


@njit(cache=True, nogil=True, error_model="numpy")
def _march(begin, end, points, directions, origins, cells, shapes, starts, depth, found):
    for m in range(begin, end):
        for k in range(len(directions)):
            dx, dy, dz = directions[k, 0], directions[k, 1], directions[k, 2]
            gone, passed, grid = CLEARANCE * cells[0], 0.0, 0
            while passed < OPAQUE:
                if gone > NEAR * cells[grid] and grid + 1 < len(cells):
                    grid += 1
                cell = cells[grid]
                at = gone + 0.5 * cell
                u = (points[m, 0] + at * dx - origins[grid, 0]) / cell
                v = (points[m, 1] + at * dy - origins[grid, 1]) / cell
                t = (points[m, 2] + at * dz - origins[grid, 2]) / cell
                if not (0 <= u < shapes[grid, 0] and 0 <= v < shapes[grid, 1] and 0 <= t < shapes[grid, 2]):
                    grid += 1
                    if grid == len(cells):
                        break
                    continue
                passed += depth[starts[grid] + (int(u) * shapes[grid, 1] + int(v)) * shapes[grid, 2] + int(t)]
                gone += cell
            found[m, k] = np.exp(-passed) if passed < OPAQUE else 0.0
