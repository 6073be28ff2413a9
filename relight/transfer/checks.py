"""Checks of arrays from callers: their shapes and values, checked once and refused in one line."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.errors import InputError


def check_shape(name: str, array: ArrayLike, expected: Sequence[int]) -> None:
    """Raise InputError unless an array has a shape. name: of the array, as the message names it."""
    if np.shape(array) != tuple(expected):
        raise InputError(f"{name} must have shape {tuple(expected)}, found {np.shape(array)}")


def checked_albedo(albedo: ArrayLike, count: int, name: str = "the albedo") -> NDArray[np.float32]:
    """The albedo of `count` vertices as (V, 3) float32. Raises InputError unless it fits and is in [0, 1]."""
    check_shape(name, albedo, (count, 3))
    array = np.asarray(albedo)
    if array.dtype.kind not in "fiub":
        raise InputError(f"{name} must hold numbers, found {array.dtype}")
    values = array.astype(np.float32, copy=False)
    if not ((values >= 0.0) & (values <= 1.0)).all():
        raise InputError(f"{name} must be in [0, 1], found {values.min()} to {values.max()}")
    return values


def check_mesh(vertices: NDArray, normals: ArrayLike) -> None:
    """Raise InputError unless arrays are vertices (V, 3), all finite, and as many normals."""
    check_vertices(vertices)
    check_shape("the normals", normals, vertices.shape)


def check_vertices(vertices: NDArray) -> None:
    """Raise InputError unless an array is (V, 3) and all of it finite."""
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise InputError(f"expected vertices of shape (V, 3), found {vertices.shape}")
    bad = int((~np.isfinite(vertices)).any(axis=1).sum())
    if bad:
        raise InputError(f"{bad} of {len(vertices)} vertices are not finite; repair the mesh first")


def check_faces(faces: NDArray, count: int) -> None:
    """Raise InputError unless an array is (F, 3), F above 0, of numbers of `count` vertices."""
    if faces.ndim != 2 or faces.shape[1:] != (3,) or len(faces) == 0:
        raise InputError(f"expected faces of shape (F, 3) with F > 0, found {faces.shape}: light needs a surface")
    if faces.min() < 0 or faces.max() >= count:
        raise InputError(f"faces name vertices {faces.min()} to {faces.max()}, the mesh has {count}")
