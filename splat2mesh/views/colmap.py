"""Cameras of a COLMAP model, the frame that INRIA's training keeps. Source: colmap.github.io, "Output Format"."""

from pathlib import Path

import numpy as np

from ..base.errors import InputError
from ..base.extras import needed
from ..render.view import View


def is_colmap(folder):
    """Whether a folder holds a COLMAP model."""
    return any((folder / f"cameras{suffix}").is_file() for suffix in (".txt", ".bin"))


def read_colmap(folder):
    """Views of a COLMAP model (text or binary), in the order of their image ids.

    folder: holds cameras, images and points3D files. Lens distortion is ignored: the focal lengths and the principal
    point of each camera are kept. Raises InputError for a folder that pycolmap cannot read or that holds no image.
    """
    folder = Path(folder)
    if not is_colmap(folder):
        raise InputError(f"{folder}: not a COLMAP model; expected cameras.bin or cameras.txt, as in sparse/0")
    pycolmap = needed("pycolmap", "reading the cameras of a COLMAP model")
    try:
        model = pycolmap.Reconstruction(str(folder))
        views = [_view(model, model.images[key]) for key in sorted(model.images)]
    except (ValueError, RuntimeError, KeyError, IndexError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f"{folder}: pycolmap cannot read this model ({reason})") from error
    views = [view for view in views if np.isfinite(view.camera_from_world).all()]
    if not views:
        raise InputError(f"{folder}: the COLMAP model holds no posed image")
    return views


def _view(model, image):
    camera = model.cameras[image.camera_id]
    matrix = np.eye(4)
    pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
    matrix[:3] = pose.matrix()
    focal = camera.focal_length_x, camera.focal_length_y
    principal = camera.principal_point_x, camera.principal_point_y
    return View(camera.width, camera.height, *focal, *principal, matrix)
