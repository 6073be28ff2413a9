"""Rays whose outcome neighbours agree on are not traced.

A quarter of the rays of every vertex, its pilots, are traced first. Blocks of 64 vertices, neighbours along a curve
through space, sort their pilots into cells of directions, an octahedral map. Where all pilots of a block in a cell and
the eight cells around it are free, or all are hidden, the other rays of the cell are taken to be so too. The rest are
traced: directions in which a shadow's edge passes, the shade of leaves. A vertex whose own pilots are all free, or all
hidden, takes nothing else from its block: what nothing hides stays exact. Where rays are doubled, all earlier ones are
pilots.

What no pilot of a block met is missed: in the mean .0003 to .0004 of the visible fraction at 256 rays each,
.0007 to .0016 at 64 (a garden and a room). More rays bring more pilots and smaller cells.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_slices, shared

from .occluder import BATCH_RAYS, Occluder
from .sampling import direction, tangents, turned

LEAST_RAYS = 64
"""Rays of a vertex from which this pays: with 32, error grows by up to a third."""

LEAST_VERTICES = 10_000
"""On fewer, blocks are wide, and agree on little: of 4,000 vertices of a bumpy sphere 80 to 84% is traced."""

PILOTS = 4
"""One ray in so many is a pilot, here and to lamps. Of 8, pilots miss too much: 1.5 times the error at 256 rays."""

BLOCK = 64
"""Vertices that share pilots. With 128, parallax shifts more edges, and 6 to 18% more is traced."""

OPEN, HIDDEN, UNSURE = np.uint8(0), np.uint8(1), np.uint8(2)
"""What a block knows of a cell of directions."""


def worth(rays: int, vertices: int, earlier: int = 0) -> bool:
    """Whether so many rays of each of so many vertices, after earlier ones, are enough to leave some untraced."""
    enough = earlier >= LEAST_RAYS // PILOTS if earlier else rays >= LEAST_RAYS and rays % PILOTS == 0
    return enough and rays * BLOCK <= BATCH_RAYS and vertices >= LEAST_VERTICES


class RaySet(NamedTuple):
    """Vertices in the order of a curve through space, and a set of R rays from each, as of `sampling.shoot_at`.

    origins, normals: (N, 3) float32, unit frame and unit. azimuths: (R, 2) float32. offsets: (N, 2) float32.
    """

    origins: NDArray[np.float32]
    normals: NDArray[np.float32]
    azimuths: NDArray[np.float32]
    offsets: NDArray[np.float32]


class KnownRays(NamedTuple):
    """Sets of rays from the same vertices that are known: offsets (S, N, 2) float32, hidden (S, N, R) uint8 of 0, 1."""

    offsets: NDArray[np.float32]
    hidden: NDArray[np.uint8]


def hidden_rays(occluder: Occluder, places: RaySet, earlier: KnownRays | None = None) -> tuple[NDArray[np.uint8], int]:
    """Which rays something hides, (N, R) uint8 of 0 and 1, and how many of them were traced.

    earlier: other sets from the same vertices, which then are the pilots. Blocks begin at the first vertex: calls for
    whole BLOCKs give what one call for all of them does.
    """
    count, rays = len(places.origins), len(places.azimuths)
    if earlier is None:
        piloted = np.arange(rays) % PILOTS == np.arange(count)[:, None] % PILOTS  # from another ray on in each vertex
        pilots = np.where(piloted, UNSURE, OPEN)
        met = occluder.occluded(_aimed(places, pilots)).reshape(count, -1).view(np.uint8)
        side, step, seen = _side(rays), PILOTS, KnownRays(places.offsets[None], met[None])
    else:
        met = np.zeros((count, 0), np.uint8)
        side, step, seen = _side(rays * (len(earlier.hidden) + 1)), 1, earlier
    known = np.zeros((-(-count // BLOCK), side * side), np.uint8)
    shared(_agree)(len(known), places.normals, places.azimuths, *seen, step, _around(side), known)
    hidden = np.zeros((count, rays), np.uint8)
    met_any, met_all = seen.hidden.any(axis=(0, 2)), seen.hidden.all(axis=(0, 2))
    own = np.where(met_all, HIDDEN, np.where(met_any, UNSURE, OPEN))
    in_slices(_predict, count, *places, met, own, known, hidden)
    asked = _aimed(places, hidden)
    if len(asked):
        hidden[hidden == UNSURE] = occluder.occluded(asked)
    return hidden, met.size + len(asked)


def _aimed(places: RaySet, hidden: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The rays that are UNSURE in hidden (N, R), vertex by vertex: (M, 6) float32, origin and direction."""
    ends = np.zeros(len(hidden) + 1, np.int64)
    np.cumsum(np.count_nonzero(hidden == UNSURE, axis=1), out=ends[1:])
    asked = np.zeros((ends[-1], 6), np.float32)
    in_slices(_aim, len(hidden), *places, hidden, ends, asked)
    return asked


