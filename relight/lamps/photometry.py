"""The light that a lamp emits: on its main axis, and in total.

Both in units of the picture, linear RGB: the intensity is radiance x length^2, the flux that x steradian. Light that a
lamp hides from itself is not subtracted, which matters for meshes only.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.base.threads import ROWS_AT_ONCE
from splat2mesh.scene.color import luminance

from .shapes import Lamp, MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp


def axis_intensity(lamp: Lamp) -> NDArray[np.float64]:
    """The intensity on the main axis (3,): where a lamp is brightest from afar.

    That is the axis of a spot, what a rectangle faces, across a tube, and for meshes and profiles the brightest
    direction. A sphere has the same to every side.
    """
    match lamp:
        case SphereLamp(intensity=None):
            return np.pi * lamp.radius**2 * np.asarray(lamp.radiance)
        case SphereLamp() | SpotLamp():
            return np.array(lamp.intensity)
        case ProfileLamp():
            return np.asarray(lamp.intensity) * lamp.table.max(initial=0.0)
        case RectangleLamp():
            return _area(lamp) * np.asarray(lamp.radiance)
        case TubeLamp():
            return 2.0 * lamp.radius * _length(lamp) * np.asarray(lamp.radiance)
        case MeshLamp():
            return _brightest(lamp)


def flux(lamp: Lamp) -> NDArray[np.float64]:
    """All the light that a lamp sends out, (3,): pi x radiance x area, or its intensity over the sphere."""
    match lamp:
        case SphereLamp():
            return 4.0 * np.pi * axis_intensity(lamp)
        case SpotLamp():
            cone = np.array([0.0, lamp.beam_deg or 0.0, lamp.cutoff_deg])
            return np.asarray(lamp.intensity) * _over_sphere(cone, np.array([1.0, 1.0, 0.0]))
        case ProfileLamp():
            return np.asarray(lamp.intensity) * _over_sphere(lamp.vertical_deg, _around(lamp))
        case RectangleLamp():
            return np.pi * _area(lamp) * np.asarray(lamp.radiance) * (1 + lamp.two_sided)
        case TubeLamp():
            return np.pi * 2.0 * np.pi * lamp.radius * _length(lamp) * np.asarray(lamp.radiance)
        case MeshLamp():
            areas = np.linalg.norm(area_normals(lamp), axis=1)
            return np.pi * (1 + lamp.two_sided) * (areas[:, None] * lamp.radiance).sum(axis=0)


def times(lamp: Lamp, factor: float | NDArray[np.float64]) -> Lamp:
    """A lamp with `factor` times its light, a number or linear RGB. Raises InputError for too much of it."""
    light = "intensity" if getattr(lamp, "radiance", None) is None else "radiance"
    with np.errstate(over="ignore", invalid="ignore"):  # the lamp refuses what comes of it
        value = np.asarray(getattr(lamp, light)) * factor
    changed: Any = {light: value if isinstance(lamp, MeshLamp) else tuple(value.tolist())}
    return replace(lamp, **changed)


def _over_sphere(angle_deg: NDArray, values: NDArray) -> float:
    """The integral over directions of what depends on the angle to an axis alone, linearly between samples (A,)."""
    angle = np.radians(angle_deg)
    low, high, begin, end = angle[:-1], angle[1:], values[:-1], values[1:]
    width = high - low
    slope = np.divide(end - begin, width, out=np.zeros_like(width), where=width > 0.0)
    # The integral of (begin + slope (t - low)) sin t, in parts.
    part = begin * np.cos(low) - (begin + slope * width) * np.cos(high) + slope * (np.sin(high) - np.sin(low))
    return float(2.0 * np.pi * part[width > 0.0].sum())


def _around(lamp: ProfileLamp) -> NDArray[np.float64]:
    """The table's mean over the horizontal angles, linear between them: (A,)."""
    steps = np.diff(lamp.horizontal_deg)
    if not len(steps):
        return lamp.table.mean(axis=1)
    return 0.5 * (lamp.table[:, 1:] + lamp.table[:, :-1]) @ (steps / steps.sum())


def _brightest(lamp: MeshLamp) -> NDArray[np.float64]:
    """The intensity in the sampled direction with the highest luminance."""
    normals, radiance = area_normals(lamp), np.broadcast_to(lamp.radiance, (len(lamp.faces), 3))
    mean = luminance(radiance) @ normals
    length = float(np.linalg.norm(mean))
    # A flat mesh has its brightest direction exactly there.
    tried = np.concatenate([mean[None] / length if length > 0.0 else mean[None], fibonacci_sphere()])
    found = np.zeros((len(tried), 3))
    for start in range(0, len(normals), ROWS_AT_ONCE):
        facing = tried @ normals[start : start + ROWS_AT_ONCE].T
        facing = np.abs(facing) if lamp.two_sided else np.maximum(facing, 0.0)
        found += facing @ radiance[start : start + ROWS_AT_ONCE]
    return found[np.argmax(luminance(found))]


def area_normals(lamp: MeshLamp) -> NDArray[np.float64]:
    """Normals of the faces (M, 3), as long as their areas."""
    corners = lamp.vertices[lamp.faces]
    return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


def _area(lamp: RectangleLamp) -> float:
    return float(np.linalg.norm(np.cross(lamp.edge_u, lamp.edge_v)))


def _length(lamp: TubeLamp) -> float:
    return float(np.linalg.norm(np.subtract(lamp.end, lamp.start)))
