"""Interreflection: light that reaches a surface by way of others, as one sparse matrix for every light.

Row v of the matrix B averages over what cosine-distributed rays from vertex v meet first: (B X)_v is the light
that a white vertex v sends on when every vertex sends out X. With albedo a and direct light D the exit radiance
solves X = a (D + B X), which bounce by bounce is X_0 = a D, X_k+1 = X_0 + a B X_k. The matrix knows nothing
of light and albedo. Source: Neumann series of the rendering equation (Kajiya 1986); radiosity with gathering.

A hit takes the radiance of the face's vertices, interpolated, which is how the output mesh shows it. So light leaks
into contacts whose shadow is smaller than a face: on a tabletop the error is 1.3% of all light with 118,000
faces, 4.6% with 20,000, 16% with 5,000, and 95% of that (squared) is in 5% of the vertices, which see next to no sky.
A hit on the back of a face counts as black: a closed body is dark inside, and no vertex holds the radiance of the back
of an open surface. The vertex normals define the front, not the winding.
"""

import math
from collections import deque
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats, Transfer
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_order, in_slices, read_only

from .bounce_blend import BounceBlend, Met, known_lights
from .bounce_places import BouncePlaces, Shooting, batch_of
from .bounce_rows import gather, unpack
from .checks import check_shape, checked_albedo
from .neighbors import Neighbors
from .occluder import Occluder
from .receivers import Receivers
from .settings import BOUNCE_RAYS, BOUNCE_TOLERANCE

DEFAULT_MAX_BOUNCES = 64
"""Reached only by bright scenes that are nearly closed."""

ROUNDING = 100.0 * float(np.finfo(np.float32).eps)
"""Fractions may be this far outside [0, 1]: sums of float32."""

BLOCK_COEFFICIENTS = 8
"""Transfer coefficients carried through all bounces at once: in three colours three whole vectors of 8 float32.
A third of the time of one by one; 16 gain nothing more."""


class Sharing(NamedTuple):
    """How rows serve more vertices than their own.

    receivers: those whose rows are traced, from which others take over; all without. neighbors: over whose rings what
    rays met is averaged (`bounce_blend`); without, every vertex has its own rays alone.
    """

    receivers: Receivers | None = None
    neighbors: Neighbors | None = None


