"""A small sample of a scene's vertices and their visibility, on which plans measure instead of the whole scene."""

import copy
import platform
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats, Indices, Mask, Radiance
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.base.threads import cores

from ..light.projections import pooled, row_solid_angles, texel_directions
from ..light.sun_split import GRID
from ..sh import harmonics
from ..transfer import consensus, sampling
from ..transfer.occluder import BATCH_RAYS, Occluder
from ..transfer.store import Cache, array_key
from ..transfer.volume import Foliage

SCAN_VERTICES, SCAN_RAYS = 4096, 16
"""A coarse look at more vertices, for shadows so small that the sample may miss them. A shadow on a thousandth of the
vertices, 3% of error if it is deep, escapes 4096 of them once in sixty times."""

TIMED_BATCHES, STRETCHES, STRETCH_VERTICES = 5, 4, 256
"""How the time of a ray is measured: batches of vertices that lie side by side, as in the work, where rays find in the
caches what earlier rays left there. Of vertices far apart they take longer, the more the larger the mesh. The median
counts: the first batch wakes threads."""


BLOCKS = 32
"""Blocks of vertices by which the share of the rays is measured that neighbours do not predict: 65,000 rays in all."""

TURNS = 8
"""Rotations for which a plan must hold, 45 degrees apart. Between them errors change by a tenth or so."""


