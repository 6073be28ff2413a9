"""What a place's colours say of the part of a captured sky that was clipped or not seen: how bright, and on which side.

Pairs of neighbours do not tell it: what the mesh gets wrong makes any light but a flat one cost more. But whatever
adds noise to the irradiance of a place leaves its correlation with the colours to the right light. So lights are tried,
and each counts by how much of the variance of log colour it explains within materials whose surfaces lie alike: with
a slope that is free, as regression on noisy values asks for.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from splat2mesh.base.arrays import Directions, Floats, Integers, Mask, Transfer, Vector
from splat2mesh.scene.color import luminance

from ..sh import harmonics
from ..sh.sphere import fibonacci_sphere
from ..transfer.bounces import visible_fraction
from ..transfer.occluder import Occluder
from .division import weighted_median
from .seen import SeenPoints

CELL = 0.04
"""Side of a patch over the median distance from which patches are seen."""

MOST_VOLUME, LEAST_VISIBLE, SMOOTH = 0.35, 0.15, 0.9
"""Of what is looked at: how far it may be leaves or grass, the part of its sky that it sees at least, and the least
length of a normal between those of a face's corners."""

ALIKE, MATERIAL = 0.15, 0.12
"""Log chroma that a patch, and a material, spans."""

LEVEL, BENEATH = 0.7, -0.3
"""Height of a normal from which a surface counts as level, and below which it hangs: a material counts once for
each, since floors and walls of one hue are not of one paint."""

LEAST_PATCHES, MOST_PATCHES = 200, 3000
"""Fewer tell nothing, and of more some are taken."""

OUTLIER = 0.5
"""Of log colour within a material: what is further off counts less than half."""

INDEPENDENT = 300.0
"""ColorPatches that their sum of evidence is scaled to: neighbours err alike, however many there are."""

ALBEDO, ALBEDO_SPREAD = 0.23, 0.15
"""Median albedo, in luminance, of what lies under an open sky, and spread of its logarithm. Asphalt has .12, grass and
leaves .1 to .25, brick and paving .2 to .35. A light too bright costs less than one too dark."""

ALBEDOS = (0.14, 0.2, 0.28, 0.38, 0.5)
"""Medians that lights are tried to reach by their strength; none at all is tried as well."""

SPREAD = 0.35
"""Of the lean in the prior, along each axis: at 0.5 one side of the sky is e times as bright as the other."""

STEEPNESS, TRIED = (0.25, 0.5, 1.0, 1.5, 2.0), 48
"""Leans that are tried: these in each of so many directions, and none."""

SUNS, SUN_WIDTH_DEG = 400, 7.0
"""Over the sphere, of which half are tried, and spread of each: the transfer's bands hold no narrower one."""

SURE, BEYOND = 15.0, 10.0
"""By how much, in nats, a sun must do better than all leans of what was clipped, and so must an excess that comes from
above where nothing was seen too. In four gardens suns that were not there gained up to 9.4, since they explained errors
of the mesh, and one that was there 30; light from beyond gained 3 where the sky was clipped all around, and 30 where
next to nothing was and trees hid the bright zenith."""

FINE, AROUND_DEG = 4096, 12.0
"""Directions over the sphere, 3 degrees apart, of which those so near to a sun that was found are tried again."""

PARTS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.75)
"""Of what patches receive beyond what is known, by a flat excess beside that sun."""

SLOPE, STEEP = 0.38, 0.07
"""By how much log colour follows log irradiance within materials, and spread of its logarithm: under their true lights
it was .30, .34, .41, .43 and .50 in three nooks and two gardens, since hues hold several paints and meshes err. A sun
too strong beside its sky makes it less. Correlation does not see that."""

MOSTLY = 0.5
"""Part of a direction that must have been clipped or not seen for a sun to stand there."""


@dataclass(frozen=True, eq=False)
class ColorPatches:
    """N patches of surfaces. log_captured: (N,) of luminance. transfer: (N, K). bounced: (N,) luminance. material:
    (N,) numbers. weight: (N,)."""

    log_captured: NDArray[np.float64]
    transfer: NDArray[np.float64]
    bounced: NDArray[np.float64]
    material: Integers
    weight: NDArray[np.float64]

    def thinned(self, count: int) -> "ColorPatches":
        """At most so many of them, evenly."""
        if len(self.weight) <= count:
            return self
        rows = np.arange(count) * len(self.weight) // count
        _, material = np.unique(self.material[rows], return_inverse=True)
        others = self.log_captured[rows], self.transfer[rows], self.bounced[rows]
        return ColorPatches(*others, material.reshape(-1), self.weight[rows])

    @cached_property
    def within(self) -> "_Within":
        """The _Within of them."""
        return _Within(self)


