"""Brightness and direction of the clipped or unseen part of a captured sky, estimated from the colours of the place.

Pairs of neighbours cannot show it: errors of the mesh make any light but a flat one cost more. But noise in the
irradiance of a place does not change which light its colours correlate with. So the fit tries several lights and weighs
each by how much of the variance of log colour it explains within materials whose surfaces lie alike: with a slope that
is free, as regression on noisy values asks for.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Mask, Vector
from splat2mesh.base.calibration import Provenance

from ..sh import harmonics
from ..sh.sphere import fibonacci_sphere
from .division import weighted_median
from .patches import ColorPatches, explained, slope

SUNS, SUN_WIDTH_DEG = 400, 7.0
"""Directions over the sphere, of whose upper half suns are tried, and spread of each: the transfer's bands hold no
narrower one."""

FINE, AROUND_DEG = 4096, 12.0
"""Directions over the sphere, 3 degrees apart, of which those so near to a sun that was found are tried again."""

STEEPNESS, TRIED = (0.25, 0.5, 1.0, 1.5, 2.0), 48
"""Leans that are tried: these in each of so many directions, and none."""

CERTAIN = 0.02
"""Share below which a light is left out."""

PARTS = (0.0, 0.1, 0.2, 0.3, 0.45, 0.6, 0.75)
"""Parts of what patches receive beyond what is known that are tried for a flat excess beside a sun."""


@dataclass(frozen=True)
class ContrastCalibration:
    """Which lights are usual.

    most_patches: of more some are taken.
    independent: patches that the sum of their evidence is scaled to. Neighbours err alike, however many there are.
    albedo, albedo_spread: median albedo, in luminance, of what lies under an open sky, and spread of its logarithm.
    Asphalt has .12, grass and leaves .1 to .25, brick and paving .2 to .35. A light too bright costs less than one too
    dark.
    albedos: medians that lights are tried to reach by their strength; none at all is tried as well.
    spread: of the lean in the prior, along each axis. At .5 one side of the sky is e times as bright as the other.
    sure, better, beyond: by how much, in nats, a sun must do better than all leans of what was clipped, and than those
    of what was not seen too, and by how much the latter must do better than the former, for either to have half of the
    light. By the first alone no sun can be told, since it explains errors of the mesh: gardens and nooks that had one
    gave it 10 to 120 nats, gardens without 9 to 21. But there it did better than light from beyond by -2 to 1.4 nats,
    in the others by 2.4 to 15. Light from beyond gained 3 where the sky was clipped all around, and 30 where next to
    nothing was and trees hid the bright zenith.
    fewer: with so many times fewer independent patches, for errors reach far, as with all of them: the mean decides how
    much light from beyond takes. The best lights of either kind err in different ways, and a fifth of the other beside
    the better one does better than either.
    slope, steep: by how much log colour follows log irradiance within materials, and spread of its logarithm. Under
    their true lights it was .30, .34, .41, .43 and .50 in three nooks and two gardens, since hues hold several paints
    and meshes err. A sun too strong beside its sky makes it less; correlation does not see that.
    mostly: part of a direction that must have been clipped or not seen for a sun to stand there.
    """

    provenance: ClassVar = Provenance(
        script="scripts/bench albedo",
        fitted_on="three generated nooks and four generated gardens, one trained garden (docs/albedo.md)",
        held_out="of gardens 4, 5 and 6 the irradiance of red is off by 7%, that of blue by 8%; of suns, "
        "gardens 2, 3, 10 to 13 and nooks 1, 2, 4 to 6 (docs/albedo.md)",
    )

    most_patches: int = 6000
    independent: float = 300.0
    albedo: float = 0.23
    albedo_spread: float = 0.15
    albedos: tuple[float, ...] = (0.14, 0.2, 0.28, 0.38, 0.5)
    spread: float = 0.35
    sure: float = 8.0
    better: float = 2.0
    beyond: float = 10.0
    fewer: float = 20.0
    slope: float = 0.38
    steep: float = 0.07
    mostly: float = 0.5


CONTRAST = ContrastCalibration()


class SkyBrightness(NamedTuple):
    """Where a sky clipped, its radiance above 1 is excess * exp(lean . direction), equal in all colours; lean: (3,).

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
    supported: Callable[[Vector], float] = lambda sun: 0.0,  # nats that other evidence adds to a sun, (3,)
    fewer: float = CONTRAST.fewer,  # 1 where the odds of all patches decide
) -> list[tuple[float, SkyBrightness]]:
    """Every SkyBrightness that may have lit the patches, with its share, the likeliest first. Shares sum to 1."""
    patches = patches.thinned(CONTRAST.most_patches)
    bands = int(np.sqrt(patches.transfer.shape[1]))
    project = harmonics.evaluate(directions, bands) * (4.0 * np.pi / len(directions))
    known = np.maximum(patches.transfer @ (project.T @ bound), 0.0) + patches.bounced
    nothing = _evidence(patches, known)
    least = _Excess(0.0, np.zeros(3), known, nothing, nothing)
    seen, wide = (
        _excess(patches, known, directions, region, project) or least for region in (clipped, clipped + unseen)
    )
    suns = clipped + unseen > CONTRAST.mostly
    sun, (irradiance, alone), gained = _sun(patches, known, seen.lit, directions, suns, bands)
    nats, lit = gained - max(seen.evidence + CONTRAST.sure, wide.evidence + CONTRAST.better), None
    if sun is not None and _odds(nats) > 0.0:
        lit = SkyBrightness(seen.excess, seen.lean, False, sun, irradiance)
        if alone:
            lit = _beside_sun(patches, known, directions, clipped + unseen, project, sun)
        nats += supported(lit.sun if lit.sun is not None else sun)
    sunny = _odds(nats)
    beyond = (1.0 - sunny) * _odds(wide.odds - seen.odds - CONTRAST.beyond, fewer)
    found = [
        (1.0 - sunny - beyond, SkyBrightness(seen.excess, seen.lean, False, None, 0.0)),
        (beyond, SkyBrightness(wide.excess, wide.lean, True, None, 0.0)),
    ]
    if lit is not None:
        found.append((sunny, lit))
    return sorted((each for each in found if each[0] > 0.0), key=lambda each: -each[0])


