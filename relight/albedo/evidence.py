"""How well a light explains a capture: named cues on one footing, in nats, with gradient and curvature.

log C = log a + log S: captured colour, albedo, and what a surface receives from the light and from other surfaces,
which were seen to send out C. Every cue is a negative log likelihood of S or of the light itself; weights and noise
are those of `fitted.Fitted`. A slope below 1 of log C over log S is a nuisance parameter of pairs: noise of the mesh
in S attenuates it.
"""

from typing import NamedTuple

import numpy as np
import scipy
import scipy.optimize
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats
from splat2mesh.scene.color import luminance

from .fitted import Fitted
from .natural import AXES

PARALLEL = 0.97
"""Cosine between normals, 14 degrees, from which on neighbours differ in shadow and not in slope."""

DISTANT, DRAWN = 20_000, 400_000
"""Pairs of distant places that are compared, and drawn at random to find so many with one normal."""

SLOPES = np.linspace(0.0, 1.0, 11)
"""Slopes that are tried."""

LEAST = 1e-9
"""Light that counts as none."""

BRIGHTEST = 10.0
"""Log factor between lights that are told apart."""

LUMA = AXES[0]

SIDE = 0.2
"""Weight of a sky at the horizon beside that at the zenith: upright surfaces see it."""


def upper_sky(directions: Directions) -> NDArray[np.float64]:
    """(K, 1) weights of directions as parts of the sky, sum 1."""
    weight = np.maximum(directions[:, 1:2], 0.0) + SIDE
    return np.asarray(weight / weight.sum())


class SeenSky(NamedTuple):
    """A captured sky on K directions. log_radiance: (K, 3) of the part that was seen unclipped. seen, clipped: (K, 3)
    shares of the upper sky, as it lights level ground, that were seen unclipped and clipped."""

    log_radiance: NDArray[np.float64]
    seen: NDArray[np.float64]
    clipped: NDArray[np.float64]


class LitPlaces(NamedTuple):
    """N places on the surface. sky: (N, K) float32 cosine-weighted visibility of directions (K, 3). captured: (N, 3)
    linear. bounced: (N, 3) light from other surfaces. normals: (N, 3). pairs: (P, 2) of neighbours. weights: (P,)."""

    sky: NDArray[np.float32]
    directions: Directions
    captured: NDArray[np.float64]
    bounced: NDArray[np.float64]
    normals: Floats
    pairs: NDArray[np.int64]
    weights: NDArray[np.float64]


class Cue(NamedTuple):
    """nats: the lower, the better. gradient: (3 M,), hessian: (3 M, 3 M) of Gauss-Newton, colours outermost, or 0."""

    nats: float
    gradient: NDArray[np.float64] | float = 0.0
    hessian: NDArray[np.float64] | float = 0.0


class ReceivedLight(NamedTuple):
    """Light at places. total: (N, 3). slopes: of its logarithm in the parameters, 3 arrays (N, M), or None."""

    total: NDArray[np.float64]
    slopes: list[NDArray[np.float64]] | None

    def of_luminance(self) -> NDArray[np.float64]:
        """(N, 3 M) derivative of the log luminance, colours outermost."""
        assert self.slopes is not None
        parts = self.total * LUMA / luminance(self.total)[:, None]
        return np.concatenate([part[:, None] * slope for part, slope in zip(parts.T, self.slopes, strict=True)], axis=1)


