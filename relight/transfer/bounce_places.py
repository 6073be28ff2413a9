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
from .bounce_rows import FINENESS, SIDE
from .facing import is_front
from .occluder import BATCH_RAYS, Occluder
from .receivers import Receivers


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
    normal.
    """

    rows: NDArray[np.int32]
    hits: NDArray[np.int32]
    used: NDArray[np.int32]
    places: NDArray[np.unsignedinteger[Any]]
    copies: NDArray[np.int32]

    @classmethod
    def shot(cls, rays: int, how: Shooting) -> "BouncePlaces":
        """Trace them. A row depends on its vertex, the seed and the scene, not on vertex order or threads. Raises
        InputError for rays outside 1..65536."""
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
            sampling.shoot(occluder.origins[part], occluder.normals[part], azimuths, seed, shot)
            first = occluder.first_hits(shot)[1:]
            in_slices(_meet, len(part), shot, *first, occluder.faces, occluder.normals, places, some, met)
            hits[part] = met
            found.append(places[: len(part)][np.arange(rays) < some[:, None]].astype(kind))
            advance(len(part))
        places = np.concatenate([np.zeros(0, kind), *found])
        return cls(rows.astype(np.int32), hits, used, places, copies)

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]], rays: int, faces: int, traced: Mask) -> "BouncePlaces":
        """Restore from cached arrays, for the vertices `traced`, (V,), in a mesh of a number of faces.

        Raises InputError or KeyError for what does not fit: loops trust it.
        """
        self = cls(*(arrays[name] for name in cls._fields))
        rows, hits, used, places, copies = self
        counts = all(each.dtype == np.int32 for each in (rows, hits, used, copies)) and places.dtype.kind == "u"
        fits = hits.shape == copies.shape == traced.shape and places.ndim == 1
        if not (counts and fits and rows.shape == used.shape == (np.count_nonzero(traced),)):
            raise InputError("kept bounces are of another kind")
        if min(each.min(initial=0) for each in (rows, hits, used, copies - 1)) < 0:
            raise InputError("kept bounces hold negative numbers")
        if max(used.max(initial=0), hits.max(initial=0)) > rays or used.sum(dtype=np.int64) != len(places):
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


def batch_of(rays: int) -> int:
    """Vertices per batch at this number of rays; cores share a bounce by as many."""
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
def _look(begin: int, end: int, places: Integers, faces: int, beyond: Mask) -> None:
    """Which places are on no face."""
    side, most = np.uint64(SIDE), np.uint64(faces)
    for i in range(begin, end):
        place = np.uint64(places[i])
        face = place // (side * side)
        rest = place - face * (side * side)
        second = rest // side
        beyond[i] = face >= most or second + (rest - second * side) > np.uint64(FINENESS)
