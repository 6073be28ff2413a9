"""A polished floor whose reflection was captured as a mirror world: Gaussians below the floor, at the places of images.

Training puts what a floor mirrors where it seems to be. Beneath a level surface that is large and lies below all eyes,
Gaussians can be many things: a cellar, scatter, a second layer. They are a reflection where three things agree. Their
places, mirrored at the floor, lie on surfaces above it, better than for other heights of the floor and than after a
turn about the vertical. What the eyes see through the floor is as bright as what their mirrored rays meet, better than
after such turns. And it is dimmer than that.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from splat2mesh.base.arrays import Directions, Indices, Mask, Points
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb, luminance
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import Splats

from ..albedo.seen import standing

REACH = 6.0
"""Around the eyes, level, in sizes of the scene: how far a floor matters. The size is the median distance of
vertices from the nearest eye: 0.9 to 1.6 metres in six rooms and gardens."""

LEVEL, BIN, LEAST_AREA = 0.97, 0.015, 1.0
"""Least cosine of a level face with the vertical, height of a bin of their histogram, in sizes, and the least area of a
floor in three of them, in squared sizes."""

BENEATH, DEEP = 0.05, 0.3
"""Depths below the floor, in sizes: from which Gaussians are not the floor's own, and from which their mirrored
places say something: those of shallower ones always lie near the floor."""

LEAST_COUNT, LEAST_PART = 300, 0.002
"""Gaussians of this depth, and their part of all: fewer are scatter. A polished exhibition room has .9%; five rooms and
gardens without a reflection have up to .1, and an office .6."""

CLOSE, SHIFT, TURNS = 0.04, 0.2, 7
"""Distance, in sizes, at which a mirrored place counts half as on a surface; the heights, above and below the floor,
and the number of turns about the vertical that must fit worse."""

CLOSER = 1.25
"""Factor by which the true plane must fit better than those. The exhibition room has 1.5."""

PLACES = 4000
"""Gaussians of that comparison."""

EYES, SIDES, PIXELS, FIELD_DEG, SLOPE = 6, 3, 64, 80.0, 0.45
"""Of the pictures through the floor: eyes, pictures from each, pixels along a side, field of view, and how far down
they look."""

NEAR = 0.02
"""Near plane of these, in sizes."""

THROUGH, LEAST_THROUGH = 0.3, 0.03
"""Opacity that Gaussians beneath add to a pixel that sees through the floor, and the least share of such pixels."""

AGREEMENT, CLEARER = 0.35, 0.15
"""Correlation of the luminance of such pixels with that of the surfaces which their mirrored rays meet, and how much
less it is after any turn. The exhibition room has .57 and .25."""

WEAKEST, STRONGEST = 0.03, 0.7
"""Reflectances of a floor. What is as bright as above is no reflection, but another room."""


class FloorMirror(NamedTuple):
    """A mirroring floor. normal: (3,) float64 unit, up, and offset: normal @ x of its points, in the frame of the scene.
    margin: depth from which what lies below is its reflection. own: (3,) float64, linear radiance that the floor itself
    sends. reflectance, agreement, turned: share of mirrored light, correlation of it with the pictures, and the best
    one after a turn. through: share of what eyes see of the floor that is seen through it."""

    normal: NDArray[np.float64]
    offset: float
    margin: float
    own: NDArray[np.float64]
    reflectance: float
    agreement: float
    turned: float
    through: float

    def rows(self, splats: Splats, scene: Scene) -> Indices:
        """Rows (M,) of the Splats of a Scene that are its reflection."""
        with np.errstate(invalid="ignore", over="ignore"):
            below = _placed(splats, scene) @ self.normal < self.offset - self.margin
        below[scene.background_splats] = False
        return np.flatnonzero(below & sound(splats))

    def as_dict(self, count: int) -> dict[str, Any]:
        """The entry of the report, JSON-clean. count: of rows."""
        own = [round(float(each), 4) for each in self.own]
        figures = {name: round(float(getattr(self, name)), 4) for name in ("reflectance", "agreement", "through")}
        return {"splats": count, "height": round(self.offset / float(self.normal[1]), 4), "own": own, **figures}


def floor_mirror(splats: Splats, scene: Scene, seed: int = 0) -> FloorMirror | None:
    """The FloorMirror of a Scene made of these Splats, every row of the source; None where nothing shows one for sure.

    An object has none, nor has a place whose eyes are not all above its largest level surface.
    """
    eyes = standing(scene)
    if not len(eyes) or not len(scene.faces):
        return None
    size = float(np.median(cKDTree(eyes).query(scene.vertices)[0]))
    found = _floor(scene, eyes, size)
    if found is None:
        return None
    normal, offset = found
    shown = sound(splats)
    points = np.where(shown[:, None], _placed(splats, scene), 0.0)
    middle = np.median(eyes, axis=0)
    near = shown & (splats.opacities > 0.1) & (np.linalg.norm((points - middle)[:, [0, 2]], axis=1) < REACH * size)
    height = points @ normal - offset
    deep = np.flatnonzero(near & (height < -DEEP * size))
    if len(deep) < max(LEAST_COUNT, LEAST_PART * len(splats)):
        return None
    above = (scene.vertices @ normal > offset + BENEATH * size)[scene.faces].all(axis=1)
    room = _Room(scene, above, normal, offset, middle)
    if len(deep) > PLACES:
        deep = np.sort(np.random.default_rng(seed).choice(deep, PLACES, replace=False))
    if not above.any() or not room.images(points[deep], size):
        return None
    seen, through = _seen_through(splats, shown & (height < -BENEATH * size), scene, eyes, size, room)
    return None if seen is None else room.agreeing(*seen, BENEATH * size, through)


class _Room(NamedTuple):
    """What stands above a plane, faces `above` of a Scene, and the middle of the eyes."""

    scene: Scene
    above: Mask
    normal: NDArray[np.float64]
    offset: float
    middle: NDArray[np.float64]

    def mirrored(self, points: Points, shift: float = 0.0) -> Points:
        """Points (N, 3) mirrored at the plane, or at one so much higher."""
        return points - 2.0 * (points @ self.normal - self.offset - shift)[:, None] * self.normal

    def turned(self, points: Points, turn: int) -> Points:
        """Points (N, 3) turned about the vertical through the middle."""
        return (points - self.middle) @ _turn(turn).T + self.middle

    def images(self, points: Points, size: float) -> bool:
        """Whether points (N, 3) lie where images of the surfaces above lie."""
        caster = RayCaster(self.scene.vertices, self.scene.faces[self.above])

        def closeness(mirrored: Points) -> float:
            apart = np.linalg.norm(caster.closest(mirrored).points - mirrored, axis=1) / (CLOSE * size)
            return float(np.mean(1.0 / (1.0 + apart * apart)))

        others = [self.mirrored(points, shift * size) for shift in (-SHIFT, SHIFT)]
        others += [self.mirrored(self.turned(points, turn)) for turn in range(TURNS)]
        return closeness(self.mirrored(points)) > CLOSER * max(map(closeness, others))

    def agreeing(
        self, places: Points, rays: Directions, colors: Points, margin: float, through: float
    ) -> FloorMirror | None:
        """The FloorMirror, where what eyes see through places (N, 3) of the plane along rays agrees with what stands
        above. colors: (N, 3) linear."""
        faces = self.scene.faces[self.above]
        caster = RayCaster(self.scene.vertices, faces)
        radiance = self.scene.colors_linear

        def met(places: Points, rays: Directions) -> tuple[Mask, Points]:
            up = rays - 2.0 * (rays @ self.normal)[:, None] * self.normal
            hits = caster.first_hits(np.hstack([places, up]).astype(np.float32))
            rows = hits.faces >= 0
            second, third = hits.uv[rows].T
            shares = np.stack([1.0 - second - third, second, third], axis=1)
            return rows, np.einsum("nk,nkc->nc", shares, radiance[faces[hits.faces[rows]]])

        def agreement(places: Points, rays: Directions) -> float:
            rows, mirrored = met(places, rays)
            pair = luminance(mirrored), luminance(colors[rows])
            return float(np.corrcoef(*pair)[0, 1]) if rows.sum() > 2 and min(map(np.ptp, pair)) > 0.0 else 0.0

        found = agreement(places, rays)
        turned = max(agreement(self.turned(places, turn), rays @ _turn(turn).T) for turn in range(TURNS))
        rows, mirrored = met(places, rays)
        if found < max(AGREEMENT, turned + CLEARER):
            return None
        # Errors of the mirrored radiance would flatten a regression: means of two groups do not (Wald 1940).
        least, most = np.quantile(luminance(mirrored), (1.0 / 3.0, 2.0 / 3.0))
        dark, bright = luminance(mirrored) <= least, luminance(mirrored) >= most
        low, high = mirrored[dark].mean(axis=0), mirrored[bright].mean(axis=0)
        dim, lit = colors[rows][dark].mean(axis=0), colors[rows][bright].mean(axis=0)
        reflectance = float(luminance(lit - dim) / max(luminance(high - low), 1e-9))
        if not WEAKEST < reflectance < STRONGEST:
            return None
        own = np.clip(dim - reflectance * low, 0.0, None).astype(np.float64)
        return FloorMirror(self.normal, self.offset, margin, own, reflectance, found, turned, through)


def _turn(number: int) -> NDArray[np.float64]:
    """One of TURNS turns about the vertical, none of them whole: (3, 3)."""
    angle = 2.0 * np.pi * (number + 1) / (TURNS + 1)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def _placed(splats: Splats, scene: Scene) -> NDArray[np.float64]:
    """Means (N, 3) in the frame of the scene."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    return splats.means.astype(np.float64) @ matrix[:3, :3].T + matrix[:3, 3]