class Sample:
    """S vertices, evenly along a curve through the scene, and D directions, evenly on the sphere.

    rows: (S,) indices. weights: (S,) float64, what share of the scene each stands for; sum 1.
    directions: (D, 3). open, seen: (S, D) float32, 4 / D times the cosine, without and with what hides the direction:
    products with the radiance of the directions are exit radiance of white vertices.
    solid: (S,) float32 in [0, 1], how far each row is a surface: 1 unless the sample is `thickened`.
    hidden: the share of the light of an even sky that is hidden, root mean square, by the scan.
    ray_s: seconds per ray of the work, on this machine and scene. unsure: share of the rays whose outcome neighbours
    do not predict. rays: shot in all. traced_share: of the vertices.
    """

    open: NDArray[np.float32]
    seen: NDArray[np.float32]

    def __init__(
        self,
        occluder: Occluder,  # of the scene
        size: int,  # wanted S
        directions: int,  # D
        traced: Mask | None = None,  # (V,) bool, of which vertices it is a sample: those that light is traced for
        cache: Cache | None = None,  # of the scene: what no light changes is kept there
    ) -> None:
        self.occluder, self._traced = occluder, traced
        self.traced_share = 1.0 if traced is None else float(traced.mean())
        self._foliage: Foliage | None = None
        cache = Cache() if cache is None else cache
        key = array_key(traced), size, directions, platform.node(), cores()
        if not cache.restored(partial(self._restore, directions), "sample", *key):
            order = self._order()
            self.rows = _evenly(order, size)
            self.weights = np.full(len(self.rows), 1.0 / max(len(self.rows), 1))
            self.normals, self.rays = occluder.normals[self.rows], 0
            self._look(directions)
            self.ray_s, shot = ray_seconds(occluder, order)
            self.rays += shot
            self.unsure = self._unsure(order)
            self.hidden = self._scan(_evenly(order, SCAN_VERTICES))
            cache.put("sample", *key, **self._arrays())
        self.solid = np.ones(len(self.rows), np.float32)

    def _arrays(self) -> dict[str, ArrayLike]:
        names = "rows", "weights", "ray_s", "unsure", "hidden", "rays"
        return {"dark": np.packbits(self.seen != self.open, axis=1), **{name: getattr(self, name) for name in names}}

    def _restore(self, directions: int, kept: Mapping[str, NDArray[Any]]) -> bool:
        """Take over what was kept: True. Raises ValueError or KeyError for what does not fit."""
        rows, weights = kept["rows"], kept["weights"]
        if rows.dtype != np.int64 or weights.dtype != np.float64 or rows.shape != weights.shape:
            raise ValueError("a kept sample is of another kind")
        beyond = rows.max(initial=0) >= len(self.occluder.origins)
        if rows.min(initial=0) < 0 or beyond or not np.isfinite(weights).all():
            raise ValueError("a kept sample is of another scene")
        dark = np.unpackbits(kept["dark"], axis=1, count=directions).astype(bool)
        self.rows, self.weights, self.hidden = rows, weights, float(kept["hidden"])
        self.normals = self.occluder.normals[rows]
        self._face(directions)
        self.seen = self.open.copy()
        self.seen[dark] = 0.0  # or an IndexError
        self.ray_s, self.unsure, self.rays = float(kept["ray_s"]), float(kept["unsure"]), int(kept["rays"])
        if not (0.0 < self.ray_s < np.inf and 0.0 <= self.unsure <= 1.0 and 0.0 <= self.hidden <= 1.0):
            raise ValueError("a kept sample is not finite")
        return True

    def finer(self, times: int) -> "Sample":
        """The same Sample that looks in so many times as many directions; its `rays` are those of this look."""
        other = copy.copy(self)
        other.rays = 0
        other._look(times * len(self.directions))
        if self._foliage is not None:
            other._thicken(self._foliage)
        return other

    def wider(self, count: int) -> "Sample":
        """So many vertices of the same scene, of which `open` and `seen` are not known."""
        other, rows = copy.copy(self), _evenly(self._order(), count)
        other._place(rows, np.full(len(rows), 1.0 / max(len(rows), 1)))
        return other

    def lit(self, count: int, square: Floats) -> "Sample":
        """About so many of these vertices: half of them evenly, half in proportion to the square of their light, (S,),
        for few vertices have most of it. Of a Sample that is `wider`. Weights sum to 1 but for chance."""
        share = self.weights * square
        whole = float(share.sum())
        wanted = (self.weights + share / whole) / 2.0 if whole > 0.0 else self.weights
        chance = np.minimum(count * wanted, 1.0)
        edges = np.cumsum(chance)
        at = np.searchsorted(edges, np.arange(0.5, edges[-1] if len(edges) else 0.0))
        other = copy.copy(self)
        other._place(self.rows[at], self.weights[at] / chance[at])
        return other

    def _order(self) -> Indices:
        """The vertices that light is traced for, along a curve through space."""
        order = self.occluder.ranked[0]
        return order if self._traced is None else order[self._traced[order]]

    def _place(self, rows: Indices, weights: NDArray[np.float64]) -> None:
        """Take these vertices."""
        self.rows, self.weights = rows, weights
        self.normals = self.occluder.normals[rows]
        leaf = np.zeros(len(self.occluder.origins), np.float32)
        if self._foliage is not None:
            leaf[self._foliage.rows] = self._foliage.share[:, 0]
        self.solid = 1.0 - leaf[rows]

    def thickened(self, foliage: Foliage) -> tuple["Sample", float]:
        """(The same Sample with leaves and grass as volumes, seconds for a direction from all probes of a Foliage)."""
        foliage.probe_count  # noqa: B018  is found once, and not timed
        other = copy.copy(self)
        start = time.perf_counter()
        marches = other._thicken(foliage)
        march_s = (time.perf_counter() - start) / max(1, marches) / cores()
        return other, march_s * foliage.probe_count

    def _thicken(self, foliage: Foliage) -> int:
        """Take leaves and grass for volumes; how many marches it took."""
        share, free, marches = foliage.seen(self.rows, self.directions)
        share, even = share[:, None], np.float32(1.0 / len(self.directions))
        self.open = self.open + share * (even - self.open)
        self.seen = self.seen + share * (even * free - self.seen)
        self.solid, self._foliage = 1.0 - share[:, 0], foliage
        return marches

    def _look(self, directions: int) -> None:
        """Look in D directions, as surfaces hide them."""
        cosine = self._face(directions)
        self.seen = self.open.copy()
        per_batch = max(1, BATCH_RAYS // directions)
        for begin in range(0, len(self.rows), per_batch):
            row, column = np.nonzero(cosine[begin : begin + per_batch])
            origins = self.occluder.origins[self.rows[row + begin]]
            hidden = self.occluder.occluded(np.concatenate([origins, self.directions[column]], axis=1))
            self.seen[row[hidden] + begin, column[hidden]] = 0.0
            self.rays += len(hidden)

    def _face(self, directions: int) -> NDArray[np.float32]:
        """Choose D directions, as nothing hides them: their cosines, (S, D)."""
        self.directions = fibonacci_sphere(directions).astype(np.float32)
        cosine = np.maximum(self.normals @ self.directions.T, np.float32(0.0))
        self.open = cosine * np.float32(4.0 / directions)
        return cosine

    def mean_square(self, values: Floats) -> NDArray[np.float64]:
        """Weighted mean over the vertices of squared values (S, ...), summed over the last axis (colours)."""
        return np.tensordot(self.weights, np.square(values, dtype=np.float64).sum(axis=-1), axes=(0, 0))

    def _unsure(self, order: Indices) -> float:
        """The share of the rays that `consensus` traces, by blocks along the curve."""
        azimuths = sampling.fibonacci_azimuths(consensus.LEAST_RAYS)
        begins = np.linspace(0, len(order), BLOCKS, endpoint=False).astype(int)
        blocks = [order[begin : begin + consensus.BLOCK] for begin in begins]
        rows = np.concatenate([block for block in blocks if len(block) == consensus.BLOCK] or blocks[:1])
        shot = np.zeros((len(rows), len(azimuths), 6), np.float32)
        offsets = sampling.ranked_offsets(np.arange(len(rows)), 1)
        sampling.shoot_at(self.occluder.origins[rows], self.occluder.normals[rows], azimuths, offsets, shot)
        traced = consensus.hidden_rays(self.occluder, shot)[1]
        self.rays += traced
        return traced / max(1, len(rows) * len(azimuths))

    def _scan(self, rows: Indices) -> float:
        """Root mean square of the hidden fraction, by two halves of the rays, so that noise cancels."""
        shot = np.zeros((len(rows), SCAN_RAYS, 6), np.float32)
        azimuths = sampling.fibonacci_azimuths(SCAN_RAYS)
        sampling.shoot(self.occluder.origins[rows], self.occluder.normals[rows], azimuths, 1, shot)
        hidden = self.occluder.occluded(shot)
        self.rays += hidden.size
        product = hidden[:, 0::2].mean(axis=1) * hidden[:, 1::2].mean(axis=1)
        return float(np.sqrt(product.sum() / max(len(rows), 1)))


def ray_seconds(occluder: Occluder, order: Indices, batches: int = TIMED_BATCHES) -> tuple[float, int]:
    """Seconds per bare ray of the work, from stretches of the vertices in an order along a curve; and rays shot."""
    begins = np.linspace(0, len(order), batches * STRETCHES, endpoint=False).astype(int)
    azimuths, seconds, rays = sampling.fibonacci_azimuths(SCAN_RAYS), [], 0
    for number in range(batches):
        rows = np.concatenate([order[begin : begin + STRETCH_VERTICES] for begin in begins[number::batches]])
        shot = np.zeros((len(rows), SCAN_RAYS, 6), np.float32)
        sampling.shoot(occluder.origins[rows], occluder.normals[rows], azimuths, 1, shot)
        start = time.perf_counter()
        rays += occluder.occluded(shot).size
        seconds.append((time.perf_counter() - start) / max(1, len(rows) * SCAN_RAYS))
    return float(np.median(seconds)), rays


def _evenly(order: Indices, wanted: int) -> Indices:
    """So many of the vertices in an order, evenly; all where there are fewer."""
    count = min(wanted, len(order))
    return order[((np.arange(count) + 0.5) * len(order) / max(count, 1)).astype(int)]


def cells_of(image: Radiance) -> NDArray[np.float64]:
    """Radiance (64, 128, 3) float64 of the cells of an unrotated lat-long image."""
    return pooled(image, GRID)


def turned(image_cells: Floats, directions: int) -> NDArray[np.float64]:
    """Radiance from D directions in every rotation of the cells: (D, TURNS, 3) float64.

    The light of each cell goes to the nearest direction; none is lost.
    """
    nearest = _nearest(directions)
    areas = np.broadcast_to(row_solid_angles(*GRID).reshape(-1, 1), GRID).ravel()
    energy = image_cells.reshape(-1, 3) * areas[:, None]
    light: NDArray[np.float64] = np.zeros((directions, TURNS, 3))
    for turn in range(TURNS):
        for color in range(3):
            light[:, turn, color] = np.bincount(nearest[turn], energy[:, color], directions)
    return light * (directions / (4.0 * np.pi))


@lru_cache(4)
def basis(directions: int) -> NDArray[np.float64]:
    """SH basis at the directions: (D, K) float64, all bands."""
    return np.asarray(harmonics.evaluate(fibonacci_sphere(directions), harmonics.MAX_BANDS), np.float64)


@lru_cache(4)
def _nearest(directions: int) -> NDArray[np.int64]:
    """Index of the nearest of D directions for every cell in every rotation: (TURNS, cells)."""
    toward = texel_directions(*GRID).reshape(-1, 3)
    tree = scipy.spatial.cKDTree(fibonacci_sphere(directions))
    found = []
    for turn in range(TURNS):
        angle = 2.0 * np.pi * turn / TURNS
        c, s = np.cos(angle), np.sin(angle)
        rotated = toward @ np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]).T
        found.append(tree.query(rotated, workers=-1)[1])
    return np.stack(found)


@dataclass(frozen=True, eq=False)
class PlannedScene:
    """A scene as its planning sees it.

    occluder: of the whole scene. albedo: (V, 3) linear, white without. foliage: where it has one. traced: (V,) bool,
    the vertices that light is traced for; all without. cache: its Cache, or None.
    """

    occluder: Occluder
    albedo: Radiance | None = None
    foliage: Foliage | None = None
    traced: Mask | None = None
    cache: Cache | None = None
