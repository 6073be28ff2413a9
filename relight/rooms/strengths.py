"""How bright the lamps of a room are, and the clipped sky in its windows, told by the shadows and the falloff of light.

C = a S, S = K + sum over emitters of s_j Q_j + B C: what a place receives through windows of the sky that was seen
unclipped, from each emitter, and from the surfaces around it, which were seen to send out C. Under the right strengths
neighbours, which mostly are of one material, mostly agree in albedo (`albedo.fit`). Surfaces need no unknowns: that is
inverse global illumination. Source: Yu et al., "Inverse global illumination" (1999).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..albedo import fit, samples
from ..albedo.skylight import GROUND, SkyParts
from ..sh.sphere import fibonacci_sphere
from ..transfer.occluder import Occluder

PLACES, DIRECTIONS = 2500, 512
"""Places on the surface, and directions in which each looks for windows and for what the others send."""

USUAL_ALBEDO = 0.4
"""Median albedo, in luminance, of what is seen in a room, where nothing says more: white walls .7, wood .2."""

SPREAD, COLOR = 0.7, 0.07
"""Of the prior: log brightness of an emitter against the others, and its log colour against that it was captured in, of
a clipped sky white. With a colour as free as .2 the light of a lounge's lamp and of its windows drew near each other,
and with the lamp off the room turned blue."""

STRENGTH = 2e-3
"""Of the prior on how emitters differ, against a mean over pairs of places."""

STIFF = 1e3
"""How much stiffer the prior is for what all emitters have in common: pairs of a scanned office would rather have no
lamps at all (albedo .8), since the errors of its mesh make the light of lamps uneven. So the median albedo says how
bright all are together, and pairs say how much each is of it."""

LEAST_OPEN = 0.01
"""Mean part of the sky that places see, from which windows are an emitter; a scan's holes let in .002."""

ROUNDS = 3
"""Of solving for how emitters differ, and for what they have in common."""

DARK, SATURATED = 0.002, 0.97
"""Linear colours between which a place tells its light."""


class Places(NamedTuple):
    """N places of a room. vertices: (N,) indices. known: (N, 3) light of the sky that was seen unclipped. emitters:
    (E, N, 3) of each emitter at strength 1; with `windows` the last is what is not known of the sky. bounce: (N, 3)
    what other surfaces send. pairs, weights: of `samples.neighbor_pairs`. log_captured: (N, 3)."""

    vertices: NDArray[np.int64]
    known: NDArray[np.float64]
    emitters: NDArray[np.float64]
    windows: bool
    bounce: NDArray[np.float64]
    pairs: NDArray[np.int64]
    weights: NDArray[np.float64]
    log_captured: NDArray[np.float64]


class Strengths(NamedTuple):
    """radiance: (E, 3) of each emitter, unit of the captured colours. evidence: (E,) in [0, 1], how far the room, not
    the prior, decides each. gain: by how much neighbours agree better in albedo than in captured colour, as a part of
    the robust cost. albedo: median over the places, in luminance. share: (E,) of all light that places receive, and
    share_known, that of the sky that was seen unclipped."""

    radiance: NDArray[np.float64]
    evidence: NDArray[np.float64]
    gain: float
    albedo: float
    share: NDArray[np.float64]
    share_known: float


class _Emitters:
    """S = known + bounce + sum over j of exp(theta_j) Q_j, as `fit.solve` takes it."""

    def __init__(self, places: Places) -> None:
        self._base, self._of = places.known + places.bounce, places.emitters

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, E) of its logarithm."""
        parts = np.exp(np.clip(theta, -30.0, 30.0))[:, None] * self._of
        received = np.maximum(self._base + parts.sum(axis=0), 1e-12)
        return received, np.moveaxis(parts / received, 0, 2)


def places_of(
    occluder: Occluder,
    normals: NDArray[np.float32],  # (V, 3) unit, even along the surface
    captured: NDArray[np.float32],  # (V, 3) linear
    areas: NDArray[np.float64],  # (V,)
    usable: NDArray[np.bool_],  # (V,) what was seen from within, and is no lamp
    lamps: list[NDArray[np.int64]],  # rows of each
    lamp_light: NDArray[np.float32],  # (L, V) of `lamps.light_of`
    sky: CapturedSky | None,
    seed: int = 0,
) -> Places:
    """The Places of a room; there may be none."""
    told = usable & (captured.min(axis=1) > DARK) & (captured.max(axis=1) < SATURATED)
    vertices = samples.places(occluder, areas, told, PLACES, seed)
    directions = fibonacci_sphere(DIRECTIONS)
    unlit = captured.copy()
    for rows in lamps:
        unlit[rows] = 0.0
    free, bounce = _looks(occluder, normals, vertices, directions, unlit)
    emitters = [np.repeat(light[vertices, None].astype(np.float64), 3, axis=1) for light in lamp_light]
    known, windows = np.zeros((len(vertices), 3)), bool(len(vertices)) and float(free.sum(axis=1).mean()) > LEAST_OPEN
    if windows:
        known_part, unknown_part = sky_parts(sky, directions)
        known = free @ known_part
        emitters.append(free @ unknown_part)
    pairs, weights = samples.neighbor_pairs(occluder.origins[vertices].astype(np.float64))
    stacked = np.stack(emitters) if emitters else np.zeros((0, len(vertices), 3))
    logs = np.log(captured[vertices].astype(np.float64))
    return Places(vertices, known, stacked, windows, bounce, pairs, weights, logs)


def sky_parts(
    sky: CapturedSky | None, directions: NDArray[np.float64], image: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(known, unknown) radiance (K, 3) of directions that share the sphere, or of an image's texels: what was seen of
    the sky, and what exceeds it, at strength 1. Without a sky all is unknown, as bright all over, and
    has no colour."""
    if sky is None:
        upward = np.where(directions[:, 1:2] < 0.0, GROUND, 1.0)
        return np.zeros((len(directions), 3)), np.repeat(upward, 3, axis=1)
    parts = SkyParts.looked_up(sky, directions) if image else SkyParts.at(sky, directions)
    seen = np.maximum(1.0 - parts.unseen, 0.0)
    mean = parts.known.sum(axis=0) / max(float(seen.sum() / 3.0), 1e-9)
    return parts.known + parts.unseen * mean, parts.clipped


