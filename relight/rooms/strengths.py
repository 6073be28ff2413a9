"""How bright the lamps of a room are, and the clipped sky in its windows, told by the shadows and the falloff of light.

C = a S, S = K + sum over emitters of s_j Q_j + B C: what a place receives through windows of the sky that was seen
unclipped, from each emitter, and from the surfaces around it, which were seen to send out C. Under the right strengths
neighbours, which mostly are of one material, mostly agree in albedo (`albedo.fit`). Surfaces need no unknowns: that is
inverse global illumination. Source: Yu et al., "Inverse global illumination" (1999).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from splat2mesh.base.arrays import Directions, Floats, Integers, Radiance
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import CapturedSky

from ..albedo import fit, samples
from ..albedo.skylight import GROUND, SkyParts
from ..sh.sphere import fibonacci_sphere
from ..transfer.facing import met_in_front
from ..transfer.occluder import Occluder

PLACES, DIRECTIONS = 2500, 2048
"""Places on the surface, and directions in which each looks for windows: 4.5 degrees apart."""

HITS = 4
"""One direction in this many looks up what other surfaces send."""

USUAL_ALBEDO, ALBEDO_SPREAD = 0.4, 0.25
"""Median albedo, in luminance, of what is seen in a room, where nothing says more (white walls .7, wood .2), and how
far rooms lie from it, as a logarithm: .3 to .5 mostly."""

USUAL_EXCESS, EXCESS_SPREAD = 5.0, 1.0
"""Mean radiance of the sky that a photograph of a room shows white in its windows, over that of white, and how far
rooms lie from it, as a logarithm; of lamps nothing is usual: small ones are bright. Where surfaces mostly light each
other, a tenth of the median albedo moves the strength of lamps and sky by half: by the albedo alone those of a trained
parlour came out 7 and 3.5 times too strong, and its albedo 1.4 times as wrong as with both."""

ONE_PLANE = 0.5
"""In diagonals: half of the distance that a place facing the other way counts as. So most pairs are of one wall, and of
one paint: pairs by distance alone made the agreement in albedo worse than that in captured colours."""

SPREAD, COLOR = 1.0, 0.07
"""Of the prior: log brightness of an emitter against the others, and its log colour against that it was captured in, of
a clipped sky white. With a colour as free as .2 the light of a lounge's lamp and of its windows drew near each other,
and with the lamp off the room turned blue."""

PATCH_SPREAD, PATCH_COLOR, PATCH_REACH_DEG = 2.0, 0.25, 15.0
"""The same for parts of the sky in the windows against the whole of it, and how far they are alike: a sun, clipped as
the sky around it, is another light, and its colour is its own."""

CELLS, MOST_PATCHES = 400, 24
"""Cells of the sphere, 10 degrees wide, that make the patches of a sky in windows, and how many of those at most: the
ones that bring most light; what lies in others goes to the nearest."""

STRENGTH = 2e-3
"""Weight of the prior on how emitters differ, against a mean over pairs of places."""

STIFF = 1e3
"""How much stiffer the prior is for what all emitters have in common: pairs of a scanned office would rather have no
lamps at all (albedo .8), since the errors of its mesh make the light of lamps uneven. So the median albedo says how
bright all are together, and pairs say how much each is of it."""

LEAST_OPEN, LEAST_UNSEEN = 0.01, 0.02
"""Mean part of the sky that places see, from which windows are an emitter, and the same where no sky was captured in
them: then they are more likely holes. Those of an office let in .002, of an exhibition room with a glossy floor .014,
which turned patches of a green wall blue."""

LOG_STRENGTHS = -8.0, 8.0
"""Range, about the start, in which the logarithm of the strength common to all emitters is sought."""

SOLVER_ROUNDS = 3
"""Rounds of solving for how emitters differ and for what they have in common."""

DARK, SATURATED = 0.002, 0.97
"""Linear colours between which a place says something about its light."""


class RoomIrradiance(NamedTuple):
    """What N places of a room receive of each emitter.

    vertices: (N,) indices. known: (N, 3) light of the sky that was seen unclipped. emitters: (E, N, 3) of each
    emitter at strength 1; the last W are what is not known of the sky, in patches about `patches`
    (W, 3), unit directions. bounce: (N, 3) what other surfaces send. pairs, weights: of `samples.neighbor_pairs`.
    log_captured: (N, 3).
    """

    vertices: NDArray[np.int64]
    known: NDArray[np.float64]
    emitters: NDArray[np.float64]
    patches: Directions
    bounce: NDArray[np.float64]
    pairs: NDArray[np.int64]
    weights: NDArray[np.float64]
    log_captured: NDArray[np.float64]

    @property
    def lamps(self) -> int:
        """How many of the emitters are lamps; they come first."""
        return len(self.emitters) - len(self.patches)


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
    """S = known + bounce + sum over j of exp(theta_j) Q_j, as `fit.solve` takes it."""

    def __init__(self, places: RoomIrradiance) -> None:
        self._base, self._of = places.known + places.bounce, places.emitters

    def __call__(self, theta: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Irradiance (N, 3) and the derivative (N, 3, E) of its logarithm."""
        parts = np.exp(np.clip(theta, -30.0, 30.0))[:, None] * self._of
        received = np.maximum(self._base + parts.sum(axis=0), 1e-12)
        return received, np.moveaxis(parts / received, 0, 2)


