"""Highlights of placed lamps: the lobe towards each emitter, widened by the emitter's apparent size, behind a shadow
ray.

Source: Karis, "Real shading in Unreal Engine 4" (SIGGRAPH 2013): an extended lamp is a point under a lobe that is
rougher by half the angle it subtends.
"""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Matrix4, Points
from splat2mesh.base.kernels import kernel
from splat2mesh.scene.color import luminance

from ..lamps.emitters import Emitters
from ..lamps.unoccluded import unoccluded
from ..splats.attachment import Surface
from ..transfer.occluder import Frame
from .mirrored import MirroredPixels
from .pixels import LIFT

MOST_EMITTERS = 32
"""Whose highlights are drawn at a view: the brightest there; the others light surfaces and shine in none."""


def lamp_lobes(
    view: MirroredPixels, surface: Surface, emitters: Emitters, frame: Frame, scene_from_splat: Matrix4
) -> NDArray[np.float64]:
    """(Q, 3) radiance of the highlights that emitters make on the pixels of a view, unit of the emitters' radiance.

    frame: that the emitters are in, of the frame of the scene.
    """
    pixels = view.pixels
    points = pixels.points @ scene_from_splat[:3, :3].T + scene_from_splat[:3, 3]
    points = (points - frame.center) / frame.diagonal
    normals, toward = pixels.normals @ view.scene.T, pixels.toward @ view.scene.T
    total = np.zeros((len(points), 3))
    if not len(points):
        return total
    for number in brightest(emitters, points):
        found = np.zeros(len(points))
        _lobe(emitters, number, points, normals, toward, view.alpha.astype(np.float64), found)
        lit = np.flatnonzero(found)
        if not len(lit):
            continue
        target = target_of(emitters, number, frame, scene_from_splat)
        seen = sees(target, pixels.points[lit], pixels.normals[lit], surface)
        total[lit] += (found[lit] * seen)[:, None] * emitters.color[number].astype(np.float64)
    return total * view.strength


def brightest(emitters: Emitters, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """The numbers of the emitters that may shine most at the middle of some points."""
    away = emitters.middle.astype(np.float64) - np.median(points, axis=0)
    square = np.maximum((away**2).sum(axis=1), emitters.reach.astype(np.float64) ** 2)
    power = np.maximum(emitters.power, luminance(emitters.color) * emitters.reach**2) / np.maximum(square, 1e-12)
    return np.argsort(-power, kind="stable")[:MOST_EMITTERS]


def target_of(
    emitters: Emitters, number: int, frame: Frame, scene_from_splat: Matrix4
) -> tuple[NDArray[np.float64], float]:
    """The middle (3,) of an emitter and its reach, in the frame of the splat. frame: that the emitters are in, of the
    frame of the scene."""
    middle = frame.center + frame.diagonal * emitters.middle[number].astype(np.float64)
    aim = (np.append(middle, 1.0) @ np.linalg.inv(scene_from_splat).T)[:3]
    return aim, float(emitters.reach[number]) * frame.diagonal / float(np.cbrt(np.linalg.det(scene_from_splat[:3, :3])))


def sees(
    target: tuple[NDArray[np.float64], float], points: Points, normals: Directions, surface: Surface
) -> NDArray[np.bool_]:
    """(Q,) bool: whether nothing hides an emitter, as of `target_of`, or what stands within its reach of it, from
    points (Q, 3) with normals (Q, 3), frame of the splat."""
    aim, reach = target
    start = points + LIFT * surface.diagonal * normals
    way = aim - start
    length = np.linalg.norm(way, axis=1, keepdims=True)
    way *= np.maximum(1.0 - (reach + LIFT * surface.diagonal) / np.maximum(length, 1e-30), 0.0)
    return ~surface.caster.occluded(np.concatenate([start, way], axis=1), far=1.0)


@kernel
def _lobe(
    emitters: Emitters,
    e: int,
    points: NDArray[np.float64],
    normals: NDArray[np.float64],
    toward: NDArray[np.float64],
    alpha: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """The light of emitter e that each point sends to the eye, for reflectance 1 and radiance 1."""
    for i in range(len(points)):
        px, py, pz = points[i]
        nx, ny, nz = normals[i]
        dx, dy, dz = emitters.middle[e, 0] - px, emitters.middle[e, 1] - py, emitters.middle[e, 2] - pz
        length = max(math.sqrt(dx * dx + dy * dy + dz * dz), 1e-9)
        dx, dy, dz = dx / length, dy / length, dz / length
        lit = dx * nx + dy * ny + dz * nz
        seen = toward[i, 0] * nx + toward[i, 1] * ny + toward[i, 2] * nz
        if lit <= 0.0 or seen <= 0.0:
            continue
        hx, hy, hz = dx + toward[i, 0], dy + toward[i, 1], dz + toward[i, 2]
        half = max(math.sqrt(hx * hx + hy * hy + hz * hz), 1e-9)
        cosine = (hx * nx + hy * ny + hz * nz) / half
        wide = min(alpha[i] + emitters.reach[e] / (2.0 * max(length, emitters.reach[e])), 1.0)
        square = wide * wide
        spread = cosine * cosine * (square - 1.0) + 1.0
        density = square / (math.pi * spread * spread)
        arriving = 2.0 * lit / (lit + math.sqrt(square + (1.0 - square) * lit * lit))
        leaving = 2.0 * seen / (seen + math.sqrt(square + (1.0 - square) * seen * seen))
        facing = math.pi * unoccluded(emitters, e, px, py, pz, dx, dy, dz)
        found[i] = density * arriving * leaving / (4.0 * seen) * facing