def ambiguity(
    patches: ColorPatches,
    directions: Directions,
    bound: Floats,
    regions: tuple[Floats, Floats],  # clipped and unseen, as of `brightness_of`
    found: list[tuple[float, SkyBrightness]],  # by it
) -> float:
    """Spread of the log irradiance of patches over the lights that may have lit them, by their shares; brightness of
    all aside."""
    patches = patches.thinned(CONTRAST.most_patches)
    bands = int(np.sqrt(patches.transfer.shape[1]))
    project = harmonics.evaluate(directions, bands) * (4.0 * np.pi / len(directions))
    shares, logs = np.array([share for share, _ in found]), []
    for _, light in found:
        region = regions[0] + regions[1] if light.beyond else regions[0]
        sent = bound + region * light.excess * np.exp(directions @ light.lean)
        received = np.maximum(patches.transfer @ (project.T @ sent), 0.0) + patches.bounced
        if light.sun is not None:
            received = received + light.irradiance * _sunlit(patches, light.sun[None], bands)[:, 0]
        logs.append(np.log(np.maximum(received, 1e-9)))
        logs[-1] -= weighted_median(logs[-1], patches.weight)
    off = np.array(logs) - shares @ np.array(logs)
    weight = patches.weight / patches.weight.sum()
    return float(np.sqrt((shares @ np.minimum(off**2, 1.0)) @ weight))


def _odds(nats: float, fewer: float = 1.0) -> float:
    """Share of a light that does better by so many nats; none or all of it where that is certain.

    fewer: that of one that does better is the mean of what all patches and a part 1 / fewer of them give.
    """
    all_of_them, some = (1.0 / (1.0 + np.exp(-np.clip(nats / each, -50.0, 50.0))) for each in (1.0, fewer))
    share = min(all_of_them, 0.5 * (all_of_them + some))
    return float(share if CERTAIN < share < 1.0 - CERTAIN else round(share))


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
    odds = evidence - 0.5 * (steep[:, None] / CONTRAST.spread) ** 2
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
    for albedo in CONTRAST.albedos:
        lacking = bright / albedo - known
        most = max(weighted_median(lacking / np.maximum(flat, 1e-9), patches.weight), 0.0)
        for excess in (part * most for part in PARTS):
            for direction, light in zip(around, lights, strict=True):
                scale = weighted_median((lacking - excess * flat) / light, patches.weight)
                if scale > 0.0:
                    received = known + excess * flat + scale * light
                    odds = (
                        _evidence(patches, received)
                        - 0.5 * (np.log(slope(patches, received) / CONTRAST.slope) / CONTRAST.steep) ** 2
                    )
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
    scales, evidence = (
        np.zeros((lights.shape[1], len(CONTRAST.albedos))),
        np.full((lights.shape[1], len(CONTRAST.albedos)), -np.inf),
    )
    for row, light in enumerate(lights.T):
        light = np.maximum(light, 1e-9)
        for column, albedo in enumerate(CONTRAST.albedos):
            scale = weighted_median((bright / albedo - base) / light, patches.weight)
            if scale > 0.0:
                scales[row, column] = scale
                evidence[row, column] = _evidence(patches, base + scale * light)
    return scales, evidence


def _evidence(patches: ColorPatches, received: NDArray[np.float64]) -> float:
    """Evidence for an irradiance (N,), in nats: its fit, and how usual the resulting albedo is."""
    logs = np.log(np.maximum(received, 1e-9))
    usual = weighted_median(patches.log_captured - logs, patches.weight) - np.log(CONTRAST.albedo)
    return (
        -0.5 * CONTRAST.independent * np.log1p(-explained(patches, logs)) - 0.5 * (usual / CONTRAST.albedo_spread) ** 2
    )


def _widths(steep: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of the steepness axis that each tried value represents."""
    edges = np.concatenate([[0.0], 0.5 * np.add(STEEPNESS[1:], STEEPNESS[:-1]), [STEEPNESS[-1]]])
    return np.concatenate([[0.0], np.repeat(np.diff(edges), TRIED)])[: len(steep)]
