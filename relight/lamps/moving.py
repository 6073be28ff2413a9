"""Lamps from the frame of a splat, in which they are given, to the frame of its scene."""

import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import vector
from splat2mesh.views.poses import SLACK

from .shapes import PLACES, WAYS, Lamp, MeshLamp


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

    changes: dict[str, Any] = {}
    for name, value in ((each.name, getattr(lamp, each.name)) for each in fields(lamp)):
        if name in PLACES + WAYS:
            changes[name] = motion[:3, :3] @ np.asarray(value) + (motion[:3, 3] if name in PLACES else 0.0)
        elif name == "radius":
            changes[name] = scale * value
        elif name == "intensity" and value is not None:
            changes[name] = scale**2 * np.asarray(value)
    if isinstance(lamp, MeshLamp):
        changes["vertices"] = lamp.vertices @ motion[:3, :3].T + motion[:3, 3]
        if math.copysign(1.0, float(np.linalg.det(motion[:3, :3]))) < 0.0:
            changes["faces"] = lamp.faces[:, ::-1]
    return replace(lamp, **changes)


def shifted(lamp: Lamp, by: Triple) -> Lamp:
    """Return a lamp moved by a vector, in its own unit of length. Raises InputError for one that is not finite."""
    motion = np.eye(4)
    motion[:3, 3] = vector("at", by)
    return moved(lamp, motion)
