"""Brightness of the lamps of a room and of the clipped sky in its windows, from the shadows and the falloff of light.

C = a S, S = K + sum over emitters of s_j Q_j + B C: what a place receives through windows from the unclipped
sky, from each emitter, and from the surfaces around it, which were seen to send out C. Under the right strengths
neighbours, which mostly share a material, mostly agree in albedo (`pair_fit`). Surfaces need no unknowns: that is
inverse global illumination. Source: Yu et al., "Inverse global illumination" (1999).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.scene.color import luminance

from . import pair_fit
from .received import RoomIrradiance

USUAL_ALBEDO, ALBEDO_SPREAD = 0.4, 0.25
"""Median albedo, in luminance, of what is seen in a room, where nothing says more (white walls .7, wood .2), and how
far rooms lie from it, as a logarithm: .3 to .5 mostly."""

USUAL_EXCESS, EXCESS_SPREAD = 5.0, 1.0
"""Mean radiance of the sky that a photograph of a room shows white in its windows, over that of white, and how far
rooms lie from it, as a logarithm; of lamps nothing is usual: small ones are bright. Where surfaces mostly light each
other, a tenth of the median albedo moves the strength of lamps and sky by half: by the albedo alone those of a trained
parlour came out 7 and 3.5 times too strong, and its albedo 1.4 times as wrong as with both."""

SPREAD, COLOR = 1.0, 0.07
"""Of the prior: log brightness of an emitter against the others, and its log colour against that it was captured in, of
a clipped sky white. With a colour as free as .2 the light of a lounge's lamp and of its windows drew near each other,
and with the lamp off the room turned blue."""

PATCH_SPREAD, PATCH_COLOR, PATCH_REACH_DEG = 2.0, 1.0, 15.0
"""The same for parts of the sky in the windows against the whole of it, and how far they are alike: a sun, clipped as
the sky around it, is another light, and its colour is its own. A low one has 2.4 times as much red as blue beside a
blue sky: with colours within .25 its glow stayed on a parlour's wall. Only differences are free: the mean colour of the
parts keeps to COLOR, or windows take up the errors of a mesh as a tint."""

LEAST_OWN = 1e-4
"""Part of PATCH_COLOR^2 by which the mean colour of the parts may differ from that of the whole."""

WEIGHT = 10.0
"""Of the prior on how emitters differ, over `pair_fit.STRENGTH`."""

STIFF = 1e3
"""Extra stiffness of the prior on the common brightness of all emitters: pairs of a scanned office would rather have no
lamps at all (albedo .8), since the errors of its mesh make the light of lamps uneven. So the median albedo decides the
brightness of all together, and pairs decide the share of each."""

LOG_STRENGTHS = -8.0, 8.0
"""Range, about the start, in which the logarithm of the strength common to all emitters is sought."""

SAMPLES = 4
"""Samples of places whose strengths are averaged. From one to another of a trained parlour the lamp came out between 20
and 31, and the clipped sky between 10.4 and 14.8; true are 22 and 12.9."""

SOLVER_ROUNDS = 3
"""Rounds that alternate between the differences of emitters and their common part."""


class Strengths(NamedTuple):
    """radiance: (L, 3) of each lamp, and patches: (W, 3) of each patch of the sky, unit of the captured colours.
    evidence: (L + 1,) in [0, 1], or (L,) without windows, how far the room, not the prior, decides each lamp and the
    windows as a whole. gain: by how much neighbours agree better in albedo than in captured colour, as a part of
    the robust cost. albedo: median over the places, in luminance. share: as `evidence`, of all light that places
    receive, and share_known, that of the sky that was seen unclipped."""

    radiance: NDArray[np.float64]
    patches: NDArray[np.float64]
    evidence: NDArray[np.float64]
    gain: float
    albedo: float
    share: NDArray[np.float64]
    share_known: float


class _Emitters:
    """S = known + bounce + sum over j of exp(theta_j) Q_j, as `pair_fit.solve` takes it."""

    def __init__(self, places: RoomIrradiance) -> None:
        self._base, self._of = places.known + places.bounce, places.emitters

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, E) of its logarithm."""
        parts = np.exp(np.clip(theta, -30.0, 30.0))[:, None] * self._of
        received = np.maximum(self._base + parts.sum(axis=0), 1e-12)
        return received, np.moveaxis(parts / received, 0, 2)


