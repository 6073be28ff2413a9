"""The responses of splats from those of the vertices, and their compression within a tolerance."""

import warnings
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.threads import ROWS_AT_ONCE
from splat2mesh.scene.color import luminance
from splat2mesh.splats.splats import SH_C0, Splats

from ..planning.effect_errors import QUARTERS
from ..splats.binding import Binding
from ..splats.light_ratio import CURVE_OFFSET, CURVE_POWER
from ..splats.mirrored_places import Mix
from .basis import Basis, reduced, usual_moment
from .compression import WEIGHTS, Compressed, compress, near_clusters
from .lights import PortableLight
from .response import BANDS, LAMPS, Response, light_vector, turned


class LitRows(NamedTuple):
    """Responses of the lit splats. rows: (N, D) float32. counts: (N,) the visual weight of their errors. truth:
    (S, T, 3), light ratio of one row in `every` under lights of vectors (T, K, 3)."""

    rows: NDArray[np.float32]
    counts: Floats
    every: slice
    vectors: NDArray[np.float32]
    truth: Floats

    def compressed(self, basis: Basis, tolerance: float, seed: int) -> tuple[Compressed, list[dict[str, float]]]:
        """The fewest WEIGHTS within the tolerance, else the most; and a list of dicts with the bytes and error of each
        choice tried."""
        rows, counts, truth = self.rows, self.counts, self.truth
        base, small = basis.colors(self.vectors)
        size = np.sqrt(np.square(truth).mean(axis=(0, 2)))
        tried: list[dict[str, float]] = []
        near = near_clusters(rows, seed)
        for weights in WEIGHTS:
            found = compress(rows, counts, weights, near)
            off = base + np.einsum("nd,dtc->ntc", found.rows(self.every), small, optimize=True) - truth
            error = float((np.sqrt(np.square(off).mean(axis=(0, 2))) / np.where(size > 0.0, size, 1.0)).max())
            tried.append({"bytes": 2 + weights, "clusters": len(found.means), "error": error})
            if error <= tolerance:
                break
        else:
            message = f"the largest transfer leaves an error of {error:.3f}, {tolerance:g} was requested"
            warnings.warn(message, DataWarning, stacklevel=3)
        return found, tried


class CapturedColors(NamedTuple):
    """Of a capture: its splats, (V, 3) colours of the vertices, (V,) their areas, and the brightness of its light."""

    splats: Splats
    colors: Radiance
    shares: Floats
    brightness: float


def lit_rows(
    binding: Binding, response: Response, known: CapturedColors, vectors: NDArray[np.float32], truth: Floats
) -> tuple[LitRows, Basis]:
    """Return the responses of the lit splats and their Basis. truth: (V, T, 3), light ratios under lights of vectors
    (T, K, 3)."""
    even = np.sqrt(4.0 * np.pi) * (response.values[:, 0] + response.values[:, BANDS**2])  # under a constant sky
    even = np.maximum(known.brightness * even + response.values[:, LAMPS], np.float32(1e-3))
    counts: Floats = known.shares * _visible_error(even, known.colors)
    moment = usual_moment(known.brightness)
    rows, basis = reduced(response.values, counts, moment)
    rows, counts = _rows_and_counts(binding, rows, even, known.splats, basis.by_color(moment))
    every = slice(None, None, -(-len(rows) // ROWS_AT_ONCE))
    truth = np.stack([binding.spread(each)[every] for each in np.moveaxis(truth, 1, 0)], axis=1)
    return LitRows(rows, counts, every, vectors, truth), basis


def _rows_and_counts(
    binding: Binding, rows: NDArray[np.float32], even: NDArray[np.float32], splats: Splats, mix: Mix
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Rows (N, D) float32 of the lit splats from those of the vertices, and the visual weight of their errors, (N,).

    even: (V, 3) light ratio under a constant sky. mix: of rows.
    """
    parts = 4 if binding.mirrored is None else 1  # to save memory; colours of a row are in all of it
    rows = np.concatenate([binding.spread(part, mix) for part in np.array_split(rows, parts, axis=1)], axis=1)
    lit = splats if binding.lit.all() else splats.take(binding.lit)
    color = np.clip(SH_C0 * lit.sh[:, 0] + 0.5, 0.0, 1.0)
    return rows, _visible_error(binding.spread(even), color, lit.opacities).astype(np.float32)


def _visible_error(ratio: Radiance, color: Radiance, opacity: Floats | float = 1.0) -> Floats:
    """Weight of a squared error of the ratio, (N,)."""
    ratio = luminance(np.maximum(ratio, 1e-3))
    return opacity * ((luminance(color) + CURVE_OFFSET) * ratio ** (1.0 / CURVE_POWER - 1.0)) ** 2


def turned_vectors(lights: Sequence[PortableLight]) -> NDArray[np.float32]:
    """The vectors of lights in every quarter turn, (T, COEFFICIENTS, 3) float32."""
    vectors = []
    for light in lights:
        for angle in 360.0 * np.arange(QUARTERS) / QUARTERS:
            rest, whole = (light.exposure * turned(each, angle) for each in (light.rest, light.whole))
            vectors.append(light_vector(rest, whole, light.lamps))
    return np.stack(vectors).astype(np.float32)
