"""A polished floor whose reflection was captured as a mirror world: Gaussians below the floor, at the places of images.

Training puts what a floor mirrors where it seems to be. Beneath a level surface that lies below eyes, Gaussians can be
many things: a cellar, scatter, a second layer. They are a reflection where what the eyes see through the floor follows
what their mirrored rays meet, and is dimmer than that.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Indices, Mask, Points
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster, corner_weights
from splat2mesh.scene.color import linear_from_srgb, luminance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.volume import SOLID
from splat2mesh.views.eyes import Eye, around
from splat2mesh.views.standpoints import NEAR_DIAGONAL

from ..albedo.seen import standing
from ..transfer.store import Cache, array_key
from .looks import EYES, MIN_ALPHA

LEVEL = 0.97
"""Least cosine of a level face with the vertical."""

BENEATH = 0.05
"""Depth below the floor from which Gaussians are not the floor's own, in sizes. The size of a place is the median
distance of its vertices from the nearest eye: 0.9 to 1.6 metres in six rooms and gardens."""

REACH = 6.0
"""Around the eyes, in sizes: how far the floor of a place matters."""

LEVELS = 3
"""Level surfaces that are tested. A well captured mirror world has a level one too, the image of the ceiling."""

LEAST_PART = 0.002
"""Of the Gaussians, those below a floor: fewer are scatter."""

AGREEMENT = 0.55
"""Correlation of the luminance of pixels that see through the floor with that of the surfaces which their mirrored rays
meet. A polished exhibition room has .72; what lies below tables of a lounge and a garden .42 and .27 at most."""

PIXELS = 64
"""Along a side of the pictures through the floor."""


class FloorMirror(NamedTuple):
    """A mirroring floor. rows: (M,) int64, splats below it that show its reflection, far background among them.
    normal: (3,) float64 unit, up, offset: normal @ x of its points, in the frame of the scene. margin: depth from which
    splats are not its own. own: (3,) float64, linear radiance that the floor itself sends. color: (3,), linear, what
    eyes see there in the mean. reflectance, agreement: share of mirrored light, correlation of it with the pictures.
    through: share of what eyes see of the floor that is seen through it."""

    rows: Indices
    normal: NDArray[np.float64]
    offset: float
    margin: float
    own: NDArray[np.float64]
    color: NDArray[np.float64]
    reflectance: float
    agreement: float
    through: float

    def spared(self, rows: Indices) -> Indices:
        """Those of some rows (K,) of the splats that are no reflection."""
        return rows[~np.isin(rows, self.rows)]

    def as_dict(self) -> dict[str, Any]:
        """The entry of the report, JSON-clean."""
        own = [round(float(each), 4) for each in self.own]
        figures = {name: round(float(getattr(self, name)), 4) for name in ("reflectance", "agreement", "through")}
        return {
            "splats": len(self.rows),
            "height": round(self.offset / float(self.normal[1]), 4),
            "own": own,
            **figures,
        }


def placed(splats: Splats, scene: Scene) -> NDArray[np.float64]:
    """Means (N, 3) in the frame of the scene."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    return splats.means.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def floor_mirror(splats: Splats, scene: Scene, cache: Cache | None = None) -> FloorMirror | None:
    """The FloorMirror of a Scene made of these Splats, every row of the source; None where nothing shows one for sure.

    An object has none, nor has a place whose eyes are not above a level surface. Where little is below the floor no
    picture is taken. cache: of the scene, which keeps that there is none.
    """
    eyes = standing(scene)
    if not len(eyes) or not len(scene.faces):
        return None
    key = array_key(splats.means, splats.opacities, splats.sh[:, 0], scene.colors_srgb, eyes)
    if cache is not None and cache.restored(lambda kept: kept["none"], "floor_mirror", key) is not None:
        return None
    found = _found(splats, scene, eyes)
    if found is None and cache is not None:
        cache.put("floor_mirror", key, none=eyes)
    return found


def _found(splats: Splats, scene: Scene, eyes: Points) -> FloorMirror | None:
    """The same of a Scene that eyes stand in."""
    size = float(np.median(scipy.spatial.cKDTree(eyes).query(scene.vertices)[0]))
    whole = sound(splats)
    points = np.where(whole[:, None], placed(splats, scene), 0.0)
    solid = (splats.opacities > SOLID) & _near(points, eyes, size)
    for normal, offset in _levels(scene, eyes, size):
        below = whole & (points @ normal - offset < -BENEATH * size)
        if (below & solid).sum() >= LEAST_PART * len(splats):
            room = _Room(scene, normal, offset, eyes[eyes @ normal > offset + BENEATH * size], size)
            found = room.mirror(splats, points, below)
            if found is not None:
                return found
    return None


