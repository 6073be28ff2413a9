"""A camera from a file, checked and converted to a View."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import InputError
from ..render.view import View

Camera: TypeAlias = View | str
"""A camera of a file: a View, or why it gives none, as the end of "cameras that ..."."""

LOST, PANORAMA = "have no finite numbers", "are panoramas"

SLACK = 0.01
"""Tolerance of a rotation's columns from orthonormal, for files with few digits."""


def view_of(
    where: str,
    size: Sequence[float],
    focal: Sequence[float],
    principal: Sequence[float] | None,
    world_from_camera: ArrayLike,
) -> Camera:
    """A View of numbers from a file, or LOST where they are not finite, as those of poses that were not found are.

    where: what a message begins with. size: width and height, pixels. focal, principal: pairs in pixels; a principal
    point of None is the middle. world_from_camera: (4, 4), camera x right, y down, z forward.
    Raises InputError for a size or focal length that is none, and for a rotation that is none.
    """
    try:
        if not np.isfinite([*map(float, size), *map(float, focal), *map(float, principal or ())]).all():
            return LOST
        (width, height), (fx, fy) = (int(side) for side in size), (float(length) for length in focal)
        cx, cy = (width / 2, height / 2) if principal is None else (float(place) for place in principal)
        pose = np.array(world_from_camera, np.float64).reshape(4, 4)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{where} holds no numbers ({error})") from error
    if min(width, height, fx, fy) <= 0:
        raise InputError(f"{where} has no usable picture: {width} x {height} pixels, focal lengths {fx:g} and {fy:g}")
    if not np.isfinite(pose).all():
        return LOST
    left, stretch, right = np.linalg.svd(pose[:3, :3])
    if np.abs(stretch - 1).max() > SLACK or np.linalg.det(pose[:3, :3]) < 0:
        raise InputError(
            f"{where}: its rotation is invalid: the columns of a rotation are unit, square and right-handed"
        )
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = (left @ right).T
    camera_from_world[:3, 3] = -camera_from_world[:3, :3] @ pose[:3, 3]
    return View(width, height, fx, fy, cx, cy, camera_from_world)
