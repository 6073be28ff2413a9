"""Light of one lamp on glossy surfaces that face it: what a reader needs to draw its highlight for any eye.

The light that arrives on a surface turned to the lamp depends on the position alone, shadows, beams and profiles
included. So one number a position is stored, and the lobe about it is drawn live.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Matrix4, Points
from splat2mesh.base.kernels import kernel
from splat2mesh.scene.color import luminance

from ..lamps.emitters import Emitters
from ..lamps.unoccluded import unoccluded
from ..splats.attachment import Surface
from ..transfer.occluder import Frame
from .lamp_lobes import brightest, sees, target_of


class Facing(NamedTuple):
    """A lamp as one source of light. place: (3,) its middle, reach: radius around it, both in the frame of the scene.
    light: (N,) irradiance in luminance, of surfaces that face each emitter, in the unit of the emitters' radiance."""

    place: NDArray[np.float64]
    reach: float
    light: NDArray[np.float32]


def facing(
    surface: Surface, nodes: Indices, emitters: Emitters, frame: Frame, scene_from_splat: Matrix4
) -> Facing | None:
    """The Facing of the emitters of one lamp at some nodes (N,) of a Surface; None for a lamp that is dark there.

    frame: that the emitters are in, of the frame of the scene.
    """
    points, normals = surface.points[nodes].astype(np.float64), surface.normals[nodes].astype(np.float64)
    unit = (points @ scene_from_splat[:3, :3].T + scene_from_splat[:3, 3] - frame.center) / frame.diagonal
    if not len(emitters.kind) or not len(points):
        return None
    chosen = brightest(emitters, unit)
    total, shares = np.zeros(len(points)), np.zeros(len(chosen))
    for row, number in enumerate(chosen):
        found = np.zeros(len(points))
        _facing(emitters, number, unit, found)
        lit = np.flatnonzero(found)
        found[lit] *= sees(target_of(emitters, number, frame, scene_from_splat), points[lit], normals[lit], surface)
        found *= float(luminance(emitters.color[number].astype(np.float64)))
        total += found
        shares[row] = found.sum()
    if not shares.any():
        return None
    shares /= shares.sum()
    middles = emitters.middle[chosen].astype(np.float64)
    place = shares @ middles
    square = shares @ (((middles - place) ** 2).sum(axis=1) + emitters.reach[chosen].astype(np.float64) ** 2)
    return Facing(_scene(place, frame), float(np.sqrt(square)) * frame.diagonal, total.astype(np.float32))


def _scene(place: Points, frame: Frame) -> NDArray[np.float64]:
    return np.asarray(frame.center + frame.diagonal * place, np.float64)


@kernel
def _facing(
    emitters: Emitters,
    e: int,
    points: NDArray[np.float64],
    found: NDArray[np.float64],
) -> None:
    """Irradiance of surfaces at points, unit frame, that face emitter e, for radiance 1."""
    for i in range(len(points)):
        px, py, pz = points[i]
        dx, dy, dz = emitters.middle[e, 0] - px, emitters.middle[e, 1] - py, emitters.middle[e, 2] - pz
        length = max((dx * dx + dy * dy + dz * dz) ** 0.5, 1e-9)
        found[i] = np.pi * unoccluded(emitters, e, px, py, pz, dx / length, dy / length, dz / length)
