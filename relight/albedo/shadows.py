"""How deep the shadows of a sun are in the colours of a place: lit over shaded, away from their edges.

Splats blur a shadow over a few hundredths of a scene. Beside its edge the ratio of colours is therefore far below that
of the light; farther inside it comes near.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Mask, Vector
from splat2mesh.scene.color import luminance

from ..sh.sphere import fibonacci_sphere
from ..transfer.occluder import Occluder
from .sun import lit_by

LIT_DEG, SHADED_DEG, SPACING_DEG = 4.0, 8.0, 3.0
"""A point is lit, or shaded, where all directions so near to the sun are, and how far apart these are tried. Meshes
err, and what ends near a point in the shade lets light in."""

LEAST_COSINE = 0.3
"""Of the sun at both."""

DISTANCES, FARTHER, DEEP = (0.03, 0.02, 0.014, 0.01, 0.007), 4.0, 0.02
"""Distances to the other side, in the unit frame, of which the first with enough points counts, by how much more they
may be, and from which on the ratio is that of the light. Nearer to the edge it is a lower bound."""

LEAST_POINTS, BESIDE, LEAST_BESIDE = 150, 16, 3
"""Shaded points that must have lit ones beside them; how many of the nearest are taken, and how many must remain."""

REACH, APART, HUE = 8.0, 0.1, 0.3
"""How far away these may be, over the distance to the edge; how far apart, in the unit frame, opposite normals count;
and their difference in log chroma."""

PART = 2.0 / 3.0
"""Part of the shaded points whose ratio is less than that of the light: a third of what the mesh shades is lit in the
pictures, through leaves and holes. Of .5 to .75 this was best, with fifteen sunny captures in view (docs/albedo.md)."""

MOST_OVER_REST, HALVINGS = 12.0, 24
"""Largest irradiance of a sun at right angles over that of the rest, and steps that each halve the range below it."""


class CastShadows(NamedTuple):
    """Points in the cast shadows of a sun, and lit ones beside them. received: (N,) of all points by a sun of
    irradiance 1. log_captured: (N,) of luminance. shaded: (M,) of the points. lit: (M, BESIDE), -1 for none. distance:
    of both to the edge, at least, in the unit frame."""

    received: Floats
    log_captured: Floats
    shaded: NDArray[np.int64]
    lit: NDArray[np.int64]
    distance: float

    @property
    def deep(self) -> bool:
        """Whether they are so far from the edges that no blur reaches them."""
        return self.distance >= DEEP

    @property
    def depth(self) -> float:
        """Logarithm of lit over shaded in the colours."""
        return float(np.quantile(self._ratios(self.log_captured), PART))

    def irradiance(self, rest: Floats) -> float:
        """Irradiance of the sun at right angles that makes the light as deep, beside the rest of it, (N,) luminance."""
        wanted, rest = self.depth, np.maximum(rest, 1e-9)
        low, high = 0.0, MOST_OVER_REST * np.pi * float(np.median(rest))
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            less = np.median(self._ratios(np.log(rest + middle * self.received))) < wanted
            low, high = (middle, high) if less else (low, middle)
        return 0.5 * (low + high)

    def _ratios(self, logs: Floats) -> Floats:
        """(M,) by how much the logarithms (N,) of lit points, in the median, exceed that of the shaded one."""
        lit = np.where(self.lit >= 0, logs[self.lit], np.nan)
        return np.asarray(np.nanmedian(lit, axis=1) - logs[self.shaded])


def shadows_of(
    occluder: Occluder,
    rows: NDArray[np.int64],  # (N,) vertices of smooth surfaces
    captured: NDArray[np.float32],  # (N, 3) linear colours of them
    direction: Vector,  # (3,) of the sun
) -> CastShadows | None:
    """The CastShadows of a sun; None where too few points show them."""
    around = cap(direction, SHADED_DEG, SPACING_DEG)
    sent, near = lit_by(occluder, rows, around), around @ direction > np.cos(np.radians(LIT_DEG))
    upright = occluder.normals[rows] @ direction > LEAST_COSINE
    lit, opposite = upright & (sent[:, near] > 0.0).all(axis=1), upright & (sent[:, near] == 0.0).all(axis=1)
    if min(np.count_nonzero(lit), np.count_nonzero(opposite)) < LEAST_POINTS:
        return None
    places = np.hstack([occluder.origins[rows], APART * occluder.normals[rows]]).astype(np.float64)
    distance = np.zeros(len(rows))
    for one, other in ((lit, opposite), (opposite, lit)):
        distance[one] = scipy.spatial.cKDTree(places[other]).query(places[one])[0]
    shaded = upright & (sent == 0.0).all(axis=1)
    logs = np.log(captured.astype(np.float64))
    chroma = logs - logs.mean(axis=1, keepdims=True)
    for least in DISTANCES:
        inside = (distance > least) & (distance < FARTHER * least)
        found = _beside(places, chroma, np.flatnonzero(lit & inside), np.flatnonzero(shaded & inside), REACH * least)
        if len(found[0]) >= LEAST_POINTS:
            received = sent[:, near].mean(axis=1).astype(np.float64)
            return CastShadows(received, np.log(luminance(captured).astype(np.float64)), *found, least)
    return None


def cap(middle: Vector, within_deg: float, spacing_deg: float) -> Directions:
    """(D, 3) directions above the horizon around one, which is the first."""
    sphere = fibonacci_sphere(round(4.0 * np.pi / np.radians(spacing_deg) ** 2))
    near = (sphere @ middle > np.cos(np.radians(within_deg))) & (sphere[:, 1] > 0.0)
    return np.vstack([middle, sphere[near]])


def _beside(
    places: Floats,  # (N, 6)
    chroma: Floats,  # (N, 3)
    lit: NDArray[np.int64],
    shaded: NDArray[np.int64],
    reach: float,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Points in the shade with lit ones of their hue beside them, (M,), and these, (M, BESIDE), -1 for none."""
    if len(lit) < BESIDE or not len(shaded):
        return np.zeros(0, np.int64), np.zeros((0, BESIDE), np.int64)
    distance, index = scipy.spatial.cKDTree(places[lit]).query(places[shaded], BESIDE, distance_upper_bound=reach)
    near: Mask = np.isfinite(distance)
    beside = lit[np.where(near, index, 0)]
    near &= np.abs(chroma[shaded][:, None] - chroma[beside]).max(axis=2) < HUE
    enough = np.count_nonzero(near, axis=1) >= LEAST_BESIDE
    return shaded[enough], np.where(near, beside, -1)[enough]
