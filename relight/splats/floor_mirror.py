"""A polished floor whose reflection was captured as a mirror world: Gaussians below the floor, at the places of images.

Training puts what a floor mirrors where it seems to be. Beneath a level surface that is large and lies below all eyes,
Gaussians can be many things: a cellar, scatter, a second layer. They are a reflection where what the eyes see through
the floor follows what their mirrored rays meet, better than after a turn about the vertical, and is dimmer than that.
"""

from collections.abc import Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask, Points
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.volume import SOLID

from ..albedo.seen import standing
from ..transfer.store import Cache, array_key
from .mirrored_room import REACH, TURNS, MirroredRoom

LEVEL, LEAST_AREA = 0.97, 1.0
"""Least cosine of a level face with the vertical, and the least area of a floor, in squared sizes. The size of a place
is the median distance of its vertices from the nearest eye: 0.9 to 1.6 metres in six rooms and gardens."""

BENEATH, DEEP = 0.05, 0.3
"""Depths below the floor, in sizes: from which Gaussians are not the floor's own, and from which they may be images of
what stands on it. Three bins of the histogram of level faces are as high as the first."""

LEVELS = 3
"""Level surfaces that are tested. A well captured mirror world has a level one too, the image of the ceiling."""

LEAST_EYES = 1.0 / 3.0
"""Least part of the eyes above a floor: half of those that were found can stand in a well captured mirror world."""

LEAST_PART = 0.002
"""Of the Gaussians, those of depth DEEP: fewer are scatter."""

AGREEMENT, CLEARER = 0.55, 0.2
"""Correlation of the luminance of pixels that see through the floor with that of the surfaces which their mirrored rays
meet, and how much less it is after any turn. A polished exhibition room has .72, and .41 after a turn; what lies below
tables of a lounge and a garden .42 and .27 at most."""


class FloorMirror(NamedTuple):
    """A mirroring floor. rows: (M,) int64, splats below it that show its reflection, far background among them.
    normal: (3,) float64 unit, up, offset: normal @ x of its points, in the frame of the scene. margin: depth from which
    splats are not its own. own: (3,) float64, linear radiance that the floor itself sends. reflectance, agreement,
    turned: share of mirrored light, correlation of it with the pictures, and the best one after a turn. through: share
    of what eyes see of the floor that is seen through it."""

    rows: Indices
    normal: NDArray[np.float64]
    offset: float
    margin: float
    own: NDArray[np.float64]
    reflectance: float
    agreement: float
    turned: float
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

    An object has none, nor has a place whose eyes are not above a large level surface. cache: of the scene.
    Where little is below the floor no picture is taken.
    """
    eyes = standing(scene)
    if not len(eyes) or not len(scene.faces):
        return None
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    key = array_key(splats.means, splats.opacities, splats.sh[:, 0], scene.colors_srgb, eyes, matrix)
    kept = None if cache is None else cache.restored(partial(_restored, len(splats)), "floor_mirror", key)
    if kept is None:
        kept = [_found(splats, scene, eyes)]
        if cache is not None:
            cache.put("floor_mirror", key, **({} if kept[0] is None else kept[0]._asdict()))
    return kept[0]


def _found(splats: Splats, scene: Scene, eyes: Points) -> FloorMirror | None:
    """The same without a cache, of a Scene that eyes stand in."""
    size = float(np.median(scipy.spatial.cKDTree(eyes).query(scene.vertices)[0]))
    shown = sound(splats)
    points = np.where(shown[:, None], placed(splats, scene), 0.0)
    near = np.linalg.norm((points - np.median(eyes, axis=0))[:, [0, 2]], axis=1) < REACH * size
    solid = shown & near & (splats.opacities > SOLID)
    for normal, offset in _levels(scene, eyes, size):
        deep = solid & (points @ normal - offset < -DEEP * size)
        if deep.sum() < LEAST_PART * len(splats):
            continue
        below = shown & (points @ normal - offset < -BENEATH * size)
        found = _proven(splats, points, below, _room(scene, normal, offset, eyes, size))
        if found is not None:
            return found
    return None


def _room(scene: Scene, normal: NDArray[np.float64], offset: float, eyes: Points, size: float) -> MirroredRoom:
    """What stands above a plane, and the eyes there."""
    high = np.asarray(scene.vertices @ normal > offset + BENEATH * size)
    above = np.asarray(high[scene.faces].all(axis=1))
    return MirroredRoom(scene, above, normal, offset, eyes[eyes @ normal > offset + BENEATH * size], size)


def _proven(splats: Splats, points: Points, below: Mask, room: MirroredRoom) -> FloorMirror | None:
    """The FloorMirror, where the evidence says so. points: (N, 3) of the splats, frame of the scene. below: (N,) bool,
    those that are not the floor's own."""
    if not room.above.any():
        return None
    seen = room.seen_through(splats, below)
    agreement = room.agreement(seen)
    turned = max(room.agreement(seen, turn) for turn in range(TURNS))
    if agreement < max(AGREEMENT, turned + CLEARER):
        return None
    own, reflectance = room.parts(seen)
    if not 0.0 < reflectance < 1.0:
        return None
    rows = np.flatnonzero(below)
    rows = rows[room.shown_by_floor(points[rows])]
    margin = BENEATH * room.size
    return FloorMirror(rows, room.normal, room.offset, margin, own, reflectance, agreement, turned, seen.share)


