"""An unchecked triangle mesh of a file: the result of every reader of mesh files, and their common parts.

Corners that files list one by one are joined if all their data are equal, in the order of first use; results list the
vertices in that order.
"""

import os
import warnings
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError


class UncheckedMesh(NamedTuple):
    """A triangle mesh as a file has it: `meshfile.checked_mesh` makes a Mesh of it.

    points: (V, 3) float64. faces: (F, 3) int64, rows of points. normals: (V, 3), or None, rows that are 0 or not finite
    are missing. colors: (V, 3), or None, sRGB in [0, 1]. moved: (3,) float64, or None, by what the points were moved to
    the origin, where the reader did so.
    """

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray | None = None
    colors: NDArray | None = None
    moved: NDArray[np.float64] | None = None


FAR = 1e-4
"""Spacing of float32 at a mesh, over its extent, from which it is moved to the origin: a thousandth of an edge."""


def centred(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Move a mesh to the origin if it is so far away that float32 would lose it. points: (N, 3) float64. Returns
    points: (N, 3) float64; moved: (3,) float64, or None, what was taken off; None where nothing was."""
    finite = points[np.isfinite(points).all(axis=1)]
    if not len(finite):
        return points, None
    low, high = finite.min(axis=0), finite.max(axis=0)
    largest, extent = np.abs([low, high]).max(), (high - low).max()
    if not 0.0 < extent < np.finfo(np.float32).eps / FAR * largest:
        return points, None
    middle = (low + high) / 2.0
    return points - middle, middle


def too_far(moved: NDArray[np.float64]) -> str:
    """Return what a warning says of a mesh that `centred` moved. moved: (3,) float64, what was taken off."""
    shift = ", ".join(f"{-part:.10g}" for part in moved)
    return f"too far from the origin for float32, moved by ({shift}); lamps and objects keep to its own coordinates"


def frame_from_own(moved: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the matrix that leads from the coordinates of a mesh to those that `centred` gave it. moved: (3,) float64,
    or None, what was taken off; None for nothing. Returns (4, 4) float64."""
    matrix = np.eye(4)
    matrix[:3, 3] = 0.0 if moved is None else -moved
    return matrix


def fans(corners: NDArray, counts: NDArray, path: str | os.PathLike[str]) -> NDArray[np.int64]:
    """Cut polygons into triangle fans.

    corners: (C,) integers, those of all polygons in a row. counts: (P,) integers, the corners of each. path: of the
    file, for the warning. Returns (F, 3) int64. Warns with a DataWarning with the number of those that have fewer than
    three corners, which are left out.
    """
    flat = int(np.count_nonzero(counts < 3))
    if flat:
        message = f"{path}: left out {flat} of {len(counts)} faces, which have fewer than three corners"
        warnings.warn(message, DataWarning, stacklevel=4)
    if (counts == 3).all():
        return corners.reshape(-1, 3).astype(np.int64)
    triangles = np.maximum(counts - 2, 0)
    first = np.repeat(np.cumsum(counts) - counts, triangles)
    within = np.arange(triangles.sum()) - np.repeat(np.cumsum(triangles) - triangles, triangles)
    return np.stack([corners[first], corners[first + within + 1], corners[first + within + 2]], axis=1).astype(np.int64)


def check_corners(faces: NDArray, count: int, path: str | os.PathLike[str]) -> None:
    """Check that faces name vertices that are there, before anything follows the name. faces: (F, 3) integers. count:
    of the vertices. path: of the file, for the message. Raises InputError where one does not."""
    if len(faces) and (faces.min() < 0 or faces.max() >= count):
        raise InputError(f"{path}: a face names a vertex beyond the {count} there are; export it again")


def joined(
    corners: NDArray,  # (C,) integers into the rows of each of `values`
    *values: NDArray | None,  # (N, k) what rows hold: places, normals, texture coordinates, colours; None is left out
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Join corners that hold the same, in the order of first use.

    corners: (C,) integers, rows of each of `values`. *values: (N, k), or None, what rows hold: places, normals, texture
    coordinates, colours; None is left out. Values count as equal as float32, -0 as 0. Returns rows: (V,) int64, of each
    vertex; vertices: (C,) int64, of each corner.
    """
    used, corner = np.unique(corners, return_inverse=True)
    held = np.concatenate([np.asarray(value)[used] for value in values if value is not None], axis=1)
    with np.errstate(over="ignore", invalid="ignore"):
        held = np.ascontiguousarray(held.astype(np.float32) + np.float32(0.0))
    _, alike = np.unique(held.view(f"V{held.itemsize * held.shape[1]}"), return_inverse=True)
    corner = corner.reshape(-1)
    group = alike.reshape(-1)[corner]
    _, first = np.unique(group, return_index=True)
    rank = np.zeros(len(first), np.int64)
    order = np.argsort(first, kind="stable")
    rank[order] = np.arange(len(first))
    return used[corner[first[order]]], rank[group]