def _near(points: Points, eyes: Points, size: float) -> Mask:
    """Which points (N, 3) are around the eyes (E, 3), seen from above: (N,) bool."""
    return np.asarray(np.linalg.norm((points - np.median(eyes, axis=0))[:, [0, 2]], axis=1) < REACH * size)


def _levels(scene: Scene, eyes: Points, size: float) -> list[tuple[NDArray[np.float64], float]]:
    """Normal and offset of the planes of the largest level surfaces that lie below an eye, the largest first."""
    corners = scene.vertices.astype(np.float64)[scene.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area, centers = 0.5 * np.linalg.norm(across, axis=1), corners.mean(axis=1)
    step = BENEATH * size
    level = (across[:, 1] > LEVEL * 2.0 * area) & _near(centers, eyes, size)
    level &= centers[:, 1] < eyes[:, 1].max() - step
    area, centers = area[level], centers[level]
    found = []
    for _ in range(LEVELS if len(area) else 0):
        heights, bins = np.unique(np.floor(centers[:, 1] / step), return_inverse=True)
        best = (heights[np.bincount(bins, area).argmax()] + 0.5) * step
        rows = np.abs(centers[:, 1] - best) < step
        weight = np.sqrt(area[rows])
        basis = np.column_stack([np.ones(rows.sum()), centers[rows][:, [0, 2]]])
        height, east, south = np.linalg.lstsq(basis * weight[:, None], centers[rows, 1] * weight, rcond=None)[0]
        normal = np.array([-east, 1.0, -south])
        scale = float(np.linalg.norm(normal))
        found.append((normal / scale, float(height) / scale))
        area[rows] = 0.0
    return found


@dataclass(frozen=True, eq=False)
class _Room:
    """What stands on a plane of a Scene, normal @ x = offset, of unit normal. eyes: (E, 3) above it. size: of the
    place. All in the frame of the scene."""

    scene: Scene
    normal: NDArray[np.float64]
    offset: float
    eyes: Points
    size: float

    @property
    def margin(self) -> float:
        return BENEATH * self.size

    @cached_property
    def _faces(self) -> NDArray[np.int32]:
        high = self.scene.vertices @ self.normal > self.offset - self.margin
        return self.scene.faces[high[self.scene.faces].all(axis=1)]

    @cached_property
    def _caster(self) -> RayCaster:
        return RayCaster(self.scene.vertices, self._faces)

    def mirror(self, splats: Splats, points: Points, below: Mask) -> FloorMirror | None:
        """The FloorMirror, where the evidence says so. points: (N, 3) of the splats. below: (N,) bool, those that are
        not the floor's own."""
        if not len(self._faces) or not len(self.eyes):
            return None
        places, rays, seen, through = self._seen_through(splats.take(np.flatnonzero(below)))
        rows, mirrored = self._mirrored(places, rays)
        shown = seen[rows]
        bright = luminance(mirrored), luminance(shown)
        if len(shown) < 3 or min(map(np.ptp, bright)) <= 0.0:
            return None
        agreement, (own, reflectance) = float(np.corrcoef(*bright)[0, 1]), _parts(mirrored, shown)
        if agreement < AGREEMENT or not 0.0 < reflectance < 1.0:
            return None
        images = np.flatnonzero(below)
        images = images[self._shown_by_floor(points[images])]
        color = seen.mean(axis=0, dtype=np.float64)
        plane = self.normal, self.offset, self.margin
        return FloorMirror(images, *plane, own, color, reflectance, agreement, through)

    def _seen_through(self, lower: Splats) -> tuple[Points, Directions, Points, float]:
        """What eyes see of Splats below the plane: places on it and unit rays, (P, 3) each, linear colours (P, 3), and
        the share of it in all that they see of the plane."""
        matrix = np.asarray(self.scene.scene_from_splat, np.float64)
        back = np.linalg.inv(matrix)
        near = NEAR_DIAGONAL * self.scene.diagonal * float(np.cbrt(abs(np.linalg.det(back[:3, :3]))))
        eyes = [Eye(back[:3, :3] @ eye + back[:3, 3], near) for eye in self.eyes[:EYES]]
        up = matrix[1, :3] / np.linalg.norm(matrix[1, :3])
        none, of_plane = np.zeros((0, 3)), 0
        found: list[tuple[Points, Directions, Points]] = [(none, none, none)]
        for view in around(eyes, PIXELS, up)[0]:
            eye = matrix[:3, :3] @ view.center + matrix[:3, 3]
            rays = view.ray_directions().reshape(-1, 3) @ matrix[:3, :3].T
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            down = np.maximum(-(rays @ self.normal), 1e-6)
            far = (eye @ self.normal - self.offset) / down
            seen = np.flatnonzero(far < REACH * self.size)
            ways = (far + self.margin / down)[seen, None] * rays[seen]
            free = ~self._caster.occluded(np.hstack([np.broadcast_to(eye, ways.shape), ways]).astype(np.float32), 1.0)
            of_plane += len(seen)
            seen = seen[free]
            if not len(seen):
                continue
            picture = rasterize(lower, view, near)
            opacity = picture.alpha.reshape(-1)[seen]
            seen, opacity = seen[opacity > MIN_ALPHA], opacity[opacity > MIN_ALPHA, None]
            shown = np.clip(picture.color.reshape(-1, 3)[seen] / opacity, 0.0, 1.0).astype(np.float32)
            found.append((eye + far[seen, None] * rays[seen], rays[seen], linear_from_srgb(shown)))
        places, rays, colors = (np.concatenate(each) for each in zip(*found, strict=True))
        return places, rays, colors, len(places) / max(of_plane, 1)

    def _mirrored(self, places: Points, rays: Directions) -> tuple[Mask, Points]:
        """Which mirrored rays meet something above, (P,) bool, and its radiance (R, 3), linear."""
        rise = rays @ self.normal
        up = rays - 2.0 * rise[:, None] * self.normal
        starts = places + (self.margin / np.maximum(-rise, 1e-6))[:, None] * up  # over what is left of the floor
        hits = self._caster.first_hits(np.hstack([starts, up]).astype(np.float32))
        rows = hits.faces >= 0
        radiance = self.scene.colors_linear[self._faces[hits.faces[rows]]]
        return rows, np.einsum("nk,nkc->nc", corner_weights(hits.uv[rows]), radiance)

    def _shown_by_floor(self, points: Points) -> Mask:
        """Which of points (N, 3) below the eyes see through the plane in the room: (N,) bool. Where free lines of sight
        meet the plane something is above. What is outdoors and below a window's sill has lines that meet it outdoors:
        more eyes decide."""
        votes = np.zeros(len(points), np.int64)
        depth = self.offset - points @ self.normal
        for eye in self.eyes:
            high = eye @ self.normal - self.offset
            way = ((high - self.margin) / np.maximum(high + depth, 1e-12))[:, None] * (points - eye)
            starts = np.broadcast_to(eye, way.shape)
            free = ~self._caster.occluded(np.hstack([starts, way]).astype(np.float32), 1.0)
            up = np.hstack([starts + way, np.broadcast_to(self.normal, way.shape)]).astype(np.float32)
            votes += np.where(free, np.where(self._caster.occluded(up), 1, -1), 0)
        return votes > 0


def _parts(mirrored: Points, shown: Points) -> tuple[NDArray[np.float64], float]:
    """Radiance that the floor itself sends, (3,) linear, and its reflectance: what is shown, (R, 3), is one plus the
    other times what is mirrored, (R, 3).

    Errors of the mirrored radiance would flatten a regression. The means of two groups, its darkest and brightest
    thirds, are less subject to them (Wald, "The fitting of straight lines if both variables are subject to error",
    1940).
    """
    bright = luminance(mirrored)
    least, most = np.quantile(bright, (1.0 / 3.0, 2.0 / 3.0))
    low, high = mirrored[bright <= least].mean(axis=0), mirrored[bright >= most].mean(axis=0)
    dim, lit = shown[bright <= least].mean(axis=0), shown[bright >= most].mean(axis=0)
    reflectance = float(luminance(lit - dim) / max(float(luminance(high - low)), 1e-9))
    return np.maximum(dim - reflectance * low, 0.0).astype(np.float64), reflectance