def _side(rays: int) -> int:
    """Cells along the side of the map for so many rays of a vertex: eight pilots of a block in each of its half."""
    return round(2.0 * math.sqrt(rays))


def _around(side: int) -> NDArray[np.int32]:
    """The cells at and around each cell of an octahedral map, (side^2, 9) int32, mirrored across its border."""
    row, column = np.divmod(np.arange(side * side), side)
    found = []
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            i, j = row + down, column + right
            beyond = (i < 0) | (i >= side)
            i, j = np.clip(i, 0, side - 1), np.where(beyond, side - 1 - j, j)
            beyond = (j < 0) | (j >= side)
            i, j = np.where(beyond, side - 1 - i, i), np.clip(j, 0, side - 1)
            found.append(i * side + j)
    return np.stack(found, axis=1).astype(np.int32)


@kernel
def _cell(x: np.float32, y: np.float32, z: np.float32, side: int) -> int:
    """The cell of a direction in an octahedral map of side^2 cells (Meyer et al., "On Floating-Point Normal Vectors",
    2010), with y up."""
    one = np.float32(1)
    scale = one / (abs(x) + abs(y) + abs(z))
    u, v = x * scale, z * scale
    if y < 0:
        u, v = (one - abs(v)) * np.copysign(one, u), (one - abs(u)) * np.copysign(one, v)
    half = np.float32(0.5 * side)
    return min(int((u + one) * half), side - 1) * side + min(int((v + one) * half), side - 1)


@kernel
def _agree(
    begin: int,
    end: int,
    normals: NDArray[np.float32],
    azimuths: NDArray[np.float32],
    offsets: NDArray[np.float32],
    met: NDArray[np.uint8],
    step: int,
    around: NDArray[np.int32],
    known: NDArray[np.uint8],
) -> None:
    """What each block knows of each cell, from the rays there and in the cells around it: sets of (S, N, R / step)."""
    cells = known.shape[1]
    side = int(np.sqrt(cells))
    pilots, hidden = np.zeros(cells, np.int32), np.zeros(cells, np.int32)
    for b in range(begin, end):
        for c in range(cells):
            pilots[c], hidden[c] = 0, 0
        for v in range(b * BLOCK, min(b * BLOCK + BLOCK, len(normals))):
            frame = tangents(normals[v, 0], normals[v, 1], normals[v, 2])
            for s in range(len(met)):
                shift, turn = offsets[s, v, 0], turned(offsets[s, v, 1])
                for p in range(met.shape[2]):
                    x, y, z = direction(p * step + v % step, shift, turn, frame, azimuths)
                    c = _cell(x, y, z, side)
                    pilots[c] += 1
                    hidden[c] += met[s, v, p]
        for c in range(cells):
            every, some = 0, 0
            for n in range(9):
                every += pilots[around[c, n]]
                some += hidden[around[c, n]]
            if every < PILOTS or 0 < some < every:
                known[b, c] = UNSURE
            else:
                known[b, c] = HIDDEN if some else OPEN


@kernel
def _predict(
    begin: int,
    end: int,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    azimuths: NDArray[np.float32],
    offsets: NDArray[np.float32],
    met: NDArray[np.uint8],
    own: NDArray[np.uint8],
    known: NDArray[np.uint8],
    hidden: NDArray[np.uint8],
) -> None:
    """Fill `hidden` with what is known of each ray."""
    side = int(np.sqrt(known.shape[1]))
    for v in range(begin, end):
        frame, turn = tangents(normals[v, 0], normals[v, 1], normals[v, 2]), turned(offsets[v, 1])
        block, first = v // BLOCK, v % PILOTS
        for i in range(len(azimuths)):
            if met.shape[1] > 0 and i % PILOTS == first:
                hidden[v, i] = met[v, i // PILOTS]
                continue
            x, y, z = direction(i, offsets[v, 0], turn, frame, azimuths)
            guess = known[block, _cell(x, y, z, side)]
            if own[v] != UNSURE and guess != own[v]:
                guess = UNSURE
            hidden[v, i] = guess


@kernel
def _aim(
    begin: int,
    end: int,
    origins: NDArray[np.float32],
    normals: NDArray[np.float32],
    azimuths: NDArray[np.float32],
    offsets: NDArray[np.float32],
    hidden: NDArray[np.uint8],
    ends: NDArray[np.int64],
    asked: NDArray[np.float32],
) -> None:
    """The rays that are UNSURE, in order."""
    for v in range(begin, end):
        px, py, pz = origins[v]
        frame, turn, ray = tangents(normals[v, 0], normals[v, 1], normals[v, 2]), turned(offsets[v, 1]), ends[v]
        for i in range(len(azimuths)):
            if hidden[v, i] == UNSURE:
                asked[ray, 0], asked[ray, 1], asked[ray, 2] = px, py, pz
                x, y, z = direction(i, offsets[v, 0], turn, frame, azimuths)
                asked[ray, 3], asked[ray, 4], asked[ray, 5] = x, y, z
                ray += 1
