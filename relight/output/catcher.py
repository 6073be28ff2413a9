"""A soft shadow on the ground under an object: the light from above that it occludes."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.views.viewpoints import even_directions

from ..insert.standing import ROOM
from ..light.projections import row_solid_angles, texel_directions
from ..live.ground import ShadowedGround
from .backdrop import unturned

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

    from ..light.environment import Environment

SIDE = 128
"""Points of the ground along a side of the sampled square."""

REACH = 4.0
"""Half of that side, in radii of the object: beyond it no shadow is drawn."""

CROWDED = 0.3
"""Factor by which points in the middle are denser than evenly spread ones: feet are small."""

DIRECTIONS, SHARED = 512, 4
"""Directions of the upper hemisphere from which light is looked for, and those that share the light of a texel: they
lie 6.5 degrees apart, which softens every shadow by as much."""

BLUR = 0.8
"""Standard deviation, in points, by which shadows are smoothed: the ground's points leave no stairs."""

LIFT = 1e-3
"""Height above the ground, in radii, from which rays start: the object's own underside hides all, not a part."""


class Catcher:
    """The ground under an object, level, at its lowest vertex. What the object hides is found once, for any light.

    height: of the ground, scene frame. side: points of the ground along a side of the sampled square.
    """

    def __init__(self, scene: "Scene", caster: RayCaster, side: int = SIDE) -> None:
        low, high = scene.bounds
        self.height = float(low[1])
        self._middle = 0.5 * (low + high)[[0, 2]]
        self._radius = max(0.5 * float(np.linalg.norm(high - low)), 1e-12)
        self._side = side
        across = _spread(np.linspace(-1.0, 1.0, side)) * REACH * self._radius
        points = np.empty((side, side, 3), np.float32)
        points[..., 0] = self._middle[0] + across[None, :]
        points[..., 1] = self.height + LIFT * self._radius
        points[..., 2] = self._middle[1] + across[:, None]
        directions = even_directions(2 * DIRECTIONS)[:, [0, 2, 1]]
        self._directions = directions[directions[:, 1] > 0.0].astype(np.float32)
        rays = np.empty((side * side, 6), np.float32)
        rays[:, :3] = points.reshape(-1, 3)
        self._open = np.empty((len(self._directions), side * side), bool)
        middle = np.asarray(0.5 * (low + high), np.float64)
        offsets = middle - rays[:, :3]
        beside = np.square(offsets).sum(axis=1) - (ROOM * self._radius) ** 2
        for index, direction in enumerate(self._directions):
            near = np.flatnonzero(np.square(offsets @ direction) > beside)  # rays past the whole object meet nothing
            rays[:, 3:] = direction
            self._open[index] = True
            self._open[index, near] = ~caster.occluded(rays[near])

    def ground(self) -> ShadowedGround:
        """The same for the page."""
        steps = _spread(np.linspace(-1.0, 1.0, self._side)).astype(np.float32)
        reach = REACH * self._radius
        return ShadowedGround(self.height, self._middle, reach, steps, self._directions, ~self._open, SHARED, BLUR)

    def under(self, environment: "Environment") -> "GroundLight":
        """The ground in a light."""
        arriving = self._arriving(environment)
        lit, whole = np.einsum("kp,kc->pc", self._open.astype(np.float32), arriving), arriving.sum(axis=0)
        share = np.divide(lit, whole, out=np.ones_like(lit), where=whole > 0.0).reshape(self._side, self._side, 3)
        share = scipy.ndimage.gaussian_filter(share, (BLUR, BLUR, 0), mode="nearest")
        return GroundLight(self.height, self._middle, REACH * self._radius, share)

    def _arriving(self, environment: "Environment") -> NDArray[np.float32]:
        """Irradiance (K, 3) float32 of level ground from around each direction."""
        height, width = environment.radiance.shape[:2]
        above = texel_directions(height, width)[: height // 2].reshape(-1, 3)
        areas = np.repeat(row_solid_angles(height, width)[: height // 2, 0], width)
        light = environment.radiance[: height // 2].reshape(-1, 3) * (areas * above[:, 1])[:, None]
        canonical = unturned(self._directions, environment.rotation_deg)
        away, nearest = scipy.spatial.cKDTree(canonical).query(above, SHARED)
        weights = np.maximum(1.0 - away / np.maximum(away[:, -1:] * 1.2, 1e-9), 0.0) ** 2
        weights /= weights.sum(axis=1, keepdims=True)
        arriving = np.zeros((len(self._directions), 3))
        for rank in range(SHARED):
            for channel in range(3):
                shared = weights[:, rank] * light[:, channel]
                arriving[:, channel] += np.bincount(nearest[:, rank], shared, len(self._directions))
        return arriving.astype(np.float32)


class GroundLight(NamedTuple):
    """Ground in a light. height: scene frame. middle: (2,) float64, x and z. reach: half of the sampled square's side.
    shares: (S, S, 3) float32 of the light from above."""

    height: float
    middle: NDArray[np.floating]
    reach: float
    shares: NDArray[np.float32]

    def share_seen(self, eye: NDArray, directions: NDArray) -> NDArray[np.float32]:
        """The same (N, 3) of the ground that an eye (3,) above it sees in directions (N, 3), scene frame; 1 where it
        sees none."""
        share, above = np.ones((len(directions), 3), np.float32), float(eye[1]) - self.height
        met = -directions[:, 1] > 1e-3
        if above > 0.0 and met.any():
            reached = directions[met] * (above / -directions[met, 1])[:, None]
            share[met] = self.share(np.stack([eye[0] + reached[:, 0], eye[2] + reached[:, 2]], axis=-1))
        return share

    def share(self, points: NDArray) -> NDArray[np.float32]:
        """Share (N, 3) float32 of the light from above that reaches points (N, 2) of the ground: x and z."""
        # What is still in shadow at the rim of the square fades out there, without an edge.
        offset = (np.asarray(points, np.float64) - self.middle) / self.reach
        fade = np.clip(4.0 * (1.0 - np.linalg.norm(offset, axis=1)), 0.0, 1.0)
        near, share = np.flatnonzero(fade), np.ones((len(offset), 3), np.float32)
        place = (_gathered(np.clip(offset[near], -1.0, 1.0)) + 1.0) * 0.5 * (len(self.shares) - 1)
        for channel in range(3):
            found = scipy.ndimage.map_coordinates(
                self.shares[..., channel], (place[:, 1], place[:, 0]), order=1, mode="nearest"
            )
            share[near, channel] = 1.0 - fade[near] * (1.0 - found)
        return share


def _spread(u: NDArray) -> NDArray:
    """Positions in [-1, 1] of even steps in [-1, 1]: denser about 0."""
    return u * (CROWDED + (1.0 - CROWDED) * u * u)


def _gathered(position: NDArray) -> NDArray:
    """The inverse of `_spread`: the real root of its cubic, Cardano's."""
    root = np.sqrt(CROWDED / (3.0 * (1.0 - CROWDED)))
    return np.asarray(2.0 * root * np.sinh(np.arcsinh(1.5 * position / (CROWDED * root)) / 3.0))
