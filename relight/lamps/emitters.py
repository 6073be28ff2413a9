"""Lamps as the kernels see them: balls, triangles and tubes in arrays, in the unit frame of an occluder.

A sphere, a spot and a measured profile are balls; a rectangle is two triangles, a mesh as many as it has. So one list
holds all lamps, and a sign of ten thousand faces is handled like a street of ten thousand bulbs.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.scene.color import luminance

from ..transfer.occluder import MAX_OFFSET
from .shapes import Lamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp

BALL, TRIANGLE, TUBE = 0, 1, 2

NO_PROFILE = -1

PROFILE_STEP_DEG = 2.0
"""Step of the tables of resampled profiles: most are measured every 2.5 degrees."""


class Emitters(NamedTuple):
    """N emitters, unit frame; float32 but where said.

    kind: (N,) int8. place: (N, 3), the centre of a ball, a corner of a triangle, an end of a tube. first, second:
    (N, 3): of a ball the axis of its light and the direction of horizontal angle 0; of a triangle two edges from its
    corner, whose product points to where it shines; of a tube the way to its other end, and zeros. radius: (N,).
    color: (N, 3) radiance, unit of the picture; of a ball that along its axis. cone: (N, 2), angles in radians to which
    a ball is as bright as along its axis, and from which it is dark. profile: (N,) int32, row of `profiles` or
    NO_PROFILE. two_sided: (N,) bool. lamp: (N,) int32, the lamp that each is of.
    middle: (N, 3), reach: (N,): a sphere around each. power: (N,), at most what a white vertex sends on in luminance,
    times the squared distance from that sphere; peak: (N,), at most what it sends on at all.
    profiles: (P, A, B): relative intensity by vertical angle 0..180 and horizontal angle 0..360 degrees.
    """

    kind: NDArray[np.int8]
    place: NDArray[np.float32]
    first: NDArray[np.float32]
    second: NDArray[np.float32]
    radius: NDArray[np.float32]
    color: NDArray[np.float32]
    cone: NDArray[np.float32]
    profile: NDArray[np.int32]
    two_sided: NDArray[np.bool_]
    lamp: NDArray[np.int32]
    middle: NDArray[np.float32]
    reach: NDArray[np.float32]
    power: NDArray[np.float32]
    peak: NDArray[np.float32]
    profiles: NDArray[np.float32]

    def of_lamp(self, *lamps: int) -> "Emitters":
        """The Emitters of one lamp, or of several."""
        chosen = np.isin(self.lamp, lamps)
        kept = {name: array[chosen] for name, array in self._asdict().items() if name != "profiles"}
        return Emitters(**kept, profiles=self.profiles)


def emitters_of(
    lamps: Sequence[Lamp],  # in the frame and the unit of length of the scene
    center: ArrayLike = (0.0, 0.0, 0.0),  # of the unit frame, `transfer.occluder.Frame`
    diagonal: float = 1.0,  # of the same
) -> Emitters:
    """Return the Emitters of lamps."""
    rows: list[dict[str, Any]] = []
    tables: list[NDArray[np.float64]] = []
    for number, lamp in enumerate(lamps):
        table = NO_PROFILE
        if isinstance(lamp, ProfileLamp):
            table = len(tables)
            tables.append(_resampled(lamp))
        rows += [_USUAL | row | {"lamp": number, "profile": table} for row in _rows(lamp, np.asarray(center), diagonal)]
    return _packed(rows, tables)


_USUAL = {
    "first": (0.0, 0.0, 0.0),
    "second": (0.0, 0.0, 0.0),
    "radius": 0.0,
    "cone": (math.pi, math.pi),
    "two_sided": False,
}


def _rows(lamp: Lamp, center: NDArray[np.float64], diagonal: float) -> list[dict[str, Any]]:
    """Columns of the Emitters of a lamp, but for those of _USUAL."""

    def placed(point: ArrayLike) -> NDArray[np.float64]:
        return (np.asarray(point, np.float64) - center) / diagonal

    if isinstance(lamp, (SphereLamp, SpotLamp, ProfileLamp)):
        radius = max(lamp.radius / diagonal, MAX_OFFSET)
        given: ArrayLike | None = lamp.radiance if isinstance(lamp, SphereLamp) else None
        if given is None:  # one ball of that intensity, whatever its radius
            given = np.asarray(lamp.intensity, np.float64) / (math.pi * (radius * diagonal) ** 2)
        row = {"kind": BALL, "place": placed(lamp.position), "radius": radius, "color": given}
        if isinstance(lamp, SphereLamp):
            return [row]
        axis = np.subtract(lamp.target, lamp.position)
        axis = axis / np.linalg.norm(axis)
        if isinstance(lamp, ProfileLamp):
            return [{**row, "first": axis, "second": _horizontal(axis, lamp.turn_deg)}]
        return [{**row, "first": axis, "cone": np.radians([lamp.beam_deg or 0.0, lamp.cutoff_deg])}]
    if isinstance(lamp, TubeLamp):
        along = np.subtract(lamp.end, lamp.start) / diagonal
        tube = {"kind": TUBE, "place": placed(lamp.start), "first": along, "radius": lamp.radius / diagonal}
        return [{**tube, "color": lamp.radiance}]
    if isinstance(lamp, RectangleLamp):
        u, v = np.asarray(lamp.edge_u), np.asarray(lamp.edge_v)
        corner = np.asarray(lamp.center) - (u + v) / 2.0
        points, corners = np.stack([corner, corner + u, corner + u + v, corner + v]), np.array([[0, 1, 3], [2, 3, 1]])
    else:
        points, corners = lamp.vertices, lamp.faces
    a, b, c = np.moveaxis(placed(points)[corners], 1, 0)
    colors = np.broadcast_to(lamp.radiance, (len(a), 3))
    shines = (np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0.0) & (colors.max(axis=1) > 0.0)
    names, two_sided = ("place", "first", "second", "color"), lamp.two_sided
    rows = zip(a[shines], (b - a)[shines], (c - a)[shines], colors[shines], strict=True)
    return [{"kind": TRIANGLE, "two_sided": two_sided, **dict(zip(names, row, strict=True))} for row in rows]


def _horizontal(axis: NDArray[np.float64], turn_deg: float) -> NDArray[np.float64]:
    """The direction of horizontal angle 0 of a lamp along `axis`: +x as far as it is across, else +z; then turned."""
    toward = np.array([1.0, 0.0, 0.0]) if abs(axis[0]) < 0.9 else np.array([0.0, 0.0, 1.0])
    across = toward - (toward @ axis) * axis
    across /= np.linalg.norm(across)
    turn = math.radians(turn_deg)
    return math.cos(turn) * across + math.sin(turn) * np.cross(axis, across)


def _resampled(lamp: ProfileLamp) -> NDArray[np.float64]:
    """The table of a profile at even angles: (A, B) over 0..180 and 0..360 degrees, ends included."""
    vertical = np.linspace(0.0, 180.0, int(180.0 / PROFILE_STEP_DEG) + 1)
    horizontal = np.linspace(0.0, 360.0, int(360.0 / PROFILE_STEP_DEG) + 1)
    known = lamp.horizontal_deg
    table = np.stack([np.interp(vertical, lamp.vertical_deg, row, right=0.0) for row in lamp.table.T], axis=1)
    if len(known) == 1:
        return np.repeat(table, len(horizontal), axis=1)
    return np.stack([np.interp(horizontal, known, row, period=360.0) for row in table])


def _packed(rows: list[dict[str, Any]], tables: list[NDArray[np.float64]]) -> Emitters:
    widths = {"place": (3,), "first": (3,), "second": (3,), "color": (3,), "cone": (2,)}
    names = (*_USUAL, "kind", "place", "color", "lamp", "profile")
    column = {
        name: np.array([row[name] for row in rows], np.float64).reshape(-1, *widths.get(name, ())) for name in names
    }
    kind, place, first, second, radius = (column[each] for each in ("kind", "place", "first", "second", "radius"))
    middle, reach, flux = place.copy(), radius.copy(), math.pi * radius**2
    triangle, tube = kind == TRIANGLE, kind == TUBE
    middle[triangle] += (first[triangle] + second[triangle]) / 3.0
    ends = np.stack([place, place + first, place + second])
    far = np.linalg.norm(ends - middle, axis=2).max(axis=0)
    reach[triangle] = far[triangle]
    flux[triangle] = np.linalg.norm(np.cross(first, second), axis=1)[triangle] / 2.0
    length = np.linalg.norm(first, axis=1)
    middle[tube] += first[tube] / 2.0
    reach[tube] += length[tube] / 2.0
    flux[tube] = 2.0 * radius[tube] * length[tube]
    brightest = np.ones(len(rows))
    for number, table in enumerate(tables):
        brightest[column["profile"] == number] = table.max()
    peak = luminance(column["color"]) * brightest
    column |= {"middle": middle, "reach": reach, "power": peak * flux / math.pi, "peak": peak}
    types = {"kind": np.int8, "lamp": np.int32, "profile": np.int32, "two_sided": np.bool_}
    packed: dict[str, Any] = {name: each.astype(types.get(name, np.float32)) for name, each in column.items()}
    profiles = np.stack(tables) if tables else np.zeros((0, 1, 1))
    return Emitters(**packed, profiles=profiles.astype(np.float32))
