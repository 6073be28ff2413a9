"""Loops over the rows of the bounce matrix: unpacked from the places that rays met, and multiplied by radiance."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers
from splat2mesh.base.kernels import kernel

FINENESS = 64
"""Parts of a face's edge to which the place of a hit is rounded: next to the noise of a few dozen rays that is nothing,
and a hit in a mesh of up to a million faces takes four bytes."""

SIDE = FINENESS + 1


@kernel
def unpack(
    begin: int,
    end: int,
    places: NDArray[np.unsignedinteger],
    faces: Integers,
    corners: NDArray[np.uint32],
    parts: NDArray[np.uint8],
) -> None:
    """The corners (P, 3) of the faces of hits (P,), and the weights (P, 2) of the second and the third corner.

    A place is (face * SIDE + second) * SIDE + third, with weights in whole parts of 1 / FINENESS.
    """
    for i in range(begin, end):
        place = np.uint64(places[i])
        face = place // np.uint64(SIDE * SIDE)
        rest = place - face * np.uint64(SIDE * SIDE)
        second = rest // np.uint64(SIDE)
        corners[i, 0], corners[i, 1], corners[i, 2] = faces[face, 0], faces[face, 1], faces[face, 2]
        parts[i, 0], parts[i, 1] = second, rest - second * np.uint64(SIDE)


@kernel
def gather(
    rows: NDArray[np.int32],
    starts: NDArray[np.int64],
    corners: NDArray[np.uint32],
    parts: NDArray[np.uint8],
    scale: NDArray[np.float32],
    radiance: NDArray[np.float32],
    result: NDArray[np.float32],
) -> None:
    """Products of the rows with radiance (V, C) into the result (V, C), times the scale of each, (V,).

    The order of the rays, and so that of the sums, is the vertex's own: renaming vertices changes no bit. Nor does it
    matter which of several vertices that are equally bright a face has.
    """
    width = radiance.shape[1]
    total = np.zeros(width)
    for v in range(len(rows)):
        total[:] = 0.0
        for i in range(starts[v], starts[v + 1]):
            a, b, c = corners[i, 0], corners[i, 1], corners[i, 2]
            second, third = np.float64(parts[i, 0]), np.float64(parts[i, 1])
            first = FINENESS - second - third
            for k in range(width):
                total[k] += first * radiance[a, k] + second * radiance[b, k] + third * radiance[c, k]
        row = rows[v]
        factor = scale[row] / FINENESS
        for k in range(width):
            result[row, k] = factor * total[k]