def solve(places: RoomIrradiance, colors: NDArray[np.float64]) -> Strengths | None:
    """Solve for the Strengths of a room's emitters; None where the places determine nothing. colors: (L, 3) captured,
    linear, of the lamps."""
    from scipy.optimize import minimize_scalar  # most scenes are no room, and it takes .3 s to import

    light, count, lamps = _Emitters(places), len(places.emitters), places.lamps
    if not count or len(places.vertices) < 64 or not places.emitters.any(axis=(1, 2)).all():
        return None
    tint = np.maximum(np.concatenate([colors, np.ones((count - lamps, 3))]), 0.05)
    start = np.log(tint / luminance(tint)[:, None])
    bright = luminance(np.exp(places.log_captured))

    def unusual(level: float) -> float:
        albedo = np.median(bright / luminance(light(start + level)[0]))
        off = np.log(albedo / USUAL_ALBEDO) / ALBEDO_SPREAD
        if lamps == count:
            return float(off**2)
        brighter = float((start[lamps:] + level).mean()) - np.log(USUAL_EXCESS)
        return float(off**2 + (brighter / EXCESS_SPREAD) ** 2)

    prior = _prior(places)
    for _ in range(SOLVER_ROUNDS):
        start = start + minimize_scalar(unusual, bounds=LOG_STRENGTHS, method="bounded").x
        found = pair_fit.solve(light, places.log_captured, places.pairs, places.weights, start, prior)
        start = found.theta
    radiance = np.exp(found.theta)
    received = light(found.theta)[0]
    scale = pair_fit.SCALES[-1]
    before = _cost(places, places.log_captured, scale)
    after = _cost(places, places.log_captured - np.log(received), scale)
    groups = [[k] for k in range(lamps)] + [list(range(lamps, count))] * (count > lamps)
    loose = _prior(places, 1.0)
    evidence = np.array([pair_fit.evidence(found, loose, _brightness(count, group)) for group in groups])
    brought = luminance(radiance[:, None] * places.emitters).mean(axis=1)
    return Strengths(
        radiance[:lamps],
        radiance[lamps:],
        evidence,
        1.0 - after / max(before, 1e-30),
        float(np.median(bright / luminance(received))),
        np.array([brought[group].sum() for group in groups]) / luminance(received).mean(),
        float(luminance(places.known).mean() / luminance(received).mean()),
    )


def averaged(found: Sequence[tuple[RoomIrradiance, Strengths | None]]) -> Strengths | None:
    """Average the strengths that several samples of places give for the same lamps, None where the first is.

    Samples without a result, or with windows where the first has none, do not count. The patches are those of the
    first: means of logarithms, of those of the patches that are nearest in the others; means of all else.
    """
    patches, first = found[0][0].patches, found[0][1]
    if first is None:
        return None
    pairs = [(places, each) for places, each in found if each is not None and each.share.shape == first.share.shape]
    radiances, skies = [], []
    for places, each in pairs:
        radiances.append(np.log(np.maximum(each.radiance, 1e-30)))
        nearest = (patches @ places.patches.T).argmax(axis=1) if len(places.patches) else np.zeros(0, np.int64)
        skies.append(np.log(np.maximum(each.patches[nearest], 1e-30)))
    several = [each for _, each in pairs]
    return Strengths(
        np.exp(np.mean(radiances, axis=0)),
        np.exp(np.mean(skies, axis=0)),
        np.mean([each.evidence for each in several], axis=0),
        float(np.mean([each.gain for each in several])),
        float(np.mean([each.albedo for each in several])),
        np.mean([each.share for each in several], axis=0),
        float(np.mean([each.share_known for each in several])),
    )


def _prior(places: RoomIrradiance, stiff: float = STIFF) -> NDArray[np.float64]:
    """(3 E, 3 E), colours outermost, in units of `pair_fit.STRENGTH`."""
    count, lamps = len(places.emitters), places.lamps
    apart = np.degrees(np.arccos(np.clip(places.patches @ places.patches.T, -1.0, 1.0)))
    alike = np.exp(-0.5 * (apart / PATCH_REACH_DEG) ** 2)

    def precision(whole: float, part: float, differ: NDArray[np.float64]) -> NDArray[np.float64]:
        spread = whole**2 * np.eye(count)
        spread[lamps:, lamps:] = whole**2 + part**2 * differ
        return np.asarray(np.linalg.inv(spread), np.float64)

    common = _common(places)
    gray = np.full((3, 3), 1.0 / 3.0)
    own = np.eye(count - lamps)
    bright = precision(SPREAD, PATCH_SPREAD, alike + 0.01 * own)
    bright += (stiff - 1.0) / SPREAD**2 * np.outer(common, common)
    beside = own - 1.0 / max(count - lamps, 1)
    color = precision(COLOR, PATCH_COLOR, beside @ alike @ beside + LEAST_OWN * own)
    parts = np.kron(gray, bright) + np.kron(np.eye(3) - gray, color)
    return parts * WEIGHT


def _common(places: RoomIrradiance) -> NDArray[np.float64]:
    """(E,) unit: all emitters alike, the patches of the sky together as much as one lamp."""
    common = np.ones(len(places.emitters))
    common[places.lamps :] /= max(len(places.patches), 1)
    return common / np.linalg.norm(common)


def _brightness(count: int, group: list[int]) -> NDArray[np.float64]:
    """(3 E, 1) unit column: the brightness of a group of the emitters."""
    column = np.zeros((3, count))
    column[:, group] = 1.0
    return (column / np.linalg.norm(column)).reshape(-1, 1)


def _cost(places: RoomIrradiance, logs: Floats, scale: float) -> float:
    """The robust mean over pairs of how much the brightness of neighbours differs."""
    difference = logs[places.pairs[:, 0]] - logs[places.pairs[:, 1]]
    square = (difference * difference).sum(axis=1) / scale**2
    return float(places.weights @ (square / (1.0 + square)))
