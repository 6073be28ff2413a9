"""Floaters: splats in the air between viewers and surfaces, which belong to no surface and no leaf.

Training leaves them before its cameras, where they explain a photograph or two. A floater meets three conditions: the
mesh is far, so it belongs to no surface; few other splats are near, so it is no leaf, twig or wire that the mesh
lacks; and the background is covered without it, so no hole opens. Near and far are angles, as seen from the
nearest place where people stand.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Mask, Points
from splat2mesh.render.opacitygrid import BEFORE
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import INVISIBLE_OPACITY, Splats
from splat2mesh.views.eyes import Eye, around
from splat2mesh.views.standpoints import EYES, NEAR_DIAGONAL
from splat2mesh.views.viewpoints import OUTER_FOV_DEG, even_directions

from ..albedo.seen import standing
from .sky import sky_rows

REACH = 0.15
"""Of the way from the nearest eye: a surface or a neighbour that is nearer holds a splat. In three generated gardens
.15 finds 96% of the floaters and takes .06% of what is solid and .7% of the leaves; .08 finds 99, .5 and 1.7%."""

REACH_OUTSIDE = 0.02
"""The same of an object that was captured from around it, whose eyes stand a diagonal away."""

NEIGHBORS = 4
"""The number of other splats within that reach that make one no floater: floaters come alone or in small clouds."""

COVERED = 0.9
"""Opacity of the remaining splats, in a pixel, above which removal leaves no gap."""

AGREED = 0.5
"""Part of the pictures of a splat in which it must be so."""

PIXELS = 128
"""Side of these pictures, six from each eye."""


class Eyes(NamedTuple):
    """From where people look, in the frame of the splats. points: (E, 3) float64. views: pictures of all that they see.
    of_view: (L,) int64, the eye of each. within: whether they stand in the scene."""

    points: NDArray[np.float64]
    views: list[View]
    of_view: NDArray[np.int64]
    within: bool

    @classmethod
    def of(cls, scene: Scene) -> "Eyes":
        """The eyes of a Scene: its camera positions, or else all around it."""
        matrix = np.asarray(scene.scene_from_splat, np.float64)
        back = np.linalg.inv(matrix)
        up = matrix[1, :3] / np.linalg.norm(matrix[1, :3])
        known = standing(scene)
        if len(known):
            points = known @ back[:3, :3].T + back[:3, 3]
            views = around([Eye(point, 0.0) for point in points], PIXELS, up)[0]
            return cls(points, views, np.repeat(np.arange(len(points)), len(views) // len(points)), True)
        low, high = scene.bounds
        away = 0.5 / np.sin(np.radians(OUTER_FOV_DEG) / 2)  # diagonals, from which all of it shows
        points = 0.5 * (low + high) + away * scene.diagonal * even_directions(EYES)
        points = points @ back[:3, :3].T + back[:3, 3]
        middle = 0.5 * (low + high) @ back[:3, :3].T + back[:3, 3]
        views = [View.look_at(point, middle, up, OUTER_FOV_DEG, PIXELS) for point in points]
        return cls(points, views, np.arange(len(points)), False)


def floaters(splats: Splats, scene: Scene) -> Indices:
    """Rows (M,), in order, of the Splats of a Scene that are floaters.

    splats: every row of the source, in its frame. Sky, far background and unseen splats (behind a wall, invisible,
    damaged) are not floaters. Of an object, only splats in the box of its mesh are considered: farther out, nothing
    distinguishes floaters from a sky.
    """
    possible = sound(splats) & (splats.opacities >= INVISIBLE_OPACITY)
    possible[scene.background_splats] = False
    possible[sky_rows(splats, scene.background_splats, scene.scene_from_splat)] = False
    rows = np.flatnonzero(possible)
    if not len(rows) or not len(scene.faces):
        return rows[:0]
    eyes, means = Eyes.of(scene), splats.means.astype(np.float64)
    back = np.linalg.inv(np.asarray(scene.scene_from_splat, np.float64))
    caster = RayCaster(scene.vertices @ back[:3, :3].T + back[:3, 3], scene.faces)
    sees = _sees(caster, eyes.points, means[rows])
    away = np.where(sees, np.linalg.norm(means[rows] - eyes.points[:, None], axis=2), np.inf).min(axis=0)
    reach = (REACH if eyes.within else REACH_OUTSIDE) * away
    apart = np.linalg.norm(caster.closest(means[rows]).points - means[rows], axis=1)
    thick = np.sort(splats.scales[rows], axis=1)[:, 1]
    loose = np.isfinite(away) & (apart > reach + thick)
    loose &= eyes.within | _inside(scene, back, means[rows])
    loose[loose] = _alone(means[rows], rows[loose], rows, reach[loose])
    return _covered(splats, rows[loose], sees[:, loose], eyes, NEAR_DIAGONAL * _length(scene, back))


def _inside(scene: Scene, back: NDArray[np.float64], points: Points) -> Mask:
    """Whether points (N, 3) of the frame of the splats lie in the box of the mesh."""
    ahead = np.linalg.inv(back)
    placed = points @ ahead[:3, :3].T + ahead[:3, 3]
    low, high = scene.bounds
    return np.asarray(((placed >= low) & (placed <= high)).all(axis=1))


def _sees(caster: RayCaster, eyes: Points, points: Points) -> Mask:
    """Whether each eye (E, 3) sees each point (N, 3) past the surfaces: (E, N) bool."""
    found = np.empty((len(eyes), len(points)), bool)
    rays = np.empty((len(points), 6), np.float32)
    for number, eye in enumerate(eyes):
        rays[:, :3], rays[:, 3:] = eye, points - eye
        found[number] = ~caster.occluded(rays, BEFORE)
    return found


def _alone(points: Points, asked: Indices, rows: Indices, reach: NDArray[np.float64]) -> Mask:
    """Whether fewer than NEIGHBORS others of the points (N, 3), which are of `rows`, lie within reach of some."""
    place = np.searchsorted(rows, asked)
    count = min(NEIGHBORS + 1, len(points))  # each is its own nearest
    distance = scipy.spatial.cKDTree(points).query(points[place], count)[0].reshape(len(place), count)
    return np.asarray(distance[:, -1] > reach) if count > NEIGHBORS else np.ones(len(place), bool)


def _covered(splats: Splats, rows: Indices, sees: Mask, eyes: Eyes, near: float) -> Indices:
    """Those of some rows (M,) behind which the others hide all, in most of the pictures of those who see them: (E, M)
    bool."""
    if not len(rows):
        return rows
    rest = splats.take(np.delete(np.arange(len(splats)), rows))
    shown, hidden = np.zeros(len(rows)), np.zeros(len(rows))
    for view, eye in zip(eyes.views, eyes.of_view, strict=True):
        pixels, depth = view.project(splats.means[rows].astype(np.float64))
        with np.errstate(invalid="ignore"):
            inside = (depth > near) & (pixels >= 0).all(axis=1) & (pixels < [view.width, view.height]).all(axis=1)
        there = np.flatnonzero(inside & sees[eye])
        if not len(there):
            continue
        column, row = pixels[there].astype(np.int64).T
        shown[there] += 1.0
        hidden[there] += rasterize(rest, view, near).alpha[row, column] >= COVERED
    return rows[(shown > 0.0) & (hidden > AGREED * shown)]


def _length(scene: Scene, back: NDArray[np.float64]) -> float:
    """Diagonal of a scene in the frame of its splats."""
    return float(scene.diagonal * np.cbrt(abs(np.linalg.det(back[:3, :3]))))
