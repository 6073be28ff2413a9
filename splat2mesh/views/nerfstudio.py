"""The transforms.json of nerfstudio, of instant-ngp and of Blender's synthetic scenes.

{"fl_x", "fl_y", "cx", "cy", "w", "h" or "camera_angle_x", "frames": [{"transform_matrix": 4 x 4, ...}]}: intrinsics for
all frames or for each; poses are world_from_camera with camera x right, y up, z backward. Distortion is ignored.

The file does not give the frame of the splat. nerfstudio trains in one that it turned, moved and scaled, and stores the
transform in dataparser_transforms.json; other trainers take the poses unchanged; poses from COLMAP were turned by
`applied_transform`. So there are several candidates. Source: docs.nerf.studio, "Data conventions";
nerfstudio/data/dataparsers/nerfstudio_dataparser.py.
"""

import os
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..base.arrays import Matrix4
from ..base.errors import DataWarning, InputError
from ..base.inputs import read_json
from .poses import Camera, view_of

TRAINING_FRAME = "dataparser_transforms.json"

UNKNOWN_SIDE = 800
"""Pixels along a picture whose size is given nowhere: Blender's synthetic scenes are square and this large."""

_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def candidates_of_transforms(
    path: Path, content: dict[str, Any], splat_path: str | os.PathLike[str]
) -> list[list[Camera]]:
    """Views of a transforms.json in every frame that the splat may be in, the likeliest first: a list of lists.

    path: Path, for messages and for what lies beside it. content: as json reads it. splat_path: Path of the splat.
    A frame without finite numbers gives the reason. Raises InputError where the file is damaged.
    """
    try:
        frames = [{**content, **frame} for frame in content["frames"]]
        models = {str(frame.get("camera_model", "")).upper() for frame in frames}
    except (KeyError, TypeError) as error:
        raise InputError(f"{path} holds no frames of nerfstudio ({type(error).__name__}: {error})") from error
    if any("EQUIRECTANGULAR" in model for model in models):
        raise InputError(
            f"{path}: its pictures are panoramas, and only pinhole cameras are supported; leave `cameras` out"
        )
    if any(not _size(frame) for frame in frames):
        warnings.warn(f"{path} gives no picture size; pictures are assumed square", DataWarning, stacklevel=2)
    found = []
    for scale, frame_from_file in _frames(path, content, splat_path):
        found.append([_view(f"{path}: frame {k}", frame, scale, frame_from_file) for k, frame in enumerate(frames, 1)])
    return found


def _size(frame: dict[str, Any]) -> tuple[float, float] | None:
    return (frame["w"], frame["h"]) if "w" in frame and "h" in frame else None


def _view(where: str, frame: dict[str, Any], scale: float, frame_from_file: Matrix4) -> Camera:
    try:
        size = _size(frame) or (UNKNOWN_SIDE, UNKNOWN_SIDE)
        if "fl_x" in frame:
            focal = frame["fl_x"], frame.get("fl_y", frame["fl_x"])
        else:
            wide = size[0] / 2 / np.tan(frame["camera_angle_x"] / 2)
            high = frame.get("camera_angle_y")
            focal = wide, wide if high is None else size[1] / 2 / np.tan(high / 2)
        principal = (frame["cx"], frame["cy"]) if "cx" in frame and "cy" in frame else None
        pose = frame_from_file @ np.array(frame["transform_matrix"], np.float64).reshape(4, 4) @ _FLIP
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{where} is not a nerfstudio frame ({type(error).__name__}: {error})") from error
    pose[:3, 3] *= scale
    return view_of(where, size, focal, principal, pose)


def _frames(path: Path, content: dict[str, Any], splat_path: str | os.PathLike[str]) -> list[tuple[float, Matrix4]]:
    """(scale, frame_from_file) of each candidate: a factor that follows, and a (4, 4) rigid transform."""
    found: list[tuple[float, Matrix4]] = []
    for folder in dict.fromkeys([Path(splat_path).absolute().parent, path.absolute().parent]):
        file = folder / TRAINING_FRAME
        if file.is_file():
            try:
                fields = read_json(file)
                found.append((float(fields["scale"]), _rigid(fields["transform"])))
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(f"{file} holds no transform and scale ({type(error).__name__}: {error})") from error
    found.append((1.0, np.eye(4)))
    if "applied_transform" in content:
        try:
            scale = float(content.get("applied_scale", 1.0))
            applied = _rigid(content["applied_transform"])
            applied[:3, 3] *= scale  # undone before the scale is
            found.append((1.0 / scale, np.linalg.inv(applied).astype(np.float64)))
        except (ValueError, TypeError, ZeroDivisionError, np.linalg.LinAlgError) as error:
            raise InputError(f"{path}: its applied_transform is invalid ({error})") from error
    return found


def _rigid(rows: Sequence[Sequence[float]]) -> Matrix4:
    matrix = np.eye(4)
    matrix[:3] = np.array(rows, np.float64)[:3]
    return matrix