def solve(places: Places, colors: NDArray[np.float64]) -> Strengths | None:
    """The Strengths of the emitters, whose captured colours are (E, 3); None where they tell nothing."""
    light, count = _Emitters(places), len(places.emitters)
    if not count or len(places.vertices) < 64 or not places.emitters.any(axis=(1, 2)).all():
        return None
    tint = np.maximum(colors, 0.05)
    start = np.log(tint / luminance(tint)[:, None])
    bright = luminance(np.exp(places.log_captured))

    def albedo(theta: NDArray[np.float64], level: float) -> NDArray[np.float64]:
        return bright / luminance(light(theta + level)[0])

    prior = _prior(count)
    for _ in range(ROUNDS):
        low, high = -5.0, 8.0
        for _ in range(30):  # halves the range each time
            middle = 0.5 * (low + high)
            low, high = (low, middle) if np.median(albedo(start, middle)) < USUAL_ALBEDO else (middle, high)
        start = start + 0.5 * (low + high)
        found = fit.solve(light, places.log_captured, places.pairs, places.weights, start, prior)
        start = found.theta
    radiance = np.exp(found.theta)
    received = light(found.theta)[0]
    scale = fit.SCALES[-1]
    before = _cost(places, places.log_captured, scale)
    after = _cost(places, places.log_captured - np.log(received), scale)
    evidence = np.array([fit.evidence(found, _prior(count, 1.0), _brightness(count, k)) for k in range(count)])
    share = np.array([luminance(radiance[k] * places.emitters[k]).mean() for k in range(count)])
    return Strengths(
        radiance,
        evidence,
        1.0 - after / max(before, 1e-30),
        float(np.median(bright / luminance(received))),
        share / luminance(received).mean(),
        float(luminance(places.known).mean() / luminance(received).mean()),
    )


def _looks(occluder, smooth, vertices, directions, captured):
    """Free directions (N, K) float32, weighted by cosine to sum to the visible fraction, and the light (N, 3) float64
    that the others send. Backs of faces are black."""
    free = np.zeros((len(vertices), len(directions)), np.float32)
    bounce = np.zeros((len(vertices), 3))
    toward = np.ascontiguousarray(directions, np.float32)
    for start in range(0, len(vertices), samples.BATCH):
        some = vertices[start : start + samples.BATCH]
        cosine = smooth[some] @ toward.T
        place, direction = np.nonzero(cosine > 0.0)
        rays = np.hstack([occluder.origins[some][place], toward[direction]])
        _, faces, uv, normals = occluder.first_hits(rays)
        weight = cosine[place, direction] * np.float32(4.0 / len(directions))
        free[start + place, direction] = np.where(faces < 0, weight, np.float32(0.0))
        corners = occluder.faces[np.maximum(faces, 0)]
        outward = occluder.normals[corners].sum(axis=1)
        facing = np.einsum("ij,ij->i", normals, outward) * np.einsum("ij,ij->i", normals, toward[direction])
        front = (faces >= 0) & (facing < 0.0)
        shares = np.stack([1.0 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1) * (weight * front)[:, None]
        seen = np.einsum("rk,rkc->rc", shares, captured[corners])
        for color in range(3):
            bounce[start : start + len(some), color] = np.bincount(place, seen[:, color], len(some))
    return free, bounce


def _prior(count, stiff=STIFF):
    """(3 E, 3 E), colours outermost, in units of `fit.STRENGTH`."""
    gray = np.full((3, 3), 1.0 / 3.0)
    common = np.full((count, count), 1.0 / count)
    bright = np.eye(count) + (stiff - 1.0) * common
    parts = np.kron(gray / SPREAD**2, bright) + np.kron((np.eye(3) - gray) / COLOR**2, np.eye(count))
    return parts * (STRENGTH / fit.STRENGTH)


def _brightness(count, k):
    """(3 E, 1) unit column: the brightness of emitter k."""
    column = np.zeros((3, count))
    column[:, k] = 1.0 / np.sqrt(3.0)
    return column.reshape(-1, 1)


def _cost(places, logs, scale):
    """The robust mean over pairs of how much the brightness of neighbours differs."""
    difference = logs[places.pairs[:, 0]] - logs[places.pairs[:, 1]]
    square = (difference * difference).sum(axis=1) / scale**2
    return float(places.weights @ (square / (1.0 + square)))
