"""Leaves and grass: light that reaches them through one another, and that they scatter evenly to all sides.

A leaf's normal, as a splat gives it, is noise. So a volume has a phase that does not depend on direction: its exit
radiance is albedo times the mean over the sphere of the light that reaches it; from a direction d, the part
exp(-tau(d)) does (Beer-Lambert), with tau from the coarse grid of the scene's optical depth. Surfaces keep their
clamped cosine and their rays; vertices in between take a share of both. Under a constant sky of radiance 1 an
unoccluded vertex gives exactly 1, as a surface does.

A grid has no detail, and neither has its light: it is marched from probes among the vertices, which interpolate them.
"""

import math
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Indices, Mask, Points, Transfer
from splat2mesh.base.kernels import kernel
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.base.threads import in_slices
from splat2mesh.scene.leaves import FEW, PROBE, Lattice, throughout
from splat2mesh.scene.optical_depth import MOST, OpticalDepth
from splat2mesh.scene.scene import Scene

from ..light.environment import Suns
from ..sh import harmonics
from .occluder import BATCH_RAYS
from .settings import VOLUME_DIRECTIONS
from .store import array_key
from .sunlight import shining

LEAST = 0.02
"""Volume from which a vertex takes any part: less is a rounding of a surface."""

THROUGHOUT = 0.5
"""Share of a volume in leaves and grass throughout; the rest is the surface that the mesh has there, which shows which
side of a plant is lit. Relit splats of two gardens whose light is known, in dB: 27.8 and 24.7 as surfaces, 27.7 and
24.9 so, 26.9 and 24.7 as nothing but volumes."""

WHOLLY = 1.0 - LEAST
"""Volume share from which a vertex is only a volume, and needs no rays."""

CLEARANCE = 1.0
"""Cells between a probe and where its march begins: leaves that are seen are those before the others."""

NEAR = 12
"""Cells that a march stays in one grid: then it goes on in the next one, whose cells are twice as wide. What is far off
is seen as a cone sees it, and a direction stands for many."""


