"""Hits of the bounce rays: traced once and cached; the matrix of bounces follows from them.

A place is one number: the face, and the position on it to a fraction of its edge. It takes four bytes; computing the
corners and weights of a row from it takes less time than reading them would.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers, Mask
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_slices

from . import check_rays, sampling
from .bounce_rows import FINENESS, LEAST_KEPT, SIDE
from .facing import is_front
from .occluder import Occluder
from .receivers import Receivers

BATCH_RAYS = 2**18
"""Rays in memory at once, 64 bytes each with what they hit; cores share a bounce by as many."""


class Shooting(NamedTuple):
    """Where rays start and what they meet. seed: of their directions. advance: called with the number of vertices done.
    receivers: from which they start; all vertices without."""

    occluder: Occluder
    seed: int = 0
    advance: Advance = lambda count: None
    receivers: Receivers | None = None


class BouncePlaces(NamedTuple):
    """The first hits of R cosine-distributed rays from each of M vertices, in a mesh of V.

    rows: (M,) int32, the vertices that rays start from, along a curve. hits: (V,) int32, how many of each vertex's met
    something. used: (M,) int32, how many of those met the front of a face. places: (P,) uint32 or uint64, where, row
    after row, as `bounce_rows.unpack` takes it. copies: (V,) int32, how many vertices agree with each in place and
    normal. base: () int32, rays of each set: 1, 2 or 4 sets, one after the other in every row.
    """

    rows: NDArray[np.int32]
    hits: NDArray[np.int32]
    used: NDArray[np.int32]
    places: NDArray[np.unsignedinteger[Any]]
    copies: NDArray[np.int32]
    base: NDArray[np.int32]

    @classmethod
    def shot(cls, rays: int, how: Shooting, by: tuple[float, float] = (0.0, 0.0)) -> "BouncePlaces":
        """Trace them. by: of `sampling.next_sets`. A row depends on its vertex, the seed and the scene, not on vertex
        order or threads. Raises InputError for rays outside 1..65536."""
        occluder, seed, advance, receivers = how
        azimuths = sampling.fibonacci_azimuths(check_rays(rays))
        count, batch = len(occluder.origins), batch_of(rays)
        order, new_node, _ = occluder.ranked
        node, hits = np.zeros((2, count), np.int32)
        node[order] = np.cumsum(new_node) - 1
        copies = np.bincount(node, minlength=1)[node].astype(np.int32)
        rows = order if receivers is None or receivers.all else order[receivers.traced[order]]
        kind = np.uint32 if len(occluder.faces) * SIDE**2 < 2**32 else np.uint64
        buffer = np.zeros((min(batch, len(rows)), rays, 6), np.float32)
        places, used, found = np.zeros(buffer.shape[:2], np.int64), np.zeros(len(rows), np.int32), []
        for start in range(0, len(rows), batch):
            part = rows[start : start + batch]
            some, shot, met = used[start : start + batch], buffer[: len(part)], np.zeros(len(part), np.int32)
            sampling.shoot(occluder.origins[part], occluder.normals[part], azimuths, seed, shot, by)
            first = occluder.first_hits(shot)[1:]
            in_slices(_meet, len(part), shot, *first, occluder.faces, occluder.normals, places, some, met)
            hits[part] = met
            found.append(places[: len(part)][np.arange(rays) < some[:, None]].astype(kind))
            advance(len(part))
        places = np.concatenate([np.zeros(0, kind), *found])
        return cls(rows.astype(np.int32), hits, used, places, copies, np.array(rays, np.int32))

    def grows_to(self, rays: int) -> bool:
        """Whether these rays, doubled as often as they may be, are as many."""
        base = int(self.base)
        return base < rays <= sampling.most_grown(base) and rays in (2 * base, 4 * base)

    def grown(self, there: int, rays: int, how: Shooting) -> "BouncePlaces":
        """These, so many rays of each vertex, and after them in every row those that lie between, up to `rays`: only
        the latter are traced. For what was shot in the same way."""
        base, sets = int(self.base), [(0.0, 0.0)]
        while len(sets) * base < rays:
            sets += sampling.next_sets(sets)
        parts = [self, *(self.shot(base, how, by) for by in sets[there // base :])]
        used = np.stack([part.used for part in parts]).sum(axis=0, dtype=np.int32)
        places = np.empty(used.sum(dtype=np.int64), self.places.dtype)
        at = np.append(0, np.cumsum(used, dtype=np.int64))[:-1]
        for part in parts:
            starts = np.append(0, np.cumsum(part.used, dtype=np.int64))
            in_slices(_lay, len(used), starts, part.places, at, places)
            at = at + part.used
        hits = np.stack([part.hits for part in parts]).sum(axis=0, dtype=np.int32)
        return self._replace(hits=hits, used=used, places=places)

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]], rays: int, faces: int, traced: Mask) -> "BouncePlaces":
        """Restore from cached arrays, for the vertices `traced`, (V,), in a mesh of a number of faces.

        Raises InputError or KeyError for what does not fit: loops trust it.
        """
        self = cls(*(arrays[name] for name in cls._fields))
        rows, hits, used, places, copies, base = self
        counts = all(each.dtype == np.int32 for each in (rows, hits, used, copies, base)) and places.dtype.kind == "u"
        fits = hits.shape == copies.shape == traced.shape and places.ndim == 1 and base.shape == ()
        if not (counts and fits and rows.shape == used.shape == (np.count_nonzero(traced),)):
            raise InputError("kept bounces are of another kind")
        if min(each.min(initial=0) for each in (rows, hits, used, copies - 1)) < 0:
            raise InputError("kept bounces hold negative numbers")
        if (
            rays not in (base, 2 * base, 4 * base)
            or max(used.max(initial=0), hits.max(initial=0)) > rays
            or used.sum(dtype=np.int64) != len(places)
        ):
            raise InputError("kept bounces have another number of rays")
        named = np.zeros(len(traced), bool)
        named[rows[rows < len(named)]] = True
        if (named != traced).any() or rows.max(initial=-1) >= len(named):
            raise InputError("kept bounces are of other vertices")
        beyond = np.zeros(len(places), bool)
        in_slices(_look, len(places), places, faces, beyond)
        if beyond.any():
            raise InputError(f"kept bounces do not fit a mesh of {faces} faces")
        return self

    def thinned(self, step: int) -> "BouncePlaces":
        """Those of one ray in `step`, as evenly among the hits of each row; rows of few hits keep them all."""
        if step == 1:
            return self
        ends, kept = np.append(0, np.cumsum(self.used, dtype=np.int64)), np.zeros_like(self.used)
        hits, used = self.hits.copy(), self.used
        few = used < LEAST_KEPT * step
        kept[:] = np.where(few, used, (used - step // 2 + step - 1) // step)
        met = np.rint(hits[self.rows] * (kept / np.maximum(used, 1))).astype(np.int32)  # with their share of the backs
        hits[self.rows] = np.where(few, hits[self.rows], np.maximum(met, kept))
        places = np.empty(kept.sum(dtype=np.int64), self.places.dtype)
        in_slices(_thin, len(used), ends, self.places, np.append(0, np.cumsum(kept, dtype=np.int64)), step, places)
        return self._replace(hits=hits, used=kept, places=places)


def batch_of(rays: int) -> int:
    """Vertices per batch at this number of rays."""
    return max(1, BATCH_RAYS // rays)


@kernel
def _meet(
    begin: int,
    end: int,
    rays: NDArray[np.float32],
    faces: Integers,
    uv: NDArray[np.float32],
    normals: NDArray[np.float32],
    corners: Integers,
    vertex_normals: NDArray[np.float32],
    found: NDArray[np.int64],
    used: NDArray[np.int32],
    hits: NDArray[np.int32],
) -> None:
    """Where rays (N, R) meet the front of a face, as one number each, into the beginnings of the rows `found` (N, R).

    used: (N,), how many of a row those are. hits: (N,), with those that met the back.
    """
    fine, one = np.float32(FINENESS), np.float32(1)
    for v in range(begin, end):
        count = 0
        for i in range(rays.shape[1]):
            face = faces[v, i]
            if face < 0:
                continue
            hits[v] += 1
            if not is_front(normals[v, i], rays[v, i, 3:], corners[face], vertex_normals):
                continue
            # Within rounding: a hit on an edge may come with a weight just below 0.
            x = min(max(uv[v, i, 0], np.float32(0)), one) * fine
            y = min(max(uv[v, i, 1], np.float32(0)) * fine, fine - x)
            z = fine - x - y
            second, third = np.int64(x), np.int64(y)
            left = FINENESS - np.int64(z) - second - third
            x, y, z = x - np.floor(x), y - np.floor(y), z - np.floor(z)
            if left == 1:  # goes to whose rest is largest, whichever corner is called the first
                second, third = second + (x >= y and x >= z), third + (y > x and y >= z)
            elif left == 2:
                second, third = second + (x >= y or x >= z), third + (y > x or y >= z)
            found[v, count] = (np.int64(face) * SIDE + second) * SIDE + third
            count += 1
        used[v] = count


@kernel
def _lay(
    begin: int, end: int, starts: NDArray[np.int64], places: Integers, at: NDArray[np.int64], laid: Integers
) -> None:
    """The places of each row v to where it begins, at[v]."""
    for v in range(begin, end):
        for i in range(starts[v + 1] - starts[v]):
            laid[at[v] + i] = places[starts[v] + i]


@kernel
def _thin(
    begin: int,
    end: int,
    starts: NDArray[np.int64],
    places: Integers,
    kept: NDArray[np.int64],
    step: int,
    thinned: Integers,
) -> None:
    """The places that are kept of each row; all of them where as many are."""
    for v in range(begin, end):
        count = kept[v + 1] - kept[v]
        whole = count == starts[v + 1] - starts[v]
        first, apart = (0, 1) if whole else (step // 2, step)
        for i in range(count):
            thinned[kept[v] + i] = places[starts[v] + first + i * apart]


@kernel
def _look(begin: int, end: int, places: Integers, faces: int, beyond: Mask) -> None:
    """Which places are on no face."""
    side, most = np.uint64(SIDE), np.uint64(faces)
    for i in range(begin, end):
        place = np.uint64(places[i])
        face = place // (side * side)
        rest = place - face * (side * side)
        second = rest // side
        beyond[i] = face >= most or second + (rest - second * side) > np.uint64(FINENESS)
