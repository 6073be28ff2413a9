"""Responses as a few numbers each: only what usual lights distinguish, compressed within a tolerance.

The second moment of usual lights, turned by all angles about the vertical, weights the rows: light comes from above and
from the horizon, and varies slowly. A part of the moment is even in all directions of a band, for unusual lights.
"""

import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.threads import ROWS_AT_ONCE, in_batches
from splat2mesh.scene.color import luminance
from splat2mesh.splats.splats import SH_C0, Splats

from ..light.environment import Environment
from ..light.skies import BUILTIN
from ..planning.effect_errors import QUARTERS
from ..sh import harmonics
from ..splats.binding import Binding
from ..splats.light_ratio import CURVE_OFFSET, CURVE_POWER
from ..splats.mirrored_places import Mix
from .compression import WEIGHTS, Compressed, compress, near_clusters, principal
from .lights import PortableLight, light_of
from .response import BANDS, COEFFICIENTS, LAMPS, SPREAD_BANDS, Response, light_vector, turned

if TYPE_CHECKING:
    from ..engine.appearance import Appearance

DIRECTIONS = 48
"""Numbers per response. Their error is a tenth of the error of the bytes."""

EVEN = 0.3
"""Part of the moment that is the same for all directions of a band."""

TURNS = 2 * BANDS
"""Angles whose mean is exact for products of BANDS bands."""