def _floor(scene: Scene, eyes: Points, size: float) -> tuple[NDArray[np.float64], float] | None:
    """Normal and offset of the plane of the largest level surface, where all eyes are above it."""
    corners = scene.vertices.astype(np.float64)[scene.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area, centers = 0.5 * np.linalg.norm(across, axis=1), corners.mean(axis=1)
    level = across[:, 1] > LEVEL * 2.0 * area
    level &= np.linalg.norm((centers - np.median(eyes, axis=0))[:, [0, 2]], axis=1) < REACH * size
    if not level.any():
        return None
    area, centers = area[level], centers[level]
    bins = np.floor(centers[:, 1] / (BIN * size)).astype(np.int64)
    bins -= bins.min()
    if bins.max() > 1_000_000:
        return None
    sums = np.convolve(np.bincount(bins, area), np.ones(3), "same")
    best = int(sums.argmax())
    if sums[best] < LEAST_AREA * size**2:
        return None
    rows = np.abs(bins - best) <= 1
    weight = np.sqrt(area[rows])
    basis = np.column_stack([np.ones(rows.sum()), centers[rows][:, [0, 2]]])
    height, east, south = np.linalg.lstsq(basis * weight[:, None], centers[rows, 1] * weight, rcond=None)[0]
    normal = np.array([-east, 1.0, -south])
    scale = float(np.linalg.norm(normal))
    normal, offset = normal / scale, float(height) / scale
    return (normal, offset) if (eyes @ normal > offset + BENEATH * size).all() else None


def _seen_through(
    splats: Splats, below: Mask, scene: Scene, eyes: Points, size: float, room: _Room
) -> tuple[tuple[Points, Directions, Points] | None, float]:
    """What eyes see through the plane: its places, rays (N, 3) and linear colours, frame of the scene, or None where
    that is little; and its share of all that they see of the plane."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    back = np.linalg.inv(matrix)
    upper, lower = splats.take(np.flatnonzero(~below)), splats.take(np.flatnonzero(below))
    near = NEAR * size * float(np.cbrt(abs(np.linalg.det(back[:3, :3]))))
    found, of_plane = [], 0
    for number, eye in enumerate(_apart(eyes)):
        for side in range(SIDES):
            angle = 2.0 * np.pi * side / SIDES + number
            ahead = np.array([np.cos(angle), -SLOPE, np.sin(angle)])
            at, to = (back[:3, :3] @ each + back[:3, 3] for each in (eye, eye + ahead))
            view = View.look_at(at, to, matrix[1, :3], FIELD_DEG, PIXELS)
            rays = view.ray_directions().reshape(-1, 3) @ matrix[:3, :3].T
            rays /= np.linalg.norm(rays, axis=1, keepdims=True)
            fall = -(rays @ room.normal)
            far = (eye @ room.normal - room.offset) / np.maximum(fall, 1e-6)
            down = np.flatnonzero(far < REACH * size)
            of_plane += len(down)
            over, under = (rasterize(each, view, near) for each in (upper, lower))
            opacity = under.alpha.reshape(-1)[down]
            left = 1.0 - over.alpha.reshape(-1)[down]
            rows = left * opacity > THROUGH
            shown = under.color.reshape(-1, 3)[down[rows]] / opacity[rows, None]
            linear = linear_from_srgb(np.clip(shown, 0.0, 1.0).astype(np.float32))
            seen = down[rows]
            found.append((eye + far[seen, None] * rays[seen], rays[seen], linear))
    share = sum(len(each[0]) for each in found) / max(of_plane, 1)
    if share < LEAST_THROUGH:
        return None, share
    places, rays, colors = (np.concatenate(each) for each in zip(*found, strict=True))
    return (places, rays, colors), share


def _apart(eyes: Points) -> Points:
    """EYES of the eyes, far from each other."""
    chosen = [0]
    while len(chosen) < min(EYES, len(eyes)):
        gaps = np.linalg.norm(eyes[:, None] - eyes[chosen], axis=2).min(axis=1)
        chosen.append(int(gaps.argmax()))
    return eyes[chosen]