class Evidence:
    """The cues of a capture."""

    def __init__(self, places: LitPlaces, sky: SeenSky | None, fitted: Fitted) -> None:
        self.places, self.sky, self.fitted = places, sky, fitted
        self.log_captured = np.log(places.captured)
        self._mean_captured = np.log(places.captured.mean(axis=0))
        self.log_luminance = np.log(luminance(places.captured))
        self.usual_albedo = fitted.albedo if sky is None else fitted.albedo_outdoors
        warmth, green = (fitted.warmth, fitted.warmth_spread), (fitted.green, fitted.green_spread)
        if sky is not None:
            warmth = fitted.warmth_outdoors, fitted.warmth_outdoors_spread
            green = fitted.green_outdoors, fitted.green_outdoors_spread
        self._usual_hue, self._hue_spread = np.array([warmth, green]).T
        cosine = _cosines(places.normals, places.pairs)
        level, slanted = cosine > PARALLEL, (cosine <= PARALLEL) & (cosine > 0.0)
        near, weights, noise = places.pairs, places.weights, fitted.difference
        distant = distant_pairs(places.normals)
        alike, of_slope = np.ones(len(distant)), fitted.parallel_slope
        self._pairs = {
            "parallel pairs": _Pairs(near[level], weights[level], noise, fitted.parallel, of_slope),
            "slanted pairs": _Pairs(near[slanted], weights[slanted], noise, fitted.slanted, fitted.slanted_slope),
            "distant pairs": _Pairs(distant, alike, fitted.distant_difference, fitted.distant, of_slope),
        }

    def sky_shares(self) -> NDArray[np.float64]:
        """(K, 2) shares of directions in a captured sky: clipped, and seen unclipped; (K, 0) without one."""
        if self.sky is None:
            return np.zeros((len(self.places.directions), 0))
        parts = np.stack([part.mean(axis=1) for part in (self.sky.clipped, self.sky.seen)], axis=1)
        return np.asarray(np.clip(3.0 * parts / upper_sky(self.places.directions), 0.0, 1.0))

    def direct(self, log_light: NDArray[np.float64]) -> NDArray[np.float64]:
        """(N, 3) direct light at places under log radiance (K, 3)."""
        return np.asarray(self.places.sky @ _radiance(log_light), np.float64)

    def received(self, log_light: NDArray[np.float64], basis: Floats | None = None) -> ReceivedLight:
        """What places receive of log radiance (K, 3); slopes in the parameters of a basis (K, M) of it, if given."""
        radiance, bounced, sky = _radiance(log_light), self.places.bounced, self.places.sky
        if basis is None:
            return ReceivedLight(np.maximum(self.direct(log_light) + bounced, LEAST), None)
        total, slopes = np.empty(bounced.shape), []
        for color in range(3):
            light = radiance[:, color, None]
            direct = sky @ np.concatenate([light, light * basis.astype(np.float32)], axis=1)
            total[:, color] = np.maximum(direct[:, 0] + bounced[:, color], LEAST)
            slopes.append(direct[:, 1:] / total[:, color, None])
        return ReceivedLight(total, slopes)

    def cues(self, log_light: NDArray[np.float64], basis: Floats | None = None) -> dict[str, Cue]:
        """Every Cue of log radiance (K, 3), with derivatives where a basis (K, M) of it is given."""
        received = self.received(log_light, basis)
        found = {name: pairs.cue(self.log_captured, received) for name, pairs in self._pairs.items()}
        found |= self._albedo(received)
        if self.sky is not None:
            found |= self._sky(self.sky, log_light, basis)
        return found

    def shading(self, light: NDArray[np.float64]) -> NDArray[np.float64]:
        """(L,) nats of pairs under lights (N, L), luminance that places receive."""
        logs = np.log(np.maximum(light, LEAST))
        return np.asarray(sum(pairs.shading(self.log_luminance, logs) for pairs in self._pairs.values()))

    def lacking(self, log_light: NDArray[np.float64]) -> float:
        """Log factor on log radiance (K, 3) under which it is as bright as albedo and sky say.

        The median albedo is the usual one; the part of the sky that was seen unclipped is as bright as it looked. Each
        errs with the part of the light that it does not know. Pairs have no say: in noisy meshes bounced light explains
        too much of them.
        """
        direct, bounced = (luminance(part) for part in (self.direct(log_light), self.places.bounced))

        def off(factor: float) -> float:
            light = np.maximum(np.exp(factor) * direct + bounced, LEAST)
            return float(np.median(self.log_luminance - np.log(light)) - np.log(self.usual_albedo))

        usual = scipy.optimize.brentq(off, -BRIGHTEST, BRIGHTEST) if off(-BRIGHTEST) > 0.0 > off(BRIGHTEST) else 0.0
        if self.sky is None:
            return float(usual)
        radiance, looked = _radiance(log_light), np.exp(self.sky.log_radiance)
        seen = float((self.sky.seen * radiance).sum())
        known = seen / max(float((upper_sky(self.places.directions) / 3.0 * radiance).sum()), LEAST)
        if known <= LEAST:
            return float(usual)
        weight = known**2 / (known**2 + (1.0 - min(known, 1.0)) ** 2)
        return float((1.0 - weight) * usual + weight * np.log(float((self.sky.seen * looked).sum()) / seen))

    def _albedo(self, received: ReceivedLight) -> dict[str, Cue]:
        """How usual the albedo is: its median luminance, and the hue of its mean, weighted by the light."""
        fitted, mean = self.fitted, received.total.mean(axis=0)
        level = float(np.median(self.log_luminance - np.log(luminance(received.total))) - np.log(self.usual_albedo))
        hue = AXES[1:] @ (self._mean_captured - np.log(mean)) - self._usual_hue
        off = {"albedo": ([level], [fitted.albedo_spread]), "hue": (hue, self._hue_spread)}
        if received.slopes is None:
            return {name: Cue(0.5 * float(np.sum(np.divide(*each) ** 2))) for name, each in off.items()}
        means = [light @ slope / light.sum() for light, slope in zip(received.total.T, received.slopes, strict=True)]
        rows = {
            "albedo": [-received.of_luminance().mean(axis=0)],
            "hue": [
                -np.concatenate([part * mean for part, mean in zip(axis, means, strict=True)]) for axis in AXES[1:]
            ],
        }
        return {name: _quadratic(np.array(off[name][0]), np.array(off[name][1]), np.array(rows[name])) for name in off}

    def _sky(self, sky: SeenSky, log_light: NDArray[np.float64], basis: Floats | None) -> dict[str, Cue]:
        """The sky that was seen: as bright as it looked, and where it was clipped as bright as clipped skies are."""
        fitted = self.fitted
        off = (log_light - sky.log_radiance) / fitted.sky_noise
        robust = 1.0 / (1.0 + off**2)
        over = (log_light - fitted.clipped_level) / fitted.clipped_noise
        held = 1.0 / (1.0 + over**2)
        parts = {
            "sky": (sky.seen, off, robust, fitted.sky, fitted.sky_noise),
            "clipped sky": (sky.clipped, over, held, fitted.clipped, fitted.clipped_noise),
        }
        found = {}
        for name, (share, each, weight, nats, noise) in parts.items():
            cost = nats * float((share * each**2 * weight).sum())
            if basis is None:
                found[name] = Cue(cost)
                continue
            pull = 2.0 * nats / noise * share * each * weight**2
            curve = 2.0 * nats / noise**2 * share * weight**2
            blocks = [(basis.T * column) @ basis for column in curve.T]
            found[name] = Cue(cost, (pull.T @ basis).ravel(), scipy.linalg.block_diag(*blocks))
        return found