class Foliage:
    """The volumes of a scene, and how light reaches them.

    vertices: (V, 3), and depth, in the scene frame. volume: (V,) in [0, 1]. rows: (R,) int64, the vertices that take
    part. share: (R, 1) float32 in [0, 1], how far each is a volume. key: text that differs for any two of a geometry.
    """

    def __init__(self, vertices: Points, volume: Floats, depth: OpticalDepth) -> None:
        self.rows = np.flatnonzero(volume > LEAST)
        self.share = volume[self.rows, None].astype(np.float32)
        self.share[self.share >= WHOLLY] = 1.0
        self._points, self._depth = vertices[self.rows].astype(np.float64), depth
        self.key = array_key(volume, *depth)
        self._probes: tuple[tuple[int, int], NDArray[np.float32]] | None = None  # the last ones
        self._count = len(volume)

    @classmethod
    def of_scene(cls, scene: Scene) -> "Foliage | None":
        """That of a Scene, or None where it has no leaves or grass, or its folder does not say how thick they are."""
        depth, foliage = None if scene.measured is None else scene.measured.depth, scene.foliage
        if depth is None or not (foliage > FEW).any():
            return None
        return cls(scene.vertices, settled(scene.vertices, foliage, depth), depth)

    @property
    def solid(self) -> Mask:
        """(V,) bool: the vertices that are a surface at least in part."""
        solid = np.ones(self._count, bool)
        solid[self.rows[self.share[:, 0] == 1.0]] = False
        return solid

    @property
    def probe_count(self) -> int:
        """From how many places light is marched."""
        return len(self._lattice.points)

    def mixed(self, transfer: Transfer, directions: int = VOLUME_DIRECTIONS, wanted: Mask | None = None) -> Transfer:
        """A transfer (V, K) of surfaces, in place, with what is a volume taking its share of the volume's: at all
        vertices, or at those `wanted`, (V,) bool."""
        bands = int(np.sqrt(transfer.shape[1]))
        some = slice(None) if wanted is None or wanted.all() else np.flatnonzero(wanted[self.rows])
        rows, own = self.rows[some], self._lattice.interpolate(self.probes(bands, directions), some)
        transfer[rows] += self.share[some] * (own - transfer[rows])
        return transfer

    def with_suns(self, light: NDArray[np.float32], suns: Suns) -> NDArray[np.float32]:
        """Light (V, 3) float32 that suns give surfaces, in place, with volumes taking their share of the volume's."""
        directions, weights = shining(suns)
        if len(directions):
            own = self._lattice.interpolate(gathered(self._depth, self._lattice.points, directions, 0.25 * weights))
            light[self.rows] += self.share * (own - light[self.rows])
        return light

    def seen(self, rows: Indices, directions: Directions) -> tuple[NDArray[np.float32], NDArray[np.float32], int]:
        """Of vertices (S,) along directions (D, 3): how far they are a volume, (S,), and what light gets through to
        them as one, (S, D) float32; and how many marches that took."""
        share = np.zeros(self._count, np.float32)
        share[self.rows] = self.share[:, 0]
        place = np.zeros(self._count, np.int64)
        place[self.rows] = np.arange(len(self.rows))
        found = np.zeros((len(rows), len(directions)), np.float32)
        thick = np.flatnonzero(share[rows] > 0.0)
        columns, weights = self._lattice.around(place[rows[thick]])
        probes, index = np.unique(columns, return_inverse=True)
        index = index.reshape(weights.shape)
        step = max(1, BATCH_RAYS // max(1, len(probes)))
        for start in range(0, len(directions), step):
            part = slice(start, start + step)
            free = transmittance(self._depth, self._lattice.points[probes], directions[part])
            found[thick, part] = np.einsum("rk,rkd->rd", weights, free[index])
        return share[rows], found, len(probes) * len(directions)

    def probes(self, bands: int, directions: int = VOLUME_DIRECTIONS) -> NDArray[np.float32]:
        """Transfer (P, K) float32 of the probes: the mean over the sphere of exp(-tau) times the harmonics."""
        if self._probes is None or self._probes[0] != (bands, directions):
            toward = fibonacci_sphere(directions)
            weights = harmonics.evaluate(toward, bands) / directions
            self._probes = (bands, directions), gathered(self._depth, self._lattice.points, toward, weights)
        return self._probes[1]

    @cached_property
    def _lattice(self) -> "Lattice":
        return Lattice(self._points, PROBE * float(self._depth.cells[0]))


def settled(
    vertices: Points,  # (V, 3) scene frame
    volume: Floats,  # (V,) in [0, 1], as measured for each
    depth: OpticalDepth,
) -> NDArray[np.float32]:
    """The volume share of each vertex, (V,) float32 in [0, THROUGHOUT], averaged over its surroundings: one leaf
    decides nothing, and in grass no blade stays wholly a surface."""
    return (THROUGHOUT * throughout(vertices, volume, depth)).astype(np.float32)


def transmittance(
    depth: OpticalDepth,
    points: Points,  # (M, 3) in its frame
    directions: Directions,  # (D, 3) unit vectors
) -> NDArray[np.float32]:
    """The part of the light of each direction that gets to each point, exp(-tau): (M, D) float32.

    A march takes the depth of the cell in the middle of each step, a cell long, of wider cells the farther it gets.
    Space outside the grids is empty.
    """
    found = np.zeros((len(points), len(directions)), np.float32)
    in_slices(_march, len(points), *_as_float64(points, directions), depth, found)
    return found


def gathered(
    depth: OpticalDepth,
    points: Points,  # (M, 3) in its frame
    directions: Directions,  # (D, 3) unit vectors
    weights: Floats,  # (D, C)
) -> NDArray[np.float32]:
    """The sums over the directions of weights times `transmittance`, (M, C) float32, in the order of the directions."""
    found = np.zeros((len(points), weights.shape[1]), np.float32)
    in_slices(_gather, len(points), *_as_float64(points, directions, weights), depth, found)
    return found


def _as_float64(*arrays: Floats) -> list[NDArray[np.float64]]:
    return [np.ascontiguousarray(array, np.float64) for array in arrays]


@kernel
def _march(
    begin: int,
    end: int,
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    depth: OpticalDepth,
    found: NDArray[np.float32],
) -> None:
    for m in range(begin, end):
        for k in range(len(directions)):
            found[m, k] = _through(points[m], directions[k], depth)


@kernel
def _gather(
    begin: int,
    end: int,
    points: NDArray[np.float64],
    directions: NDArray[np.float64],
    weights: NDArray[np.float64],
    depth: OpticalDepth,
    found: NDArray[np.float32],
) -> None:
    sums = np.zeros(weights.shape[1])
    for m in range(begin, end):
        for k in range(len(directions)):
            free = _through(points[m], directions[k], depth)
            if free > 0.0:
                for c in range(len(sums)):
                    sums[c] += free * weights[k, c]
        for c in range(len(sums)):  # a row at once would have Numba compile the texts of its errors: 35 functions
            found[m, c], sums[c] = sums[c], 0.0


@kernel
def _through(point: NDArray[np.float64], direction: NDArray[np.float64], depth: OpticalDepth) -> float:
    """exp(-tau) from a point along a direction."""
    dx, dy, dz = direction
    origins, cells = depth.origins, depth.cells
    gone, passed = CLEARANCE * cells[0], 0.0
    for grid in range(len(cells)):
        cell, start, last = cells[grid], depth.starts[grid], grid + 1 == len(cells)
        nx, ny, nz = depth.shapes[grid]
        begin = gone / cell + 0.5
        x = (point[0] - origins[grid, 0]) / cell + begin * dx
        y = (point[1] - origins[grid, 1]) / cell + begin * dy
        z = (point[2] - origins[grid, 2]) / cell + begin * dz
        steps = 0
        while last or gone + steps * cell <= NEAR * cell:
            if not (0.0 <= x < nx and 0.0 <= y < ny and 0.0 <= z < nz):
                break
            passed += depth.depth[start + (int(x) * ny + int(y)) * nz + int(z)]
            if passed >= MOST:
                return 0.0
            x, y, z, steps = x + dx, y + dy, z + dz, steps + 1
        gone += steps * cell
    return math.exp(-passed)