def places_of(
    occluder: Occluder,
    normals: NDArray[np.float32],
    captured: NDArray[np.float32],
    areas: NDArray[np.float64],
    usable: NDArray[np.bool_],
    lamps: list[NDArray[np.int64]],
    lamp_light: NDArray[np.float32],
    sky: CapturedSky | None,
    seed: int = 0,
) -> RoomIrradiance:
    """Gather what places of a room receive of each of its emitters.

    Parameters
    ----------
    occluder : Occluder
        The scene to trace rays in, V vertices.
    normals : ndarray of float32, (V, 3)
        Unit vectors, averaged along the surface.
    captured : ndarray of float32, (V, 3)
        Linear.
    areas : ndarray of float64, (V,)
        Around each vertex, in squared diagonals.
    usable : ndarray of bool, (V,)
        What was seen from within and is no lamp.
    lamps : list of ndarray of int64
        Vertices of each of L lamps.
    lamp_light : ndarray of float32, (L, V)
        What white vertices send on of each lamp, as `lamps.light_of` returns it.
    sky : CapturedSky or None
        What was captured in the windows.
    seed : int
        Seed of the choice of places.

    Returns
    -------
    RoomIrradiance
        It has no places where no vertex is usable.
    """
    told = usable & (captured.min(axis=1) > DARK) & (captured.max(axis=1) < SATURATED)
    vertices = samples.places(occluder, areas, told, PLACES, seed)
    directions = fibonacci_sphere(DIRECTIONS)
    unlit = captured.copy()
    for rows in lamps:
        unlit[rows] = 0.0
    free = _free(occluder, normals, vertices, directions)
    bounce = _sent(occluder, normals, vertices, fibonacci_sphere(DIRECTIONS // HITS), unlit)
    emitters = [np.repeat(light[vertices, None].astype(np.float64), 3, axis=1) for light in lamp_light]
    known: NDArray[np.float64] = np.zeros((len(vertices), 3))
    patches: Directions = np.zeros((0, 3))
    if len(vertices) and float(free.sum(axis=1).mean()) > (LEAST_UNSEEN if sky is None else LEAST_OPEN):
        known_part, unknown_part = sky_parts(sky, directions)
        known = free @ known_part
        patches, owner = _patches(directions, free.sum(axis=0) * unknown_part.mean(axis=1))
        for number in range(len(patches)):
            some = np.flatnonzero(owner == number)
            emitters.append(free[:, some] @ unknown_part[some])
    lying = np.hstack([occluder.origins[vertices], ONE_PLANE * normals[vertices]]).astype(np.float64)
    pairs, weights = samples.neighbor_pairs(lying)
    stacked = np.stack(emitters) if emitters else np.zeros((0, len(vertices), 3))
    logs = np.log(captured[vertices].astype(np.float64))
    return RoomIrradiance(vertices, known, stacked, patches, bounce, pairs, weights, logs)


def sky_parts(
    sky: CapturedSky | None, directions: NDArray[np.float64], image: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Divide the radiance of a sky in windows into what was seen and what is unknown.

    Parameters
    ----------
    sky : CapturedSky or None
        None where no sky was captured: then all of it is unknown, equally bright, without a colour.
    directions : ndarray of float64, (K, 3)
        Unit vectors that share the sphere evenly, or those of an image's texels.
    image : bool
        Whether they are of an image's texels.

    Returns
    -------
    known, unknown : ndarray of float64, (K, 3)
        Radiance in the unit of the captured colours: what was seen, and what exceeds it, at strength 1.
    """
    if sky is None:
        upward = np.where(directions[:, 1:2] < 0.0, GROUND, 1.0)
        return np.zeros((len(directions), 3)), np.repeat(upward, 3, axis=1)
    parts = SkyParts.looked_up(sky, directions) if image else SkyParts.at(sky, directions)
    seen = np.maximum(1.0 - parts.unseen, 0.0)
    mean = parts.known.sum(axis=0) / max(float(seen.sum() / 3.0), 1e-9)
    return parts.known + parts.unseen * mean, parts.clipped


def solve(places: RoomIrradiance, colors: NDArray[np.float64]) -> Strengths | None:
    """Solve for the strengths of a room's emitters.

    Parameters
    ----------
    places : RoomIrradiance
        What the emitters give.
    colors : ndarray of float64, (L, 3)
        Captured colours of the lamps, linear.

    Returns
    -------
    Strengths or None
        None where the places tell nothing.
    """
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
        found = fit.solve(light, places.log_captured, places.pairs, places.weights, start, prior)
        start = found.theta
    radiance = np.exp(found.theta)
    received = light(found.theta)[0]
    scale = fit.SCALES[-1]
    before = _cost(places, places.log_captured, scale)
    after = _cost(places, places.log_captured - np.log(received), scale)
    groups = [[k] for k in range(lamps)] + [list(range(lamps, count))] * (count > lamps)
    loose = _prior(places, 1.0)
    evidence = np.array([fit.evidence(found, loose, _brightness(count, group)) for group in groups])
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


def _patches(directions: Directions, brought: Floats) -> tuple[Directions, Integers]:
    """Centres (W, 3) of the patches, and which of them each direction (K, 3) is in. brought: (K,) light of each."""
    cells = fibonacci_sphere(CELLS)
    cell = cKDTree(cells).query(directions)[1]
    total = np.bincount(cell, brought, CELLS)
    kept = np.sort(np.argsort(-total, kind="stable")[:MOST_PATCHES])
    kept = kept[total[kept] > 0.0]
    return cells[kept], cKDTree(cells[kept]).query(directions)[1] if len(kept) else np.zeros(len(directions), int)


def _free(occluder: Occluder, smooth: Directions, vertices: Integers, directions: Directions) -> NDArray[np.float32]:
    """Free directions (N, K) float32, weighted by cosine to sum to the visible fraction."""
    free = np.zeros((len(vertices), len(directions)), np.float32)
    toward = np.ascontiguousarray(directions, np.float32)
    for start in range(0, len(vertices), samples.BATCH):
        some = vertices[start : start + samples.BATCH]
        cosine = smooth[some] @ toward.T
        place, direction = np.nonzero(cosine > 0.0)
        blocked = occluder.occluded(np.hstack([occluder.origins[some][place], toward[direction]]))
        weight = cosine[place, direction] * np.float32(4.0 / len(directions))
        free[start + place, direction] = np.where(blocked, np.float32(0.0), weight)
    return free


def _sent(
    occluder: Occluder, smooth: Directions, vertices: Integers, directions: Directions, captured: Radiance
) -> NDArray[np.float64]:
    """Light (N, 3) float64 that other surfaces send. Backs of faces are black."""
    bounce = np.zeros((len(vertices), 3))
    toward = np.ascontiguousarray(directions, np.float32)
    for start in range(0, len(vertices), samples.BATCH):
        some = vertices[start : start + samples.BATCH]
        cosine = smooth[some] @ toward.T
        place, direction = np.nonzero(cosine > 0.0)
        rays = np.hstack([occluder.origins[some][place], toward[direction]])
        hits = occluder.first_hits(rays)
        weight = cosine[place, direction] * np.float32(4.0 / len(directions))
        corners = occluder.faces[np.maximum(hits.faces, 0)]
        front = met_in_front(occluder, hits, toward[direction])
        shares = np.stack([1.0 - hits.uv.sum(axis=1), *hits.uv.T], axis=1) * (weight * front)[:, None]
        seen = np.einsum("rk,rkc->rc", shares, captured[corners])
        for color in range(3):
            bounce[start : start + len(some), color] = np.bincount(place, seen[:, color], len(some))
    return bounce


def _prior(places: RoomIrradiance, stiff: float = STIFF) -> NDArray[np.float64]:
    """(3 E, 3 E), colours outermost, in units of `fit.STRENGTH`."""
    count, lamps = len(places.emitters), places.lamps
    apart = np.degrees(np.arccos(np.clip(places.patches @ places.patches.T, -1.0, 1.0)))
    alike = np.exp(-0.5 * (apart / PATCH_REACH_DEG) ** 2)

    def precision(whole: float, part: float) -> NDArray[np.float64]:
        spread = whole**2 * np.eye(count)
        spread[lamps:, lamps:] = whole**2 + part**2 * (alike + 0.01 * np.eye(count - lamps))
        return np.asarray(np.linalg.inv(spread), np.float64)

    common = _common(places)
    gray = np.full((3, 3), 1.0 / 3.0)
    bright = precision(SPREAD, PATCH_SPREAD) + (stiff - 1.0) / SPREAD**2 * np.outer(common, common)
    parts = np.kron(gray, bright) + np.kron(np.eye(3) - gray, precision(COLOR, PATCH_COLOR))
    return parts * (STRENGTH / fit.STRENGTH)


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
