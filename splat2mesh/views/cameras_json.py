"""The cameras.json that INRIA's training writes: its cameras, in the frame of its splat.

A list of {"id", "img_name", "width", "height", "position": [x, y, z], "rotation": 3 x 3, "fx", "fy"}: the rotation is
world_from_camera, rows first, camera x right, y down, z forward; the principal point is the middle of the picture.
Source: graphdeco-inria/gaussian-splatting, utils/camera_utils.py, camera_to_JSON.
"""

import os
from typing import Any

import numpy as np

from ..base.errors import InputError
from .poses import Camera, view_of


def views_of_cameras_json(path: str | os.PathLike[str], content: list[dict[str, Any]]) -> list[Camera]:
    """Views of a cameras.json: path, for messages, and its content as json reads it. A list, the reason where one gives
    none. Raises InputError where a camera lacks something or is none."""
    views: list[Camera] = []
    for number, camera in enumerate(content, 1):
        where = f"{path}: camera {number}"
        try:
            size = camera["width"], camera["height"]
            focal = camera["fx"], camera["fy"]
            pose = np.eye(4)
            pose[:3, :3], pose[:3, 3] = camera["rotation"], camera["position"]
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"{where} is not an INRIA camera ({type(error).__name__}: {error})") from error
        views.append(view_of(where, size, focal, None, pose))
    return views
