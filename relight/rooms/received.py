"""Light that sample points of a room receive from each emitter: lamps, the clipped sky in windows, surfaces."""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Integers
from splat2mesh.base.sphere import fibonacci_sphere, row_solid_angles, texel_directions
from splat2mesh.scene.measured import CapturedSky

from ..albedo import samples
from ..albedo.captured import DARK
from ..albedo.skylight import GROUND, SkyParts
from ..transfer.occluder import Occluder

PLACES, DIRECTIONS = 2500, 2048
"""Sample points on the surface, and directions per point that search for windows: 4.5 degrees apart."""

ONE_PLANE = 0.5
"""Half of the extra distance, in diagonals, for a point that faces the other way. Most pairs then share a wall and its
paint: with pairs by distance alone, albedo agreed less than captured colours."""

CELLS, MOST_PATCHES = 400, 24
"""Cells of the sphere, 10 degrees wide, for the patches of a sky in windows, and the largest number of patches: the
brightest cells. Other cells join the nearest patch."""

LEAST_OPEN, LEAST_UNSEEN = 0.01, 0.02
"""Mean visible share of the sky above which windows are an emitter, and the same where no sky was captured in them:
then they are more likely holes. Holes of an office let in .002, those of an exhibition room with a glossy floor .014,
which turned patches of a green wall blue."""

LEAST_ABOVE = 0.02
"""Least visible steradians of the sky above the horizon that represent the invisible rest."""

SATURATED = 0.97
"""Range of linear colours in which a point carries information about its light."""


class RoomIrradiance(NamedTuple):
    """Light that N sample points of a room receive from each emitter.

    vertices: (N,) indices. known: (N, 3) light of the visible, unclipped sky. emitters: (E, N, 3) light of each
    emitter at strength 1; the last W are the unknown part of the sky, in patches about `patches`
    (W, 3), unit directions. bounce: (N, 3) light from other surfaces. pairs, weights: of `samples.neighbor_pairs`.
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
        """Number of emitters that are lamps; they come first."""
        return len(self.emitters) - len(self.patches)


class RoomSurface(NamedTuple):
    """The V vertices of a room.

    normals: (V, 3) unit vectors, averaged along the surface. captured: (V, 3) linear. areas: (V,) around each vertex,
    in squared diagonals. usable: (V,) mask of the vertices visible from inside that are not lamps.
    """

    normals: NDArray[np.float32]
    captured: NDArray[np.float32]
    areas: NDArray[np.float64]
    usable: NDArray[np.bool_]


def places_of(
    occluder: Occluder,
    surface: RoomSurface,
    bounce: NDArray[np.float32],  # (V, 3) light from other surfaces but lamps
    lamp_light: NDArray[np.float32],  # (L, V) radiance of white under each, from `lamps.light_of`
    sky: CapturedSky | None,  # in the windows
    seed: int = 0,  # of the choice of points
    through: NDArray[np.float32] | None = None,  # (V, 3) direct light of a known sky, which replaces the captured one
) -> RoomIrradiance:
    """Gather the light that sample points of a room receive from each emitter; no points if no vertex is usable."""
    normals, captured, areas, usable = surface
    exposed = usable & (captured.min(axis=1) > DARK) & (captured.max(axis=1) < SATURATED)
    vertices = samples.places(occluder, areas, exposed, PLACES, seed)
    directions = fibonacci_sphere(DIRECTIONS)
    free = _free(occluder, normals, vertices, directions)
    emitters = [np.repeat(light[vertices, None].astype(np.float64), 3, axis=1) for light in lamp_light]
    known: NDArray[np.float64] = np.zeros((len(vertices), 3))
    patches: Directions = np.zeros((0, 3))
    opened = len(vertices) and float(free.sum(axis=1).mean()) > (LEAST_UNSEEN if sky is None else LEAST_OPEN)
    if opened and through is not None:
        if through[vertices].any():  # one emitter, whose shape is known
            patches = np.array([[0.0, 1.0, 0.0]])
            emitters.append(through[vertices].astype(np.float64))
    elif opened:
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
    sent = bounce[vertices].astype(np.float64)
    return RoomIrradiance(vertices, known, stacked, patches, sent, pairs, weights, logs)


def sky_parts(
    sky: CapturedSky | None,  # None where none was captured: then all of it is unknown, equally bright and grey
    directions: NDArray[np.float64],  # (K, 3) that share the sphere evenly, or those of an image's texels
    image: bool = False,  # whether they are the latter
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The radiance of a sky in windows, (K, 3) each: its known part, in the unit of the captured colours, and the
    unknown excess over it at strength 1."""
    if sky is None:
        upward = np.where(directions[:, 1:2] < 0.0, GROUND, 1.0)
        return np.zeros((len(directions), 3)), np.repeat(upward, 3, axis=1)
    parts = SkyParts.looked_up(sky, directions) if image else SkyParts.at(sky, directions)
    known, clipped = _mean_above(sky)
    return parts.known + parts.unseen * known, parts.clipped + parts.unseen * clipped


def _mean_above(sky: CapturedSky) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(3,) each, over the visible sky above the horizon, or anywhere if none is visible there: mean radiance that
    binds, with 1 where it clips, and the clipped share."""
    height, width = sky.bound.shape[:2]
    areas = np.repeat(row_solid_angles(height, width), width, axis=1)
    seen = areas[..., None] * (sky.bound + sky.clipped)
    above = np.where(texel_directions(height, width)[..., 1:2] > 0.0, seen, 0.0)
    weight = above if above.sum() > LEAST_ABOVE else seen
    total = np.maximum(weight.sum(axis=(0, 1)), 1e-9)
    share = np.maximum(sky.bound + sky.clipped, 1e-9)
    known = (weight * (sky.bound * sky.radiance + sky.clipped) / share).sum(axis=(0, 1)) / total
    return known, (weight * sky.clipped / share).sum(axis=(0, 1)) / total


def _patches(directions: Directions, brought: Floats) -> tuple[Directions, Integers]:
    """Centres (W, 3) of the patches, and the patch of each direction (K, 3). brought: (K,) light of each."""
    cells = fibonacci_sphere(CELLS)
    cell = scipy.spatial.cKDTree(cells).query(directions)[1]
    total = np.bincount(cell, brought, CELLS)
    kept = np.sort(np.argsort(-total, kind="stable")[:MOST_PATCHES])
    kept = kept[total[kept] > 0.0]
    return cells[kept], scipy.spatial.cKDTree(cells[kept]).query(directions)[1] if len(kept) else np.zeros(
        len(directions), int
    )


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
