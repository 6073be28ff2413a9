"""The kinds of lamps: position, size and emission of each.

Positions are in the caller's frame and unit of length. Light is in units of the picture: a surface of radiance 1
shows as white, as the capture was exposed. Imports nothing heavy.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import vector
from splat2mesh.views.poses import SLACK

from ..light import MOST_RADIANCE


class _Shape:
    """Brings the fields of a lamp into form, by their names."""

    def __post_init__(self) -> None:
        for each in fields(self):  # type: ignore[arg-type]
            value = getattr(self, each.name)
            if each.name in PLACES + WAYS:
                _keep(self, each.name, vector(each.name, value))
            elif each.name == "radius":
                _keep(self, each.name, checked_size(each.name, value, least=0.0))
            elif each.name == "turn_deg":
                _keep(self, each.name, checked_size(each.name, value, least=-math.inf))
            elif each.name in ("radiance", "intensity") and value is not None:
                _keep(self, each.name, checked_light(each.name, value))
            elif each.name in ("vertical_deg", "horizontal_deg", "table"):
                _keep(self, each.name, np.asarray(value, float))
        if hasattr(self, "target") and self.position == self.target:  # type: ignore[attr-defined]
            raise InputError("`target`: it lies at the position of its lamp, so the light has no direction")


@dataclass(frozen=True)
class SphereLamp(_Shape):
    """A ball that glows evenly: a bulb, a lantern.

    position (3,): its centre. radius: 0 for a point, which has an intensity but no size.
    radiance (3,): linear RGB, the same from everywhere. A point sends out `intensity` (3,) instead: radiance x pi r^2.
    Exactly one of radiance and intensity is given.
    """

    position: Triple
    radius: float = 0.0
    radiance: Triple | None = None
    intensity: Triple | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if (self.radiance is None) == (self.intensity is None):
            raise InputError("`radiance`: a sphere has either a radiance or an intensity")
        if self.radiance is not None and self.radius == 0.0:
            raise InputError("`radius` 0: a point has no radiance; give its intensity")


@dataclass(frozen=True)
class SpotLamp(_Shape):
    """A point that sends light into a cone.

    position, target (3,): where it is, and what its axis points at. intensity (3,): radiance x length^2 on the axis.
    cutoff_deg, beam_deg: half angles; the intensity is constant to the beam, and falls linearly in the angle to 0 at
    the cutoff. radius: of the ball that shadows are softened by; 0 for hard ones.
    """

    position: Triple
    target: Triple
    intensity: Triple
    cutoff_deg: float = 30.0
    beam_deg: float | None = None  # three quarters of the cutoff without
    radius: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        cutoff = checked_size("cutoff_deg", self.cutoff_deg)
        if cutoff > 180.0:
            raise InputError(f"`cutoff_deg` {cutoff:g}: expected a half angle up to 180")
        beam = 0.75 * cutoff if self.beam_deg is None else checked_size("beam_deg", self.beam_deg, least=0.0)
        if beam > cutoff:
            raise InputError(f"`beam_deg` {beam:g}: expected at most the cutoff of {cutoff:g}")
        _keep(self, "cutoff_deg", cutoff)
        _keep(self, "beam_deg", beam)


@dataclass(frozen=True)
class RectangleLamp(_Shape):
    """A flat panel, such as a ceiling light or a screen.

    center (3,). edge_u, edge_v (3,): its whole sides, at right angles or not. radiance (3,): the same in all directions
    of the side that u x v points to; of both with two_sided.
    """

    center: Triple
    edge_u: Triple
    edge_v: Triple
    radiance: Triple
    two_sided: bool = False

    def __post_init__(self) -> None:
        super().__post_init__()
        if not np.linalg.norm(np.cross(self.edge_u, self.edge_v)) > 0.0:
            raise InputError("`edge_u`, `edge_v`: the sides span no rectangle")


@dataclass(frozen=True)
class TubeLamp(_Shape):
    """A cylinder that glows along its side, such as a fluorescent tube. Its ends are dark.

    start, end (3,): of its axis. radius. radiance (3,): the same from everywhere.
    """

    start: Triple
    end: Triple
    radius: float
    radiance: Triple

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_size("radius", self.radius)
        if self.start == self.end:
            raise InputError("`end`: the tube has no length")


@dataclass(frozen=True, eq=False)
class MeshLamp:
    """A surface that glows: a neon sign, a shade.

    vertices (N, 3) float64; faces (M, 3) int64, whose corners turn counter-clockwise seen from where they shine.
    radiance (3,) of all faces, or (M, 3). two_sided: whether the backs shine too.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    radiance: NDArray[np.float64]
    two_sided: bool = False

    def __post_init__(self) -> None:
        vertices = np.asarray(self.vertices, np.float64)
        faces = np.asarray(self.faces, np.int64)
        radiance = np.asarray(self.radiance, np.float64)
        if vertices.ndim != 2 or vertices.shape[1:] != (3,) or not np.isfinite(vertices).all():
            raise InputError("`vertices`: expected finite coordinates, (N, 3)")
        if faces.ndim != 2 or faces.shape[1:] != (3,) or not len(faces):
            raise InputError("`faces`: expected at least one triangle, (M, 3)")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise InputError("`faces`: they name vertices that do not exist")
        if radiance.shape not in ((3,), (len(faces), 3)):
            raise InputError("`radiance`: expected one colour, or one for each face")
        if not (np.isfinite(radiance).all() and (radiance >= 0).all() and radiance.max() <= MOST_RADIANCE):
            raise InputError(f"`radiance`: expected numbers from 0 to {MOST_RADIANCE:g}")
        for name, value in (("vertices", vertices), ("faces", faces), ("radiance", radiance)):
            _keep(self, name, value)


