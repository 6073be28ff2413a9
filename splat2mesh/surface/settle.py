"""Depth maps settled on the planes that their pixels belong to."""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Faces, Floats, Integers, Mask, Points, Vector
from ..base.kernels import kernel
from ..base.threads import shared
from ..render.opacityfield import FieldDepth
from ..render.view import View
from .extract import thickness_of
from .planes import SIGMAS, Plane

SAMPLED = 17
"""Every so many pixels of a depth map tell how depths lie about a plane."""

THIN = 25
"""Percentile of the thickness of surfaces that is typical of thin ones: leaves and grass are thick."""

EVEN = 3**-0.5
"""Standard deviation of what lies evenly within 1. Half of it is the most for depths that gather about a plane."""

AROUND = 3
"""Cells along the side of the squares whose pixels tell whether their depths are better known than the plane."""

STEPS = 20
"""Steps of the fit of these depths."""

LEAST_PIXELS = 100
"""Pixels that a plane needs in the sample: views saw it then."""


class PackedPlanes(NamedTuple):
    """P planes for the kernel.

    planes: (P, 4) float64 normal and offset. noise: (P,). fog: (P, 2) float64, middle and standard deviation of how far
    depths lie before each. frames: (P, 2, 3) axes, lows: (P, 2), cells: (P,) as of Plane. shapes: (P, 2) int64 cells.
    starts: (P,) int64 first cell of each. solid: (C,) bool.
    """

    planes: NDArray[np.float64]
    noise: NDArray[np.float64]
    fog: NDArray[np.float64]
    frames: NDArray[np.float64]
    lows: NDArray[np.float64]
    cells: NDArray[np.float64]
    shapes: NDArray[np.int64]
    starts: NDArray[np.int64]
    solid: Mask

    @classmethod
    def of(
        cls, planes: Sequence[Plane], views: Sequence[View], seen: Sequence[FieldDepth], band: float
    ) -> "PackedPlanes":
        """Those of a list of Plane that views saw, FieldDepth each. band: as of `planes_of`."""
        kept, fogs = [], []
        points, rays, spreads = _sampled(views, seen)
        for plane in planes:
            slope = rays @ plane.normal
            before = (points @ plane.normal - plane.offset) * -np.sign(slope)
            near = np.flatnonzero(np.abs(before) < band)
            crossing = points[near] + rays[near] * (before[near] / np.maximum(np.abs(slope[near]), 1e-9))[:, None]
            near = near[_solid_at(plane, crossing)]
            fog = _fog(before[near], band, plane.noise)
            if fog is not None and fog[1] < EVEN * band / 2:
                near = near[(before[near] > -SIGMAS * plane.noise) & (before[near] < fog[0] + SIGMAS * fog[1])]
                crisp = spreads[near] * np.abs(slope[near]) < plane.noise
                kept.append(plane._replace(solid=plane.solid & ~_mostly(crisp, _cells(plane, points[near]), plane)))
                fogs.append(fog)
                left = np.ones(len(points), bool)
                left[near] = False
                points, rays, spreads = points[left], rays[left], spreads[left]
        sizes = np.array([plane.solid.shape for plane in kept], np.int64).reshape(-1, 2)
        ends = sizes.prod(axis=1).cumsum()
        return cls(
            np.array([[*plane.normal, plane.offset] for plane in kept]).reshape(-1, 4),
            np.array([plane.noise for plane in kept], float),
            np.array(fogs, float).reshape(-1, 2),
            np.array([plane.axes for plane in kept]).reshape(-1, 2, 3),
            np.array([plane.low for plane in kept]).reshape(-1, 2),
            np.array([plane.cell for plane in kept], float),
            sizes,
            ends - sizes.prod(axis=1),
            np.concatenate([np.zeros(0, bool), *(plane.solid.ravel() for plane in kept)]),
        )

    def settled(self, view: View, seen: FieldDepth) -> FieldDepth:
        """What a view sees, each pixel that belongs to a plane on it: depth, normal, and the plane's noise as spread.

        A pixel belongs to a plane where that is solid, if three times its own spread reach the Gaussians there, and it
        lies no farther before it than depths of this plane do. Of several planes it takes the most likely.
        """
        if len(self.planes) == 0:
            return seen
        depth, normal, spread = seen.depth.copy(), seen.normal.copy(), seen.spread.copy()
        lens = np.array([view.fx, view.fy, view.cx, view.cy])
        _settle(len(depth), self, view.camera_from_world, view.center, lens, depth, normal, spread)
        return replace(seen, depth=depth, normal=normal, spread=spread)

    def share_of(self, points: Points, faces: Faces, middle: Vector, reach: float) -> float:
        """The share of the area of a mesh, points (V, 3) and faces (F, 3), that lies on the planes. Area far from
        `middle` counts less: a quarter at `reach`."""
        corners = points[faces].astype(np.float64)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        area /= (1 + (np.linalg.norm(corners.mean(axis=1) - middle, axis=1) / reach) ** 2) ** 2
        on = np.zeros(len(faces), bool)
        for plane, noise in zip(self.planes, self.noise, strict=True):
            on |= (np.abs(corners @ plane[:3] - plane[3]) < noise).all(axis=1)
        return float(area[on].sum() / max(area.sum(), 1e-300))


