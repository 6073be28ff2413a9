"""Transfer predicted from position and normal alone: the network of the Neural-GASh paper.

Each vertex becomes a motor, 32 numbers, from which a multilayer perceptron predicts the transfer of three bands. It
knows the vertex but not its surroundings, so shadows are a guess from the average of its training data. Its error is
three quarters of that without shadows, four times that of 25 rays (`relight/models/neural-gash.md`). Source:
Geronikolakis et al., "Neural-GASh", arXiv:2507.13917, 2025.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.progress import Advance
from splat2mesh.base.threads import in_order

from ..sh import cga
from ..sh.normals import unit_normals
from . import FEW_BANDS
from .checks import check_shape, check_vertices
from .sessions import open_session, workers_of

MODEL = "neural-gash"

BANDS = FEW_BANDS

COLORS = 3

BATCH = 1024
"""Vertices per run: activations stay in the caches, where 16,384 take 1.3 times as long, and memory stays flat."""


def neural_gash(
    vertices: ArrayLike,  # (V, 3), scene frame; all of the scene, which sets the unit frame
    normals: ArrayLike,  # (V, 3), scene frame, any length
    advance: Advance = lambda count: None,  # called with the number of vertices done
    frame: "UnitFrame | None" = None,  # the unit frame, where the vertices are not all of the scene
) -> NDArray[np.float32]:
    """Transfer of white vertices as the network guesses it: (V, 9) float32, in the basis of `relight.sh.harmonics`.

    The network gives three colours, equal up to rounding, as its labels were; this is their mean, with the visible
    fraction of the sky cut to 0 and 1. Depends on the vertex and the bounds of the scene, and to 1e-6 on no order or
    batch.
    Normals are used as `unit_normals` returns them. Raises InputError for shapes that do not fit, vertices that are not
    finite, and without onnxruntime.
    """
    points = (frame or UnitFrame.of(vertices)).points(vertices)
    normals = np.asarray(normals)
    check_shape("the normals", normals, points.shape)
    normals = unit_normals(normals)
    session = open_session(MODEL, 1)
    transfer = np.zeros((len(points), BANDS**2), np.float32)

    def predict(start: int) -> int:
        part = slice(start, start + BATCH)
        motors = cga.vertex_motors(points[part], normals[part])
        (rows,) = session.run(None, {"motor": motors})
        transfer[part] = sum(rows[:, color::COLORS] for color in range(COLORS)) / np.float32(COLORS)
        return len(rows)

    for count in in_order(predict, range(0, len(points), BATCH), workers=workers_of(session)):
        advance(count)
    np.clip(transfer[:, 0], 0.0, math.sqrt(0.25 / math.pi), out=transfer[:, 0])
    return transfer


class UnitFrame(NamedTuple):
    """The network's frame. middle: (3,) of a bounding box, which goes to 0. half: of its diagonal, which becomes 1; 1
    where all points are one."""

    middle: NDArray[np.float64]
    half: float

    @classmethod
    def of(cls, vertices: ArrayLike) -> "UnitFrame":
        """That of the vertices (V, 3) of a scene. Raises InputError for another shape and for what is not finite."""
        vertices = np.asarray(vertices)
        check_vertices(vertices)
        if len(vertices) == 0:
            return cls(np.zeros(3), 1.0)
        low, high = vertices.min(axis=0).astype(np.float64), vertices.max(axis=0).astype(np.float64)
        half = float(np.linalg.norm(high / 2.0 - low / 2.0))  # halves: their difference fits wherever the corners do
        return cls(low / 2.0 + high / 2.0, half or 1.0)

    def points(self, vertices: ArrayLike) -> NDArray[np.float64]:
        """(V, 3) float64 in this frame. Raises InputError as `of` does."""
        vertices = np.asarray(vertices)
        check_vertices(vertices)
        return np.asarray((vertices - self.middle) / self.half).reshape(-1, 3)


def unit_points(vertices: ArrayLike) -> NDArray[np.float64]:
    """Points (V, 3) float64 in their own UnitFrame, so size and place of a scene change nothing.

    Raises InputError for another shape and for vertices that are not finite.
    """
    return UnitFrame.of(vertices).points(vertices)