class Interreflection:
    """The matrix B of a scene: sparse, (V, V), non-negative, rows that sum to at most the hidden fraction.

    Vertices that agree in position and normal (seams of chunks) are separate columns, each with its albedo; cutting a
    scene into chunks changes no bit. rays: per vertex. hits: (V,) int32, how many of them met something. back_hits:
    which share of these, over the scene, met the back of a face. entries: how many met a front. nbytes: memory of the
    matrix. shares: (V,) float64, one over the number of vertices that agree with each. receivers: the Receivers whose
    rows were traced; None for all. hidden: (V,) float32, the share of the cosine lobe that rows are scaled to.
    """

    def __init__(
        self,
        occluder: Occluder,
        rays: int = BOUNCE_RAYS,  # per vertex
        seed: int = 0,
        visible: Floats | None = None,  # (V,) visible fraction of the cosine lobe; see `visible_fraction`
        advance: Advance = lambda count: None,  # called with the number of vertices done
        sharing: Sharing = Sharing(),  # noqa: B008
    ) -> None:
        """Trace the rays. A row depends on its vertex, the seed and the scene, not on vertex order or threads.

        `visible` makes rows complement the direct light they are used with: row sums are scaled to 1 - visible,
        so that light is neither lost nor made by two estimates that disagree, and noise falls by a third.
        Without it, a row sums to the fraction of its own rays that hit. Either way, hits on back faces do not count.
        Raises InputError for rays outside 1..65536 and for a `visible` that is not (V,) in [0, 1].
        """
        places = BouncePlaces.shot(rays, Shooting(occluder, seed, advance, sharing.receivers))
        self._make(places, rays, occluder, visible, sharing)

    @classmethod
    def of_places(
        cls,
        places: BouncePlaces,
        rays: int,
        occluder: Occluder,
        visible: Floats | None = None,
        sharing: Sharing = Sharing(),  # noqa: B008
    ) -> "Interreflection":
        """The same of rays that were traced before."""
        self = cls.__new__(cls)
        self._make(places, rays, occluder, visible, sharing)
        return self

    def _make(
        self, places: BouncePlaces, rays: int, occluder: Occluder, visible: Floats | None, sharing: Sharing
    ) -> None:
        self.rays, self.receivers = rays, sharing.receivers
        self._rows, self.hits = places.rows, places.hits
        met, count = int(self.hits.sum()), len(places.places)
        self.back_hits = (met - count) / max(met, 1)
        self.shares = 1.0 / places.copies
        self._starts = np.append(0, np.cumsum(places.used, dtype=np.int64))
        self._corners, self._parts = np.empty((count, 3), np.uint32), np.empty((count, 2), np.uint8)
        in_slices(unpack, count, places.places, read_only(occluder.faces, np.uint32), self._corners, self._parts)
        self._normals = occluder.normals
        self._blend: BounceBlend | None = None
        fronts = np.zeros_like(self.hits)
        fronts[places.rows] = places.used
        self._fronts, self._neighbors = fronts, sharing.neighbors
        self.scale_to(visible)

    @property
    def entries(self) -> int:
        """The number of hits on fronts."""
        return len(self._corners)

    @property
    def nbytes(self) -> int:
        """Memory of the matrix."""
        return self._starts.nbytes + self._corners.nbytes + self._parts.nbytes

    def bounce(
        self,
        radiance: ArrayLike,  # (V, C) or (V,) exit radiance
    ) -> NDArray[np.float32]:
        """B X: exit radiance of a white vertex due to light from other surfaces; shaped as X, float32.

        Raises InputError unless `radiance` has a row per vertex.
        """
        radiance = np.asarray(radiance, np.float32)
        if radiance.ndim not in (1, 2) or len(radiance) != len(self.hits):
            expected = f"({len(self.hits)},) or ({len(self.hits)}, C)"
            raise InputError(f"the radiance must have shape {expected}, found {radiance.shape}")
        columns = read_only(radiance.reshape(len(radiance), -1))
        if self._blend is None:
            result = self._gathered(columns, self._scale)
        else:
            result = self.hidden[:, None] * self._blend(self._gathered(columns, self._per_hit))
        if self.receivers is not None:
            self.receivers.filled(result)
        return result.reshape(radiance.shape)

    def _gathered(self, columns: NDArray[np.float32], scale: NDArray[np.float32]) -> NDArray[np.float32]:
        """(V, C) sums over the hits of each row of columns (V, C), times a scale (V,)."""
        result = np.zeros_like(columns)
        batch = batch_of(self.rays)

        def work(start: int) -> None:
            part = slice(start, start + batch)
            starts = self._starts[start : start + batch + 1]
            gather(self._rows[part], starts, self._corners, self._parts, scale, columns, result)

        deque(in_order(work, range(0, len(self._rows), batch)), maxlen=0)
        return result

    def scale_to(self, visible: Floats | None) -> None:
        """Scale the rows to complement a visible fraction, (V,), or to the fraction of their own rays that hit."""
        if visible is None:
            self.hidden = (self.hits / self.rays).astype(np.float32)
            self._scale = np.full(len(self.hits), 1.0 / self.rays, np.float32)
        else:
            visible = np.asarray(visible, np.float64)
            if visible.shape != self.hits.shape or not (np.abs(visible - 0.5) < 0.5 + ROUNDING).all():
                found = _described(visible)
                raise InputError(f"visible fractions must be ({len(self.hits)},) in [0, 1], found {found}")
            hidden = np.clip(1.0 - visible, 0.0, 1.0)
            self.hidden = hidden.astype(np.float32)
            self._scale = (hidden / np.maximum(self.hits, 1)).astype(np.float32)
        self._blend = None if self._neighbors is None else self._blend_over(self._neighbors)

    def _blend_over(self, neighbors: Neighbors) -> BounceBlend:
        lights = known_lights(1.0 - self.hidden, self._normals)
        if self.receivers is not None:
            self.receivers.filled(lights)
        met = self._gathered(np.hstack([lights, lights**2]), self._per_hit)
        return BounceBlend(neighbors, Met(self.hits, self._fronts, self.hidden, self.rays), met)

    @property
    def _per_hit(self) -> NDArray[np.float32]:
        return np.float32(1.0) / np.maximum(self.hits, 1).astype(np.float32)


def visible_fraction(
    transfer: ArrayLike,  # (V, K) of a white scene
) -> Floats:
    """Visible fraction of every vertex's cosine lobe, (V,): the answer to a constant sky, as exact as the transfer.

    In [0, 1]: a transfer of two or three rays, averaged, lies up to 0.16 outside, which is noise.
    """
    return np.clip(np.asarray(transfer)[:, 0] * math.sqrt(4.0 * math.pi), 0.0, 1.0)