def _radiance(logs: NDArray[np.float64]) -> NDArray[np.float32]:
    """Radiance of log radiance, any shape, within the range of float32."""
    return np.exp(np.clip(logs, -30.0, 30.0)).astype(np.float32)


def distant_pairs(normals: Floats, seed: int = 0) -> NDArray[np.int64]:
    """At most DISTANT pairs (P, 2) of places anywhere whose normals (N, 3) agree."""
    pairs = np.random.default_rng(seed).integers(len(normals), size=(DRAWN, 2))
    return pairs[(_cosines(normals, pairs) > PARALLEL) & (pairs[:, 0] != pairs[:, 1])][:DISTANT]


def _cosines(normals: Floats, pairs: NDArray[np.int64]) -> Floats:
    return np.einsum("ij,ij->i", normals[pairs[:, 0]], normals[pairs[:, 1]])


class _Pairs:
    """Places that may share a material: differences of log albedo under Geman and McClure's function.

    pairs: (P, 2). weights: (P,). difference: of log albedo (RGB), beyond which two places are of two materials. weight:
    nats of all pairs. of_slope: nats against a slope other than 1.
    """

    def __init__(
        self,
        pairs: NDArray[np.int64],
        weights: NDArray[np.float64],
        difference: float,
        weight: float,
        of_slope: float,
    ) -> None:
        self._first, self._second = pairs.T
        self._weights = weights / max(float(weights.sum()), 1e-12)
        self._noise, self._weight, self._of_slope = difference, weight, of_slope

    def cue(self, log_captured: NDArray[np.float64], received: ReceivedLight) -> Cue:
        """The Cue of log colours (N, 3)."""
        seen, light = self._differences(log_captured), self._differences(np.log(received.total))
        square, across, own = (np.einsum("pc,pc->p", a, b) for a, b in ((seen, seen), (seen, light), (light, light)))
        nats, slope = self._best([square - 2.0 * s * across + s * s * own for s in SLOPES])
        if received.slopes is None or slope == 0.0:
            return Cue(nats)
        count, rest = len(log_captured), seen - slope * light
        near = 1.0 + np.einsum("pc,pc->p", rest, rest) / self._noise**2
        robust = self._weight * self._weights / near**2 / self._noise**2
        graph = scipy.sparse.coo_array((robust, (self._first, self._second)), (count, count)).tocsr()
        graph = graph + graph.T
        degree = np.asarray(graph.sum(axis=1)).ravel()
        gradient, blocks = [], []
        for color, change in enumerate(received.slopes):
            force = robust * rest[:, color]
            pull = np.bincount(self._second, force, count) - np.bincount(self._first, force, count)
            gradient.append(2.0 * slope * (pull @ change))
            blocks.append(2.0 * slope**2 * (change.T @ (degree[:, None] * change - graph @ change)))
        return Cue(nats, np.concatenate(gradient), scipy.linalg.block_diag(*blocks))

    def shading(self, logs: NDArray[np.float64], light: NDArray[np.float64]) -> NDArray[np.float64]:
        """(L,) nats of log luminances (N,) under log lights (N, L), all colours alike."""
        seen, light = self._differences(logs)[:, None], self._differences(light)
        tried = []
        for slope in SLOPES[4::2]:
            square = 3.0 * (seen - slope * light) ** 2 / self._noise**2
            tried.append(
                self._weight * (self._weights @ (square / (1.0 + square))) + self._of_slope * (1.0 - slope) ** 2
            )
        return np.asarray(np.min(tried, axis=0))

    def _best(self, squares: list[NDArray[np.float64]]) -> tuple[float, float]:
        """Nats and slope of the best slope, of squared differences (P,) under each of SLOPES."""
        costs = []
        for slope, square in zip(SLOPES, squares, strict=True):
            scaled = np.maximum(square, 0.0) / self._noise**2
            cost = float(self._weights @ (scaled / (1.0 + scaled)))
            costs.append(self._weight * cost + self._of_slope * (1.0 - slope) ** 2)
        best = int(np.argmin(costs))
        return costs[best], float(SLOPES[best])

    def _differences(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(values[self._first] - values[self._second])


def _quadratic(off: NDArray[np.float64], spread: NDArray[np.float64], rows: NDArray[np.float64]) -> Cue:
    """The Cue of deviations (R,) with spreads (R,) and derivatives (R, 3 M)."""
    scaled = rows / spread[:, None]
    return Cue(0.5 * float(np.sum((off / spread) ** 2)), (off / spread) @ scaled, scaled.T @ scaled)
