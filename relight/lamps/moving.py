"""Lamps from the frame of a splat, in which they are given, to the frame of its scene."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import vector
from splat2mesh.views.poses import SLACK

from .shapes import Lamp, MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp


def moved(lamp: Lamp, matrix: ArrayLike) -> Lamp:
    """Return a lamp that is as bright as before, seen from places that move along.

    matrix: (4, 4), a turn, a scale and a shift. Intensities grow with the square of the scale, radiance does not.
    Raises InputError for a matrix that stretches one axis more than another.
    """
    motion = np.asarray(matrix, np.float64)
    lengths = np.linalg.norm(motion[:3, :3], axis=0)
    scale = float(np.cbrt(np.prod(lengths)))
    if not (scale > 0.0 and np.abs(lengths / scale - 1.0).max() < SLACK):
        raise InputError("lamps cannot follow a motion that scales the axes differently")

    def point(place: ArrayLike) -> Triple:
        return vector("place", motion[:3, :3] @ np.asarray(place, np.float64) + motion[:3, 3])

    def way(direction: ArrayLike) -> Triple:
        return vector("direction", motion[:3, :3] @ np.asarray(direction, np.float64))

    def light(intensity: Triple) -> Triple:
        return vector("intensity", np.asarray(intensity) * scale**2)

    if isinstance(lamp, SphereLamp):
        intensity = None if lamp.intensity is None else light(lamp.intensity)
        return replace(lamp, position=point(lamp.position), radius=lamp.radius * scale, intensity=intensity)
    if isinstance(lamp, (SpotLamp, ProfileLamp)):
        places: dict[str, Any] = {"position": point(lamp.position), "target": point(lamp.target)}
        return replace(lamp, **places, intensity=light(lamp.intensity), radius=lamp.radius * scale)
    if isinstance(lamp, RectangleLamp):
        return replace(lamp, center=point(lamp.center), edge_u=way(lamp.edge_u), edge_v=way(lamp.edge_v))
    if isinstance(lamp, TubeLamp):
        return replace(lamp, start=point(lamp.start), end=point(lamp.end), radius=lamp.radius * scale)
    assert isinstance(lamp, MeshLamp)
    vertices: NDArray[np.float64] = lamp.vertices @ motion[:3, :3].T + motion[:3, 3]
    flipped = math.copysign(1.0, float(np.linalg.det(motion[:3, :3]))) < 0.0
    return replace(lamp, vertices=vertices, faces=lamp.faces[:, ::-1] if flipped else lamp.faces)


def shifted(lamp: Lamp, by: Triple) -> Lamp:
    """Return a lamp moved by a vector, in its own unit of length. Raises InputError for one that is not finite."""
    motion = np.eye(4)
    motion[:3, 3] = vector("at", by)
    return moved(lamp, motion)