def with_bounces(
    direct: NDArray[np.float32],  # (V, 3) exit radiance of the white scene in direct light, of any kind
    albedo: ArrayLike,  # (V, 3) linear, in [0, 1]
    interreflection: Interreflection,
    tolerance: float = BOUNCE_TOLERANCE,
    max_bounces: int = DEFAULT_MAX_BOUNCES,
    first: NDArray[np.float32] | None = None,  # (V, 3) the first bounce on white, by more rays than those of the matrix
) -> tuple[NDArray[np.float32], list[float]]:
    """Exit radiance with interreflection, (V, 3) float32, and what each bounce gave: a list of floats.

    Contributions are relative L2 norms over vertices and colours: of a bounce's light, over all light so far. Copies
    of a vertex on seams count as one, so that the number of bounces does not depend on chunks.
    Bounces go on until those left out, as a geometric series, would contribute less than `tolerance`.
    Raises InputError for arrays that do not fit.
    """
    albedo = _checked(albedo, direct, interreflection)
    increment = albedo * np.asarray(direct, np.float32)
    radiance = increment.copy()
    contributions: list[float] = []
    while len(contributions) < max_bounces and not _converged(contributions, tolerance):
        bounced = first if first is not None and not contributions else interreflection.bounce(increment)
        increment = albedo * bounced
        radiance += increment
        given, total = _norm(increment, interreflection.shares), _norm(radiance, interreflection.shares)
        contributions.append(given / max(total, np.finfo(np.float64).tiny))
    return radiance, contributions


def transfer_with_bounces(
    transfer: Transfer,  # (V, K) of the white scene
    albedo: ArrayLike,  # (V, 3) linear, in [0, 1]
    interreflection: Interreflection,
    tolerance: float = BOUNCE_TOLERANCE,
    max_bounces: int = DEFAULT_MAX_BOUNCES,
) -> tuple[NDArray[np.float32], list[float]]:
    """Transfer with interreflection, (V, K, 3) float32, and contributions as of `with_bounces`.

    It holds the albedo, which bounces tie to the geometry: exit radiance c = sum over k of T_kc L_kc, nothing more.
    The number of bounces and the contributions are those of a constant sky. That is enough for every coefficient:
    |a B a T_k| <= max |Y_k| a B a f, with f the visible fraction, as no number in B, a or f is negative.
    Raises InputError for arrays that do not fit.
    """
    transfer = np.asarray(transfer, np.float32)
    sky = np.repeat(visible_fraction(transfer)[:, None], 3, axis=1)
    albedo = _checked(albedo, sky, interreflection)
    _, contributions = with_bounces(sky, albedo, interreflection, tolerance, max_bounces)
    result = transfer[:, :, None] * albedo[:, None, :]
    for start in range(0, transfer.shape[1], BLOCK_COEFFICIENTS):
        block = slice(start, start + BLOCK_COEFFICIENTS)
        increment = result[:, block].copy()
        total = increment.copy()
        for _ in contributions:
            bounced = interreflection.bounce(increment.reshape(len(increment), -1))
            increment = bounced.reshape(increment.shape)
            increment *= albedo[:, None, :]
            total += increment
        result[:, block] = total
    return result, contributions


def _checked(albedo: ArrayLike, direct: Floats, interreflection: Interreflection) -> NDArray[np.float32]:
    """The albedo as float32; raises InputError unless it and the direct light fit the scene."""
    check_shape("the direct light", direct, (len(interreflection.hits), 3))
    return checked_albedo(albedo, len(interreflection.hits))


def _converged(contributions: list[float], tolerance: float) -> bool:
    """Whether the bounces to come would add less than the tolerance, were each as much weaker as the last one."""
    if not contributions:
        return False
    last, before = contributions[-1], contributions[-2] if len(contributions) > 1 else 1.0
    return last == 0.0 or (last < before and last * last / (before - last) < tolerance)


def _norm(values: Floats, shares: Floats) -> float:
    """L2 norm, each row counted by its share (V,); in float64 by one thread: the same bits everywhere."""
    return math.sqrt(np.einsum("v,vc,vc->", shares, values, values, dtype=np.float64))


def _described(array: Floats) -> str:
    return f"shape {array.shape}, values {array.min(initial=np.inf):g} to {array.max(initial=-np.inf):g}"