def patches_of(
    looks: SeenPoints,
    occluder: Occluder,
    captured: NDArray[np.float32],  # (V, 3) linear
    usable: Mask,  # (V,) bool, neither black nor clipped
    transfer: Transfer,  # (V, K)
    bounce: NDArray[np.float32],  # (V, 3)
    volume: Floats | None = None,  # (V,) in [0, 1]
) -> ColorPatches | None:
    """The ColorPatches of what is looked at, or None where they are too few."""
    normal = looks.at(occluder.normals)
    good = usable[looks.corners].all(axis=1) & (np.linalg.norm(normal, axis=1) > SMOOTH)
    good &= looks.at(visible_fraction(transfer)[:, None])[:, 0] > LEAST_VISIBLE
    if volume is not None:
        good &= looks.at(volume[:, None])[:, 0] < MOST_VOLUME
    if np.count_nonzero(good) < LEAST_PATCHES:
        return None
    some = looks.of(good)
    logs, normal, points = np.log(some.at(captured)), normal[good], some.at(occluder.origins)
    chroma = (logs - logs.mean(axis=1, keepdims=True))[:, :2]
    cell = CELL * float(np.median(some.distance))
    index = _numbered([points / cell, 1.2 * normal + 0.5, chroma / ALIKE])
    count = np.bincount(index)
    shape = len(count), len(captured)
    means = csr_array(
        ((some.shares / count[index][:, None]).ravel(), (np.repeat(index, 3), some.corners.ravel())), shape
    )
    height = means @ occluder.normals[:, 1]
    side = np.where(height > LEVEL, 0.0, np.where(height < BENEATH, 2.0, 1.0))
    hue = np.stack([np.bincount(index, column) / count for column in chroma.T], axis=1)
    return ColorPatches(
        np.log(np.maximum(luminance(means @ captured), 1e-9)),
        (means @ transfer).astype(np.float64),
        np.asarray(luminance(means @ bounce), np.float64),
        _numbered([hue / MATERIAL, side[:, None]]),
        np.sqrt(count),
    )


class SkyBrightness(NamedTuple):
    """What exceeds 1 where a sky was clipped is excess * exp(lean . direction), in all colours alike; lean: (3,).

    beyond: whether as much comes from above where nothing was seen. sun: (3,) unit direction or None. irradiance: of
    the sun, at right angles.
    """

    excess: float
    lean: NDArray[np.float64]
    beyond: bool
    sun: NDArray[np.float64] | None
    irradiance: float


class _Excess(NamedTuple):
    """An excess as of SkyBrightness. lit: (N,) irradiance with it. odds, evidence: in nats, of the best one tried."""

    excess: float
    lean: NDArray[np.float64]
    lit: NDArray[np.float64]
    odds: float
    evidence: float


def brightness_of(
    patches: ColorPatches,
    directions: Directions,  # (D, 3) that share the sphere evenly
    bound: Floats,  # (D,) luminance that is known, of each direction
    clipped: Floats,  # (D,) part of each direction that was clipped
    unseen: Floats,  # (D,) part of each direction that was not seen, above the horizon
) -> SkyBrightness:
    """The SkyBrightness that explains the patches best: leans and strengths weighted by evidence, then a sun."""
    patches = patches.thinned(MOST_PATCHES)
    bands = int(np.sqrt(patches.transfer.shape[1]))
    project = harmonics.evaluate(directions, bands) * (4.0 * np.pi / len(directions))
    known = np.maximum(patches.transfer @ (project.T @ bound), 0.0) + patches.bounced
    nothing = _evidence(patches, known)
    least = _Excess(0.0, np.zeros(3), known, nothing, nothing)
    seen, wide = (
        _excess(patches, known, directions, region, project) or least for region in (clipped, clipped + unseen)
    )
    suns = clipped + unseen > MOSTLY
    sun, (irradiance, alone), gained = _sun(patches, known, seen.lit, directions, suns, bands)
    if gained - seen.evidence > SURE and gained > wide.odds:
        if alone and sun is not None:
            return _beside_sun(patches, known, directions, clipped + unseen, project, sun)
        return SkyBrightness(seen.excess, seen.lean, False, sun, irradiance)
    beyond = bool(wide.odds - seen.odds > BEYOND)
    found = wide if beyond else seen
    return SkyBrightness(found.excess, found.lean, beyond, None, 0.0)


