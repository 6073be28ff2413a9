"""Light of the Gaussians of a mirror world below a floor: that of the surfaces which the floor mirrors, and its own."""

from collections.abc import Callable
from copy import copy

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Indices, Mask
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import BLACK, linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

from ..albedo.seen import standing
from .attachment import Places, Surface
from .floor_mirror import LEVEL, FloorMirror
from .light_ratio import CURVE_POWER

LEAST_SHARE = 0.05
"""Part of a pixel that the mirror world gives, from which the pixel does not show the light of the mesh."""

Mix = Callable[[Floats, Floats, Floats], Floats]
"""Values (M, C) of reflections: of those at the mirrored places, of those on the floor, and of the floor's own part of
each colour, (M, 3)."""


def by_color(mirrored: Floats, floor: Floats, own: Floats) -> Floats:
    """Colours (M, 3): the floor's own part from the floor, the rest from what it mirrors."""
    return mirrored + own * (floor - mirrored)


def as_mirrored(mirrored: Floats, floor: Floats, own: Floats) -> Floats:
    """Values (M, C) at the mirrored places alone."""
    return mirrored


class MirroredPlaces:
    """Attachment of M Gaussians of a mirror world to the surfaces above the floor.

    rows: (M,) of the splats. means: (M, 3) float32, their mirrored places. own: (M, 3) float32, the part of each colour
    that the floor itself sends. normal: (3,) of the floor.
    """

    def __init__(
        self,
        mirror: FloorMirror,
        surface: Surface,
        scene: Scene,  # of the surface
        splats: Splats,  # which are lit, frame of the surface
        rows: Indices,  # (M,) of them: the mirror world
    ) -> None:
        """Raises InputError where nothing stands above the floor."""
        normal, offset, margin = plane_of(mirror, scene)
        height = surface.points.astype(np.float64) @ normal - offset
        corners = height[surface.faces]
        self.rows, self.normal = rows, normal
        self._above = _SurfacePart(surface, (corners > -margin).all(axis=1))
        level = surface.normals[surface.faces].mean(axis=1) @ normal > LEVEL
        self._floor = _SurfacePart(surface, level & (np.abs(corners) < margin).all(axis=1))
        some, back = splats.take(rows), np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
        means = some.means.astype(np.float64)
        depth = offset - means @ normal
        above = mirrored_splats(some, normal, depth)
        self.means, self._mirrored = above.means, Places(self._above.surface, above)
        eyes = standing(scene) @ back[:3, :3].T + back[:3, 3]
        seen = seen_at(means, depth, eyes, normal, offset)
        gap = np.linalg.norm(self._floor.surface.caster.closest(seen.astype(np.float32)).points - seen, axis=1)
        self._covered = np.flatnonzero(gap < margin)
        self._standing = Places(self._floor.surface, _moved(some, seen).take(self._covered))
        color = linear_from_srgb(np.clip(np.float32(0.5) + np.float32(SH_C0) * some.sh[:, 0], 0.0, 1.0))
        self.own = np.clip(mirror.own / np.maximum(color, BLACK), 0.0, 1.0).astype(np.float32)

    def log_gains(self, of_nodes: Floats, nearest: Floats) -> NDArray[np.float32]:
        """Log gain (M, 3) float32 of the Gaussians, of that of the surface's nodes: the floor's own part follows the
        floor, the rest what it mirrors. nearest: (M, 3) log gain of the surface nearest to each, for its own part where
        the mesh has no floor: it shows the light that falls through there."""
        mirrored, own = (np.exp(CURVE_POWER * logs) for logs in self.pair(of_nodes, nearest))
        return np.asarray(np.log(by_color(mirrored, own, self.own)) / CURVE_POWER, np.float32)

    def pair(self, of_nodes: Floats, nearest: Floats) -> tuple[Floats, Floats]:
        """Values (M, C) at the mirrored places and on the floor, of those of the surface's nodes and of those of the
        surface nearest to each Gaussian (M, C), which stand in where the mesh has no floor."""
        floor = nearest.copy()
        floor[self._covered] = self._standing.interpolate(of_nodes[self._floor.nodes])
        return self._mirrored.interpolate(of_nodes[self._above.nodes]), floor

    def reached(self, count: int) -> Mask:
        """Which of the surface's nodes, so many, any of the Gaussians takes light from: (count,) bool."""
        found = np.zeros(count, bool)
        for places, part in ((self._mirrored, self._above), (self._standing, self._floor)):
            found[part.nodes[places.columns[places.weights > 0.0]]] = True
        return found


class _SurfacePart:
    """Some faces of a Surface. surface: Surface of them alone. nodes: (m,) which of the whole its nodes are."""

    def __init__(self, whole: Surface, faces: Mask) -> None:
        if not faces.any():
            raise InputError("nothing stands above the floor that mirrors")
        self.nodes, corners = np.unique(whole.faces[faces], return_inverse=True)
        self.surface = copy(whole)
        self.surface.points, self.surface.normals = whole.points[self.nodes], whole.normals[self.nodes]
        self.surface.faces = corners.reshape(-1, 3).astype(np.int32)
        self.surface.areas, self.surface.used = whole.areas[self.nodes], np.ones(len(self.nodes), bool)
        self.surface._caster = None


def plane_of(mirror: FloorMirror, scene: Scene) -> tuple[NDArray[np.float64], float, float]:
    """Normal (3,), offset and margin of a floor of a Scene, in the frame of its splats."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    normal = matrix[:3, :3].T @ mirror.normal
    size = float(np.linalg.norm(normal))
    return normal / size, float(mirror.offset - matrix[:3, 3] @ mirror.normal) / size, mirror.margin / size


def mirrored_splats(splats: Splats, normal: NDArray[np.float64], depth: NDArray[np.float64]) -> Splats:
    """Splats as they lie on the other side of a plane. depth: (M,) below it."""
    moved = _moved(splats, splats.means + 2.0 * depth[:, None] * normal)
    w, x, y, z = splats.quats_wxyz.astype(np.float64).T
    # A Gaussian mirrored at a plane is one turned by half a turn about its normal: it has no handedness.
    a, b, c = normal
    turned = np.stack(
        [-a * x - b * y - c * z, a * w + b * z - c * y, b * w + c * x - a * z, c * w + a * y - b * x], axis=1
    )
    return Splats(moved.means, splats.scales, turned.astype(np.float32), splats.opacities, splats.sh)


def _moved(splats: Splats, means: NDArray[np.float64]) -> Splats:
    return Splats(means.astype(np.float32), splats.scales, splats.quats_wxyz, splats.opacities, splats.sh)


def seen_at(
    means: NDArray[np.float64],
    depth: NDArray[np.float64],
    eyes: NDArray[np.float64],  # (E, 3)
    normal: NDArray[np.float64],
    offset: float,
) -> NDArray[np.float64]:
    """Where on the floor the nearest eye sees each of means (M, 3), that far below it: (M, 3)."""
    nearest = eyes[scipy.spatial.cKDTree(eyes).query(means)[1]]
    high = nearest @ normal - offset
    return np.asarray(means + (depth / np.maximum(depth + high, 1e-12))[:, None] * (nearest - means))