def band_of(views: Sequence[View], seen: Sequence[FieldDepth]) -> float:
    """How far from its plane the fog of a wall may reach, world units: three times the thickness of the thin surfaces
    that views see, of which a quarter are thinner."""
    thickness = np.concatenate(
        [thickness_of(each, view).ravel()[::SAMPLED] for view, each in zip(views, seen, strict=True)]
    )
    known = thickness[np.isfinite(thickness)]
    return SIGMAS * float(np.percentile(known, THIN)) if len(known) else 0.0


def _sampled(views: Sequence[View], seen: Sequence[FieldDepth]) -> tuple[Floats, Floats, Floats]:
    """Points (N, 3) that some pixels of each view see, the rays (N, 3) to them, of z = 1, and their spreads (N,)."""
    points, rays, spreads = [], [], []
    for view, each in zip(views, seen, strict=True):
        at = np.flatnonzero(np.isfinite(each.depth.ravel()))[::SAMPLED]
        rays.append(view.ray_directions().reshape(-1, 3)[at])
        points.append(view.center + rays[-1] * each.depth.ravel()[at].astype(np.float64)[:, None])
        spreads.append(each.spread.ravel()[at])
    return np.concatenate(points), np.concatenate(rays), np.concatenate(spreads)


def _cells(plane: Plane, points: Floats) -> Integers:
    """The cells (N, 2) of a plane in which points (N, 3) lie, the nearest for those beside them."""
    at = np.floor((points @ plane.axes.T - plane.low) / plane.cell)
    return np.clip(at, 0, np.array(plane.solid.shape) - 1).astype(np.int64)


def _solid_at(plane: Plane, points: Floats) -> Mask:
    """Whether a plane is solid at points (N, 3) of it."""
    at = _cells(plane, points)
    return plane.solid[at[:, 0], at[:, 1]]


def _mostly(those: Mask, at: Integers, plane: Plane) -> Mask:
    """Cells of a plane around which most of some pixels, in cells `at` (N, 2), are `those` (N,)."""
    flat, shape = np.ravel_multi_index(at.T, plane.solid.shape), plane.solid.shape
    balance = np.bincount(flat, those * 2.0 - 1.0, plane.solid.size).reshape(shape)
    return scipy.ndimage.uniform_filter(balance, AROUND, mode="constant") > 0


def _fog(before: Floats, band: float, noise: float) -> tuple[float, float] | None:
    """Middle and standard deviation of how far depths (N,) lie before a plane: normal, or evenly within the band."""
    if len(before) < LEAST_PIXELS:
        return None
    middle, spread, share = float(np.median(before)), band / SIGMAS, 0.5
    for _ in range(STEPS):
        on = share * np.exp(-0.5 * ((before - middle) / spread) ** 2) / (np.sqrt(2 * np.pi) * spread)
        weight = on / (on + (1 - share) / (2 * band))
        mass = float(weight.sum())
        share, middle = min(mass / len(before), 1 - 1e-6), float(weight @ before) / mass
        spread = max(float(np.sqrt(weight @ (before - middle) ** 2 / mass)), noise / SIGMAS)
    return middle, spread


@shared
@kernel
def _settle(
    begin: int,
    end: int,
    planes: PackedPlanes,
    pose: Floats,
    eye: Floats,
    lens: Floats,
    depth: Floats,
    normal: Floats,
    spread: Floats,
) -> None:
    ray, hit = np.empty(3), np.empty(3)
    for row in range(begin, end):
        for column in range(depth.shape[1]):
            z, deep = depth[row, column], spread[row, column]
            if not (z > 0 and deep >= 0):
                continue
            x, y = (column + 0.5 - lens[2]) / lens[0], (row + 0.5 - lens[3]) / lens[1]
            for a in range(3):
                ray[a] = pose[0, a] * x + pose[1, a] * y + pose[2, a]
            best, chosen = np.inf, -1
            for p in range(len(planes.planes)):
                n = planes.planes[p]
                slope = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]
                if slope == 0:
                    continue
                t = (n[3] - n[0] * eye[0] - n[1] * eye[1] - n[2] * eye[2]) / slope
                steep = abs(slope)
                before = (t - z) * steep
                farthest = planes.fog[p, 0] + SIGMAS * planes.fog[p, 1]
                noise = planes.noise[p]
                if t <= 0 or before < -SIGMAS * noise or before > min(farthest, SIGMAS * deep * steep + noise):
                    continue
                off = abs(before - planes.fog[p, 0]) / planes.fog[p, 1]
                if off >= best:
                    continue
                for a in range(3):
                    hit[a] = eye[a] + t * ray[a]
                f, low, cell = planes.frames[p], planes.lows[p], planes.cells[p]
                i = int(np.floor((f[0, 0] * hit[0] + f[0, 1] * hit[1] + f[0, 2] * hit[2] - low[0]) / cell))
                j = int(np.floor((f[1, 0] * hit[0] + f[1, 1] * hit[1] + f[1, 2] * hit[2] - low[1]) / cell))
                if not (0 <= i < planes.shapes[p, 0] and 0 <= j < planes.shapes[p, 1]):
                    continue
                if planes.solid[planes.starts[p] + i * planes.shapes[p, 1] + j]:
                    best, chosen = off, p
            if chosen < 0:
                continue
            n = planes.planes[chosen]
            slope = n[0] * ray[0] + n[1] * ray[1] + n[2] * ray[2]
            depth[row, column] = (n[3] - n[0] * eye[0] - n[1] * eye[1] - n[2] * eye[2]) / slope
            spread[row, column] = min(deep, planes.noise[chosen] / abs(slope))
            for a in range(3):
                normal[row, column, a] = -n[a] if slope > 0 else n[a]