def _excess(
    patches: ColorPatches, known: NDArray[np.float64], directions: Directions, region: Floats, project: Floats
) -> _Excess | None:
    """The _Excess over a region, (D,) in [0, 1]: the mean of those that were tried; None where none explains more."""
    tried = np.concatenate([np.zeros((1, 3)), *(s * fibonacci_sphere(TRIED) for s in STEEPNESS)])
    shape = np.exp(directions @ tried.T) * region[:, None]
    if not shape.max() > 0.0:
        return None
    scales, evidence = _strengths(patches, known, np.maximum(patches.transfer @ (project.T @ shape), 0.0))
    steep = np.linalg.norm(tried, axis=1)
    odds = evidence - 0.5 * (steep[:, None] / SPREAD) ** 2
    if not odds.max() > _evidence(patches, known):
        return None
    # Each shell of directions stands for the volume around its steepness, as a prior over space has it.
    share = np.exp(odds - odds.max()) * np.maximum(steep**2 * _widths(steep), 1e-9)[:, None]
    share /= share.sum()
    lean = share.sum(axis=1) @ tried
    excess = float(np.exp((share * np.log(np.maximum(scales, 1e-9))).sum()))
    lit = known + excess * np.maximum(patches.transfer @ (project.T @ (np.exp(directions @ lean) * region)), 0.0)
    return _Excess(excess, lean, lit, float(odds.max()), float(evidence.max()))


def _sun(
    patches: ColorPatches,
    known: NDArray[np.float64],
    lit: NDArray[np.float64],
    directions: Directions,
    open_to_suns: Mask,
    bands: int,
) -> tuple[NDArray[np.float64] | None, tuple[float, bool], float]:
    """The best sun beside all other light or beside what was seen alone: direction, (irradiance, whether
    alone), and the evidence for it."""
    suns = fibonacci_sphere(SUNS)
    suns = suns[(suns[:, 1] > 0.0) & open_to_suns[(suns @ directions.T).argmax(axis=1)]]
    if not len(suns):
        return None, (0.0, True), -np.inf
    lights = _sunlit(patches, suns, bands)
    best = None, (0.0, True), -np.inf
    for alone, base in ((True, known), (False, lit)):
        scales, evidence = _strengths(patches, base, lights)
        row, column = np.unravel_index(evidence.argmax(), evidence.shape)
        if evidence[row, column] > best[2]:
            best = suns[row], (float(scales[row, column]), alone), float(evidence[row, column])
    return best


def _beside_sun(
    patches: ColorPatches,
    known: NDArray[np.float64],
    directions: Directions,
    region: Floats,
    project: Floats,
    sun: Vector,
) -> SkyBrightness:
    """The SkyBrightness of a sun near this one, (3,), and a flat excess over a region, (D,) in [0, 1]."""
    around = fibonacci_sphere(FINE)
    around = np.vstack([sun, around[around @ sun > np.cos(np.radians(AROUND_DEG))]])
    bands = int(np.sqrt(patches.transfer.shape[1]))
    flat = np.maximum(patches.transfer @ (project.T @ region), 0.0)
    bright = np.exp(patches.log_captured)
    lights, best = np.maximum(_sunlit(patches, around, bands).T, 1e-9), -np.inf
    found: SkyBrightness | None = None
    for albedo in ALBEDOS:
        lacking = bright / albedo - known
        most = max(weighted_median(lacking / np.maximum(flat, 1e-9), patches.weight), 0.0)
        for excess in (part * most for part in PARTS):
            for direction, light in zip(around, lights, strict=True):
                scale = weighted_median((lacking - excess * flat) / light, patches.weight)
                if scale > 0.0:
                    received = known + excess * flat + scale * light
                    odds = _evidence(patches, received) - 0.5 * (np.log(_slope(patches, received) / SLOPE) / STEEP) ** 2
                    if odds > best:
                        best, found = odds, SkyBrightness(excess, np.zeros(3), True, direction, float(scale))
    assert found is not None  # the sun itself, without an excess, has a strength above 0
    return found