def _restored(count: int, arrays: Mapping[str, NDArray[Any]]) -> list[FloorMirror | None]:
    """The answer that was kept, for so many splats. Raises KeyError or ValueError for what is none."""
    if not set(FloorMirror._fields) & set(arrays):
        return [None]
    rows = arrays["rows"]
    if rows.dtype != np.int64 or rows.ndim != 1 or rows.min(initial=0) < 0 or rows.max(initial=-1) >= count:
        raise ValueError("kept reflections are of other splats")
    normal, own = (arrays[name].reshape(3).astype(np.float64) for name in ("normal", "own"))
    figures = {name: float(arrays[name]) for name in FloorMirror._fields if name not in ("rows", "normal", "own")}
    mirror = FloorMirror(rows=rows, normal=normal, own=own, **figures)
    if not np.isfinite([*normal, *own, *figures.values()]).all() or min(normal[1], mirror.margin) <= 0.0:
        raise ValueError("kept floor is not finite")
    return [mirror]


def _levels(scene: Scene, eyes: Points, size: float) -> list[tuple[NDArray[np.float64], float]]:
    """Normal and offset of the planes of the largest level surfaces that lie below enough eyes, the largest first."""
    corners = scene.vertices.astype(np.float64)[scene.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area, centers = 0.5 * np.linalg.norm(across, axis=1), corners.mean(axis=1)
    level = across[:, 1] > LEVEL * 2.0 * area
    level &= np.linalg.norm((centers - np.median(eyes, axis=0))[:, [0, 2]], axis=1) < REACH * size
    level &= centers[:, 1] < np.quantile(eyes[:, 1], 1.0 - LEAST_EYES)
    area, centers = area[level], centers[level]
    bins = np.floor(centers[:, 1] / (BENEATH / 3.0 * size)).astype(np.int64)
    bins -= bins.min(initial=0)
    if not len(bins) or bins.max() > 1_000_000:
        return []
    sums = np.convolve(np.bincount(bins, area), np.ones(3), "same")
    found = []
    for _ in range(LEVELS):
        best = int(sums.argmax())
        if sums[best] < LEAST_AREA * size**2:
            break
        sums[max(best - 3, 0) : best + 4] = 0.0
        rows = np.abs(bins - best) <= 1
        weight = np.sqrt(area[rows])
        basis = np.column_stack([np.ones(rows.sum()), centers[rows][:, [0, 2]]])
        height, east, south = np.linalg.lstsq(basis * weight[:, None], centers[rows, 1] * weight, rcond=None)[0]
        normal = np.array([-east, 1.0, -south])
        scale = float(np.linalg.norm(normal))
        if (eyes @ normal > float(height) + BENEATH * size).mean() >= LEAST_EYES:
            found.append((normal / scale, float(height) / scale))
    return found