class Basis(NamedTuple):
    """A response is mean + row @ directions. mean: (COEFFICIENTS, 3), directions: (D, COEFFICIENTS, 3), float32."""

    mean: NDArray[np.float32]
    directions: NDArray[np.float32]

    def colors(self, vectors: Floats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The response of the mean and the directions to lights (T, COEFFICIENTS, 3): (T, 3) and (D, T, 3) float32."""
        vectors = np.asarray(vectors, np.float32)
        return np.einsum("kc,tkc->tc", self.mean, vectors), np.einsum("dkc,tkc->dtc", self.directions, vectors)

    def by_color(self, moment: NDArray[np.float64]) -> Mix:
        """The mix of rows (M, D) whose colours have parts of their own, for directions that are orthonormal by a
        moment (COEFFICIENTS, COEFFICIENTS)."""
        seen = np.einsum("dkc,kl,elc->cde", self.directions, moment, self.directions, optimize=True)

        def mix(mirrored: Floats, floor: Floats, own: Floats) -> Floats:
            return mirrored + sum(own[:, c, None] * ((floor - mirrored) @ seen[c]) for c in range(3))

        return mix


def usual_moment(brightness: float) -> NDArray[np.float64]:
    """Mean of v v^T over the built-in lights, their angles and colours, (COEFFICIENTS, COEFFICIENTS): v is the
    `light_vector` of a light of mean luminance `brightness`. Lamps stay as captured."""
    total = np.zeros((COEFFICIENTS, COEFFICIENTS))
    for name in BUILTIN:
        light = light_of(Environment.load(name), 1.0)
        for angle in np.arange(TURNS) * 360.0 / TURNS:
            vector = light_vector(turned(light.rest, angle), turned(light.whole, angle))
            total += vector @ vector.T / (3 * TURNS * len(BUILTIN) * light.mean**2)
    total *= brightness**2
    degree = harmonics.degrees_and_orders(BANDS)[0]
    band = np.concatenate([degree, BANDS + degree[: SPREAD_BANDS**2]])
    even = (np.bincount(band, np.diag(total)[:LAMPS]) / np.bincount(band))[band]
    total *= 1.0 - EVEN
    total[np.arange(LAMPS), np.arange(LAMPS)] += EVEN * even
    total[LAMPS, LAMPS] = 1.0
    return total


def reduced(
    values: NDArray[np.float32], counts: Floats, moment: NDArray[np.float64]
) -> tuple[NDArray[np.float32], Basis]:
    """(rows (V, D) float32, Basis) of responses (V, COEFFICIENTS, 3) with weights (V,), by `usual_moment`."""
    size, axes = np.linalg.eigh(moment)
    size = np.sqrt(np.maximum(size, 1e-9 * size.max()))
    ahead, back = (axes * size) @ axes.T, (axes / size) @ axes.T
    weighed = np.zeros((len(values), COEFFICIENTS * 3), np.float32)

    def weigh(part: slice) -> None:
        weighed[part] = np.einsum("jk,vkc->vjc", ahead, values[part], optimize=True).reshape(-1, COEFFICIENTS * 3)

    in_batches(weigh, len(values))
    mean, directions = principal(weighed, np.maximum(counts, 1e-9 * counts.max()), DIRECTIONS)
    rows = np.zeros((len(values), len(directions)), np.float32)

    def project(part: slice) -> None:
        rows[part] = (weighed[part] - mean) @ directions.T

    in_batches(project, len(values))
    shape = COEFFICIENTS, 3
    restored = np.einsum("jk,dkc->djc", back, directions.reshape(-1, *shape))
    return rows, Basis((back @ mean.reshape(shape)).astype(np.float32), restored.astype(np.float32))


class Packed(NamedTuple):
    """A Basis and its clusters as integers; each row is scale * integer.

    directions: (1 + D, COEFFICIENTS, 3) int16, the mean first; direction_scales: (1 + D,) float32. means: (C, D) int16,
    components: (C, W, D) int8, and scales (C, 1 + W) float32 of both.
    """

    directions: NDArray[np.int16]
    direction_scales: NDArray[np.float32]
    means: NDArray[np.int16]
    components: NDArray[np.int8]
    scales: NDArray[np.float32]

    def tobytes(self) -> bytes:
        """direction_scales, directions, scales, means, components, little-endian, concatenated."""
        kinds = {"direction_scales": "<f4", "directions": "<i2", "scales": "<f4", "means": "<i2", "components": "i1"}
        return b"".join(getattr(self, name).astype(kind).tobytes() for name, kind in kinds.items())


def packed(basis: Basis, found: Compressed) -> Packed:
    """The Packed of a Basis and of Compressed rows."""
    directions = np.concatenate([basis.mean[None], basis.directions])
    direction_scales = _peak(directions.reshape(len(directions), -1), 32767)
    scales = np.concatenate([_peak(found.means, 32767)[:, None], _peak(found.components, 127)], axis=1)
    return Packed(
        np.rint(directions / direction_scales[:, None, None]).astype(np.int16),
        direction_scales.astype(np.float32),
        np.rint(found.means / scales[:, :1]).astype(np.int16),
        np.rint(found.components / scales[:, 1:, None]).astype(np.int8),
        scales.astype(np.float32),
    )


def _peak(values: Floats, largest: float) -> Floats:
    return np.maximum(np.abs(values).max(axis=-1), 1e-20) / largest


class LitRows(NamedTuple):
    """Responses of the lit splats. rows: (N, D) float32, of a basis. counts: (N,) the visual weight of their errors.
    every, truth: one row in so many, and its light ratio (S, T, 3) under lights of vectors (T, K, 3)."""

    rows: NDArray[np.float32]
    basis: Basis
    counts: Floats
    every: slice
    vectors: NDArray[np.float32]
    truth: Floats

    def compressed(self, tolerance: float, seed: int) -> tuple[Compressed, list[dict[str, float]]]:
        """The fewest WEIGHTS within the tolerance, else the most; and a list of dicts with the bytes and error of each
        choice tried."""
        rows, counts, truth = self.rows, self.counts, self.truth
        base, small = self.basis.colors(self.vectors)
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


def lit_rows(
    binding: Binding,
    response: Response,
    splats: Splats,
    look: "Appearance",
    shares: Floats,
    lights: Sequence[PortableLight],
) -> LitRows:
    """Return the LitRows of a capture. shares: (V,) areas. lights: those that show the errors of bytes."""
    brightness = 1.0 if look.capture is None else float(look.capture["brightness"])
    even = np.sqrt(4.0 * np.pi) * (response.values[:, 0] + response.values[:, BANDS**2])  # under a constant sky
    even = np.maximum(brightness * even + response.values[:, LAMPS], np.float32(1e-3))
    moment = usual_moment(brightness)
    rows, basis = reduced(response.values, shares * _visible_error(even, look.captured), moment)
    mix, parts = basis.by_color(moment), 4 if binding.mirrored is None else 1
    # Parts save memory; colours of a row are in all of it.
    rows = np.concatenate([binding.spread(part, mix) for part in np.array_split(rows, parts, axis=1)], axis=1)
    lit = splats if binding.lit.all() else splats.take(binding.lit)
    color = np.clip(SH_C0 * lit.sh[:, 0] + 0.5, 0.0, 1.0)
    counts = _visible_error(binding.spread(even), color, lit.opacities).astype(np.float32)
    every, vectors = slice(None, None, -(-len(rows) // ROWS_AT_ONCE)), _turned_vectors(lights)
    truth = np.einsum("vkc,tkc->vtc", response.values, vectors, optimize=True)
    truth = np.stack([binding.spread(each)[every] for each in np.moveaxis(truth, 1, 0)], axis=1)
    return LitRows(rows, basis, counts, every, vectors, truth)


def _visible_error(ratio: Radiance, color: Radiance, opacity: Floats | float = 1.0) -> Floats:
    """Weight of a squared error of the ratio, (N,)."""
    ratio = luminance(np.maximum(ratio, 1e-3))
    return opacity * ((luminance(color) + CURVE_OFFSET) * ratio ** (1.0 / CURVE_POWER - 1.0)) ** 2


def _turned_vectors(lights: Sequence[PortableLight]) -> NDArray[np.float32]:
    """The vectors of lights in every quarter turn, (T, COEFFICIENTS, 3) float32."""
    vectors = []
    for light in lights:
        for angle in 360.0 * np.arange(QUARTERS) / QUARTERS:
            rest, whole = (light.exposure * turned(each, angle) for each in (light.rest, light.whole))
            vectors.append(light_vector(rest, whole, light.lamps))
    return np.stack(vectors).astype(np.float32)
