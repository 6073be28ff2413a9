"""One pinhole camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arrays import Points


@dataclass(frozen=True)
class View:
    """A pinhole camera in the COLMAP / OpenCV convention: x right, y down, z forward.

    width, height: image size in pixels; the centre of pixel (column i, row j) lies at (i + 1/2, j + 1/2).
    fx, fy, cx, cy: intrinsics in pixels.
    camera_from_world: (4, 4) float64 rigid transform, in the frame of the splat it looks at.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    camera_from_world: np.ndarray

    @staticmethod
    def look_at(
        eye: ArrayLike, target: ArrayLike, up: ArrayLike, fov_deg: float, width: int, height: int | None = None
    ) -> "View":
        """A camera at `eye` that looks at `target`, image top towards `up`.

        eye, target, up: (3,) in world units; an `up` along the line of sight is replaced by a coordinate axis.
        fov_deg: horizontal field of view. height: `width` unless given.
        """
        height = width if height is None else height
        eye, target, up = (np.asarray(a, np.float64) for a in (eye, target, up))
        forward = _unit(target - eye)
        right = np.cross(forward, up)
        if np.linalg.norm(right) < 1e-6 * np.linalg.norm(up):
            right = np.cross(forward, np.eye(3)[np.abs(forward).argmin()])
        right = _unit(right)
        rotation = np.stack([right, np.cross(forward, right), forward])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ eye
        focal = 0.5 * width / np.tan(np.radians(fov_deg) / 2)
        return View(width, height, focal, focal, width / 2, height / 2, matrix)

    def holding(self, points: ArrayLike, margin: float = 1.15) -> "View":
        """The same view moved, nearest to points whose image just holds them all. points: (N, 3) world. margin: of the
        image over what they fill."""
        rotation = self.camera_from_world[:3, :3]
        # Sums in a fixed order: the rounding of a matrix product depends on its threads.
        x, y, z = (rotation[:, None] * np.asarray(points, np.float64)).sum(axis=2)
        # Each side of the frustum touches a point when the eye lies on a line; the lines of opposite sides cross
        # where both touch, and the pair that crosses farther back decides.
        slope_x, slope_y = self.width / 2 / self.fx / margin, self.height / 2 / self.fy / margin
        right, left = np.max(x - slope_x * z), np.max(-x - slope_x * z)
        below, above = np.max(y - slope_y * z), np.max(-y - slope_y * z)
        depth = min(-(right + left) / (2 * slope_x), -(below + above) / (2 * slope_y))
        matrix = self.camera_from_world.copy()
        matrix[:3, 3] = -np.array([(right - left) / 2, (below - above) / 2, depth])
        return replace(self, camera_from_world=matrix)

    @property
    def center(self) -> NDArray[np.float64]:
        """Camera centre in the world: (3,) float64."""
        return -self.camera_from_world[:3, :3].T @ self.camera_from_world[:3, 3]

    @property
    def forward(self) -> NDArray[np.float64]:
        """Viewing direction in the world: (3,) unit float64."""
        return self.camera_from_world[2, :3]

    def resized(self, longest: int) -> "View":
        """The same view with its longer side at `longest` pixels."""
        scale = longest / max(self.width, self.height)
        width, height = max(1, round(self.width * scale)), max(1, round(self.height * scale))
        sx, sy = width / self.width, height / self.height
        return View(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy, self.camera_from_world)

    def framing(self, points: Points) -> "View":
        """The same pose and image size limit, zoomed so that the image just holds world points in front: (N, 3)."""
        pixels, _ = self.project(points)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        zoom = max(self.width, self.height) / (high - low).max()
        # A millionth of a pixel less, lest rounding add a whole one.
        width, height = np.maximum(np.ceil((high - low) * zoom - 1e-6), 1).astype(int)
        cx, cy = (np.array([self.cx, self.cy]) - low) * zoom
        return View(int(width), int(height), self.fx * zoom, self.fy * zoom, cx, cy, self.camera_from_world)

    def project(self, points: ArrayLike) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Image positions and depths of world points: (N, 3) -> (N, 2) pixels and (N,) camera z."""
        local = np.asarray(points) @ self.camera_from_world[:3, :3].T + self.camera_from_world[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = local[:, :2] / local[:, 2:] * [self.fx, self.fy] + [self.cx, self.cy]
        return pixels, local[:, 2]

    def shown(self, points: ArrayLike) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
        """Which world points (N, 3) lie within the image: their rows (M,), the row and column of the pixel of each,
        (2, M), and their camera z (M,)."""
        pixels, depth = self.project(points)
        with np.errstate(invalid="ignore"):
            inside = (depth > 0) & (pixels >= 0).all(axis=1) & (pixels < [self.width, self.height]).all(axis=1)
        rows = np.flatnonzero(inside)
        return rows, pixels[rows].astype(np.int64).T[::-1], depth[rows]

    def ray_directions(self) -> NDArray[np.float64]:
        """World directions through all pixel centres, scaled to camera z = 1: (H, W, 3) float64."""
        x = (np.arange(self.width) + 0.5 - self.cx) / self.fx
        y = (np.arange(self.height) + 0.5 - self.cy) / self.fy
        local = np.stack([*np.meshgrid(x, y), np.ones((self.height, self.width))], axis=-1)
        return local @ self.camera_from_world[:3, :3]


class ViewStack(NamedTuple):
    """M views whose pixels lie one after the other, row by row, as kernels read them.

    poses: (M, 3, 4) float64 camera_from_world. lenses: (M, 4) float64 fx, fy, cx, cy. sizes: (M, 2) int64 height and
    width. starts: (M,) int64 first pixel of each.
    """

    poses: NDArray[np.float64]
    lenses: NDArray[np.float64]
    sizes: NDArray[np.int64]
    starts: NDArray[np.int64]


def stacked(views: Sequence[View]) -> ViewStack:
    """The ViewStack of some views."""
    sizes = np.array([[view.height, view.width] for view in views], np.int64)
    pixels = sizes.prod(axis=1)
    return ViewStack(
        np.array([view.camera_from_world[:3] for view in views]),
        np.array([[view.fx, view.fy, view.cx, view.cy] for view in views], float),
        sizes,
        pixels.cumsum() - pixels,
    )


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    return vector / np.linalg.norm(vector)
