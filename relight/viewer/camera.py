"""The camera of the session: it orbits a point, stays upright, and cannot lose the scene."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.view import View

from ..output.kinds import PICTURE_SIZE

HIGHEST_DEG = 89.0
"""Largest elevation: a view straight down has no upright direction."""

ORBIT_DEG = 180.0  # of the eye, or of a light, by a drag across the height of the window
WHEEL = 1.12  # factor of distance for one step
ZOOM = 1000.0  # times nearer and farther than the scene's diagonal that the eye goes to its target

TOO_NEAR = 0.1
"""Distance of a target from the eye, over the diagonal, that can only be a direction."""

PICTURE_ASPECT = PICTURE_SIZE[0] / PICTURE_SIZE[1]  # for which the cameras of scenes are made

WIDEST_DEG = 100.0
"""Field of view beyond which a window distorts too much."""

_AHEAD_COSINE = math.cos(math.radians(5.0))


@dataclass(frozen=True)
class Orbit:
    """An eye that looks at a target, y up.

    target: (3,) scene frame. distance: of the eye from it. azimuth_deg: of the eye, from +z towards +x.
    elevation_deg: of the eye, towards +y. fov_deg: horizontal. diagonal: of the scene.
    """

    target: tuple[float, ...]
    distance: float
    azimuth_deg: float
    elevation_deg: float
    fov_deg: float
    diagonal: float

    @classmethod
    def of(cls, camera: Mapping[str, Any], vertices: NDArray, diagonal: float) -> "Orbit":
        """From a dict of eye, target and fov_deg, as `Scene.preview_camera`; its up is taken to be +y.

        A target close before the eye gives only a direction, as from within a room: move it to the surface seen there.
        """
        eye = np.array(camera["eye"], float)
        away = eye - camera["target"]
        distance = float(np.linalg.norm(away))
        away /= distance
        if distance < TOO_NEAR * diagonal:
            distance = _depth_ahead(vertices - eye, -away, TOO_NEAR * diagonal)
            target = eye - distance * away
        else:
            target = np.array(camera["target"], float)
        elevation = math.degrees(math.asin(np.clip(away[1], -1.0, 1.0)))
        azimuth = math.degrees(math.atan2(away[0], away[2]))
        elevation = min(max(elevation, -HIGHEST_DEG), HIGHEST_DEG)
        return cls(tuple(target), distance, azimuth, elevation, camera["fov_deg"], diagonal)

    def focal(self, size: tuple[int, int]) -> float:
        """Focal length in pixels, in a window of this width and height."""
        return 0.5 * size[0] / math.tan(math.radians(self.fov_deg) / 2.0)

    def ray(self, x: float, y: float, size: tuple[int, int]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The eye and the unit direction to a pixel, from the lower left."""
        width, height = size
        way = np.array([x - width / 2, y - height / 2, -self.focal(size)]) @ self.axes
        return self.eye, way / np.linalg.norm(way)

    def view(self, size: tuple[int, int]) -> View:
        """It as a View in the frame of the scene."""
        return View.look_at(self.eye, self.target, [0.0, 1.0, 0.0], self.fov_deg, *size)

    def in_window(self, aspect: float, bars: tuple[float, float] = (0.0, 0.0), within: bool = False) -> "Orbit":
        """The same view in a partly covered window, whose free part shows a whole picture of PICTURE_ASPECT.

        aspect: of the window, width over height. bars: shares of its height that are covered above and below. within:
        whether the eye is inside the scene: then it stays there with a wider angle. Otherwise it moves back.
        """
        top, bottom = bars
        free = 1.0 - top - bottom
        wide = math.tan(math.radians(self.fov_deg) / 2.0)
        factor = max(1.0, aspect / PICTURE_ASPECT / free)
        lower = wide * factor / aspect * (bottom - top)  # over the distance: the middle of what is free lies higher
        if within:
            fov = min(2.0 * math.degrees(math.atan(factor * wide)), WIDEST_DEG)
            tilted = replace(self, fov_deg=fov).dragged(0.0, -math.degrees(math.atan(lower)) / ORBIT_DEG)
            return replace(tilted, target=tuple(self.eye - self.distance * tilted.axes[2]))
        shift = -lower * self.distance * self.axes[1]
        return replace(self, distance=factor * self.distance, target=tuple(np.array(self.target) + shift))

    @property
    def axes(self) -> NDArray:
        """Unit vectors (3, 3) in the scene frame: right, up, and backward, from the target to the eye."""
        azimuth, elevation = math.radians(self.azimuth_deg), math.radians(self.elevation_deg)
        right = (math.cos(azimuth), 0.0, -math.sin(azimuth))
        level = math.cos(elevation)
        backward = (math.sin(azimuth) * level, math.sin(elevation), math.cos(azimuth) * level)
        return np.array([right, np.cross(backward, right), backward])

    @property
    def eye(self) -> NDArray:
        """(3,) scene frame."""
        return np.array(self.target) + self.distance * self.axes[2]

    def dragged(self, right: float, up: float) -> "Orbit":
        """Look around: drag the scene by these parts of the height of the window."""
        elevation = min(max(self.elevation_deg - ORBIT_DEG * up, -HIGHEST_DEG), HIGHEST_DEG)
        return replace(self, azimuth_deg=(self.azimuth_deg - ORBIT_DEG * right) % 360.0, elevation_deg=elevation)

    def moved(self, right: float, up: float, aspect: float) -> "Orbit":
        """Move sideways by parts of the height of the window: the target follows the mouse."""
        height = 2.0 * self.distance * math.tan(math.radians(self.fov_deg) / 2.0) / aspect
        shift = -height * (right * self.axes[0] + up * self.axes[1])
        return replace(self, target=tuple(np.array(self.target) + shift))

    def nearer(self, steps: float) -> "Orbit":
        """Towards the target by steps of the wheel; negative ones lead away."""
        distance = self.distance * WHEEL**-steps
        return replace(self, distance=min(max(distance, self.diagonal / ZOOM), ZOOM * self.diagonal))


def _depth_ahead(offsets: NDArray, forward: NDArray, least: float) -> float:
    """Distance to the nearest of the vertices, (V, 3) from the eye, within 5 degrees of `forward`; `least` at least."""
    depth = offsets @ forward
    ahead = depth[depth > np.maximum(least, _AHEAD_COSINE * np.linalg.norm(offsets, axis=1))]
    return float(ahead.min(initial=np.inf)) if len(ahead) else least
