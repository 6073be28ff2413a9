"""What stands above a plane, mirrored at it, against what shows below: the evidence for a mirror world."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Faces, Mask, Points
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import FREE, RayCaster, corner_weights
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb, luminance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats
from splat2mesh.views.standpoints import NEAR_DIAGONAL

REACH = 6.0
"""Around the eyes, in sizes of the place: how far its floor matters."""

TURNS = 7
"""Turns about the vertical that must fit worse."""

EYES, SIDES, PIXELS, FIELD_DEG, SLOPE = 6, 3, 64, 80.0, 0.45
"""Of the pictures through the floor: eyes, pictures from each, pixels along a side, field of view, and how far down
they look."""

THROUGH = 0.3
"""Opacity that Gaussians beneath add to a pixel that sees through the floor."""


class SeenThrough(NamedTuple):
    """What eyes see through a plane. places: (P, 3) on it, rays: (P, 3) unit, frame of the scene. colors: (P, 3)
    linear. share: of all that they see of the plane."""

    places: Points
    rays: Directions
    colors: Points
    share: float


@dataclass(frozen=True, eq=False)
class MirroredRoom:
    """A Scene of which the faces (F,) bool `above` stand above a plane, normal @ x = offset, of unit normal.

    eyes: (E, 3) of the capture. size: length that distances are compared with. Both in the frame of the scene.
    """

    scene: Scene
    above: Mask
    normal: NDArray[np.float64]
    offset: float
    eyes: Points
    size: float

    @cached_property
    def _faces(self) -> Faces:
        return self.scene.faces[self.above]

    @cached_property
    def _caster(self) -> RayCaster:
        return RayCaster(self.scene.vertices, self._faces)

    def seen_through(self, splats: Splats, below: Mask) -> SeenThrough:
        """What the eyes see of the Splats of the scene that are below the plane, (N,) bool."""
        matrix = np.asarray(self.scene.scene_from_splat, np.float64)
        back = np.linalg.inv(matrix)
        upper, lower = splats.take(np.flatnonzero(~below)), splats.take(np.flatnonzero(below))
        near = NEAR_DIAGONAL * self.scene.diagonal * float(np.cbrt(abs(np.linalg.det(back[:3, :3]))))
        found, of_plane = [], 0
        for eye, view in views_down(self.eyes, matrix, PIXELS):
            rays = view.ray_directions().reshape(-1, 3) @ matrix[:3, :3].T
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            far = (eye @ self.normal - self.offset) / np.maximum(-(rays @ self.normal), 1e-6)
            down = np.flatnonzero(far < REACH * self.size)
            of_plane += len(down)
            over, under = (rasterize(each, view, near) for each in (upper, lower))
            opacity = under.alpha.reshape(-1)[down]
            rows = (1.0 - over.alpha.reshape(-1)[down]) * opacity > THROUGH
            shown = under.color.reshape(-1, 3)[down[rows]] / opacity[rows, None]
            linear = linear_from_srgb(np.clip(shown, 0.0, 1.0).astype(np.float32))
            seen = down[rows]
            found.append((eye + far[seen, None] * rays[seen], rays[seen], linear))
        places, rays, colors = (np.concatenate(each) for each in zip(*found, strict=True))
        return SeenThrough(places, rays, colors, len(places) / max(of_plane, 1))

    def agreement(self, seen: SeenThrough, turn: int | None = None) -> float:
        """Correlation of the luminance of what is seen with that of what mirrored rays meet, after a turn of both."""
        places, rays = seen.places, seen.rays
        if turn is not None:
            places, rays = self._turned(places, turn), rays @ _turn(turn).T
        rows, mirrored = self._met(places, rays)
        pair = luminance(mirrored), luminance(seen.colors[rows])
        if rows.sum() < 3 or min(map(np.ptp, pair)) <= 0.0:
            return 0.0
        return float(np.corrcoef(*pair)[0, 1])

    def parts(self, seen: SeenThrough) -> tuple[NDArray[np.float64], float]:
        """Radiance that the floor itself sends, (3,) linear, and its reflectance: what is seen is one plus the other
        times what is mirrored.

        Errors of the mirrored radiance would flatten a regression. The means of two groups, its darkest and brightest
        thirds, are less subject to them (Wald, "The fitting of straight lines if both variables are subject to error",
        1940).
        """
        rows, mirrored = self._met(seen.places, seen.rays)
        bright, shown = luminance(mirrored), seen.colors[rows]
        least, most = np.quantile(bright, (1.0 / 3.0, 2.0 / 3.0))
        low, high = mirrored[bright <= least].mean(axis=0), mirrored[bright >= most].mean(axis=0)
        dim, lit = shown[bright <= least].mean(axis=0), shown[bright >= most].mean(axis=0)
        reflectance = float(luminance(lit - dim) / max(float(luminance(high - low)), 1e-9))
        return np.maximum(dim - reflectance * low, 0.0).astype(np.float64), reflectance

    def shown_by_floor(self, points: Points) -> Mask:
        """Which of points (N, 3) below the eyes see through the plane in the room: (N,) bool. Where free lines of sight
        meet the plane something is above. What is outdoors and below a window's sill has lines that meet it outdoors:
        more eyes decide."""
        votes = np.zeros(len(points), np.int64)
        depth = self.offset - points @ self.normal
        for eye in self.eyes:
            high = eye @ self.normal - self.offset
            way = (high / np.maximum(high + depth, 1e-12))[:, None] * (points - eye)
            starts = np.broadcast_to(eye, way.shape)
            free = ~self._caster.occluded(np.hstack([starts, way]).astype(np.float32), FREE)
            up = np.hstack([starts + way, np.broadcast_to(self.normal, way.shape)]).astype(np.float32)
            votes += np.where(free, np.where(self._caster.occluded(up), 1, -1), 0)
        return votes > 0

    def _met(self, places: Points, rays: Directions) -> tuple[Mask, Points]:
        """Which mirrored rays meet something above, (P,) bool, and its radiance (R, 3), linear."""
        up = rays - 2.0 * (rays @ self.normal)[:, None] * self.normal
        hits = self._caster.first_hits(np.hstack([places, up]).astype(np.float32))
        rows = hits.faces >= 0
        radiance = self.scene.colors_linear[self._faces[hits.faces[rows]]]
        return rows, np.einsum("nk,nkc->nc", corner_weights(hits.uv[rows]), radiance)

    def _turned(self, points: Points, turn: int) -> Points:
        """Points (N, 3) turned about the vertical through the middle of the eyes."""
        middle = np.median(self.eyes, axis=0)
        return (points - middle) @ _turn(turn).T + middle


def _turn(number: int) -> NDArray[np.float64]:
    """One of TURNS turns about the vertical, none of them whole: (3, 3)."""
    angle = 2.0 * np.pi * (number + 1) / (TURNS + 1)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def views_down(eyes: Points, matrix: NDArray[np.float64], pixels: int) -> Iterator[tuple[NDArray[np.float64], View]]:
    """(eye (3,) of some of the eyes, frame of the scene; a View of the splats from there), SIDES for each, that look
    down on the floor. matrix: (4, 4) scene_from_splat. pixels: along a side."""
    back = np.linalg.inv(matrix)
    for number, eye in enumerate(_apart(eyes)):
        for side in range(SIDES):
            angle = 2.0 * np.pi * side / SIDES + number
            ahead = np.array([np.cos(angle), -SLOPE, np.sin(angle)])
            start, end = (back[:3, :3] @ each + back[:3, 3] for each in (eye, eye + ahead))
            yield eye, View.look_at(start, end, matrix[1, :3], FIELD_DEG, pixels)


def _apart(eyes: Points) -> Points:
    """EYES of the eyes, far from each other."""
    chosen = [0]
    while len(chosen) < min(EYES, len(eyes)):
        gaps = np.linalg.norm(eyes[:, None] - eyes[chosen], axis=2).min(axis=1)
        chosen.append(int(gaps.argmax()))
    return eyes[chosen]