def _sunlit(patches: ColorPatches, suns: Directions, bands: int) -> NDArray[np.float64]:
    """(N, S) irradiance of patches under suns (S, 3) of irradiance 1 at right angles."""
    degree, _ = harmonics.degrees_and_orders(bands)
    lobe = np.exp(-0.5 * degree * (degree + 1) * np.radians(SUN_WIDTH_DEG) ** 2)
    return np.maximum(patches.transfer @ (harmonics.evaluate(suns, bands) * lobe).T, 0.0)


def _strengths(
    patches: ColorPatches, base: NDArray[np.float64], lights: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """For lights (N, L) beside a base (N,): by how much each is taken for the median albedos tried, (L, A), and the
    evidence then."""
    bright = np.exp(patches.log_captured)
    scales, evidence = np.zeros((lights.shape[1], len(ALBEDOS))), np.full((lights.shape[1], len(ALBEDOS)), -np.inf)
    for row, light in enumerate(lights.T):
        light = np.maximum(light, 1e-9)
        for column, albedo in enumerate(ALBEDOS):
            scale = weighted_median((bright / albedo - base) / light, patches.weight)
            if scale > 0.0:
                scales[row, column] = scale
                evidence[row, column] = _evidence(patches, base + scale * light)
    return scales, evidence


def _evidence(patches: ColorPatches, received: NDArray[np.float64]) -> float:
    """Evidence for an irradiance (N,), in nats: what it explains, and how usual the albedo is that it leaves."""
    logs = np.log(np.maximum(received, 1e-9))
    usual = weighted_median(patches.log_captured - logs, patches.weight) - np.log(ALBEDO)
    return -0.5 * INDEPENDENT * np.log1p(-_explained(patches, logs)) - 0.5 * (usual / ALBEDO_SPREAD) ** 2


def _widths(steep: NDArray[np.float64]) -> NDArray[np.float64]:
    """How much of the axis of steepness each of the tried stands for."""
    edges = np.concatenate([[0.0], 0.5 * np.add(STEEPNESS[1:], STEEPNESS[:-1]), [STEEPNESS[-1]]])
    return np.concatenate([[0.0], np.repeat(np.diff(edges), TRIED)])[: len(steep)]


def _explained(patches: ColorPatches, log_received: NDArray[np.float64]) -> float:
    """Part of the variance of log colour within materials that a log irradiance explains, 0 where they are opposed."""
    across, colors, light = _moments(patches, log_received)
    return float(np.clip(across, 0.0, None) ** 2 / (colors * light)) if colors * light > 0.0 else 0.0


def _slope(patches: ColorPatches, received: NDArray[np.float64]) -> float:
    """By how much log colour follows the logarithm of an irradiance (N,) within materials; at least next to nothing."""
    across, _, light = _moments(patches, np.log(np.maximum(received, 1e-9)))
    return max(float(across / light), 1e-3) if light > 0.0 else 1.0


def _moments(patches: ColorPatches, log_received: NDArray[np.float64]) -> tuple[float, float, float]:
    """Within materials: the weighted sums of log colour times log irradiance, and of the squares of both."""
    within = patches.within
    light = within.off(log_received)
    return float(within.weight @ (within.colors * light)), within.own, float(within.weight @ light**2)


class _Within:
    """Log colours less the mean of their material, in weights (N,) that count outliers less: what patches tell,
    whatever the light. own: their weighted square."""

    def __init__(self, patches: ColorPatches) -> None:
        self.weight, self._groups = patches.weight, patches.material
        self._total = np.bincount(self._groups, self.weight)
        off = self.off(patches.log_captured)
        self.weight = self.weight / (1.0 + (off / OUTLIER) ** 2)
        self._total = np.bincount(self._groups, self.weight)
        self.colors = self.off(patches.log_captured)
        self.own = float(self.weight @ self.colors**2)

    def off(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values (N,) less the weighted mean of their group."""
        return values - (np.bincount(self._groups, self.weight * values) / self._total)[self._groups]


def _numbered(columns: Sequence[Floats]) -> NDArray[np.int64]:
    """Numbers (N,) from 0 for rows that fall into the same cell of side 1: a list of (N, C)."""
    cells = np.floor(np.concatenate(columns, axis=1)).astype(np.int64)
    cells -= cells.min(axis=0)
    key = np.zeros(len(cells), np.int64)
    for column in cells.T:
        key = np.unique(key * (int(column.max()) + 1) + column, return_inverse=True)[1].reshape(-1)
    return key