@dataclass(frozen=True, eq=False)
class ProfileLamp(_Shape):
    """A point with a measured distribution of light (IES).

    position, target (3,): where it is, and what the vertical angle 0 of its table points at. intensity (3,): radiance x
    length^2 where the table says 1. vertical_deg (A,) from 0 to at most 180, horizontal_deg (B,) from 0 to 360, both
    rising; table (A, B): relative. Angles between are interpolated; beyond the last vertical one there is no light.
    turn_deg: of the horizontal angles about the axis. radius: of the ball that shadows are softened by.
    """

    position: Triple
    target: Triple
    intensity: Triple
    vertical_deg: NDArray[np.float64]
    horizontal_deg: NDArray[np.float64]
    table: NDArray[np.float64]
    turn_deg: float = 0.0
    radius: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        vertical, horizontal, table = self.vertical_deg, self.horizontal_deg, self.table
        if not (
            vertical.ndim == horizontal.ndim == 1 and (np.diff(vertical) > 0).all() and (np.diff(horizontal) > 0).all()
        ):
            raise InputError("`vertical_deg`, `horizontal_deg`: expected lists of rising angles")
        if table.shape != (len(vertical), len(horizontal)) or not (np.isfinite(table).all() and (table >= 0).all()):
            raise InputError("`table`: expected one number from 0 for each pair of angles")


PLACES, WAYS = ("position", "target", "center", "start", "end"), ("edge_u", "edge_v")
"""Fields of lamps that are positions, and those that lead from one to another."""

Lamp: TypeAlias = SphereLamp | SpotLamp | RectangleLamp | TubeLamp | MeshLamp | ProfileLamp


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


def checked_light(name: str, value: Sequence[float] | None) -> Triple:
    """Linear RGB from 0 to MOST_RADIANCE. Raises InputError that names the field."""
    red, green, blue = vector(name, value)
    if not all(0.0 <= each <= MOST_RADIANCE for each in (red, green, blue)):
        raise InputError(f"`{name}`: expected numbers from 0 to {MOST_RADIANCE:g}, found {value}")
    return red, green, blue


def checked_size(name: str, value: float, least: float | None = None, most: float = sys.float_info.max) -> float:
    """A finite number above 0, or from `least`, up to `most`. Raises InputError that names the field."""
    try:
        size = float(value)
    except (TypeError, ValueError):
        size = math.nan
    if not (math.isfinite(size) and size <= most and (size > 0.0 if least is None else size >= least)):
        expected = (
            "a number above 0" if least is None else f"a number from {least:g}" if least > -math.inf else "a number"
        )
        raise InputError(f"`{name}` {value}: expected {expected}")
    return size


def _keep(lamp: Any, name: str, value: Any) -> None:
    object.__setattr__(lamp, name, value)
