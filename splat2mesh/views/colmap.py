"""Cameras of a COLMAP model, the frame that INRIA's training keeps. Source: colmap.github.io, "Output Format".

The reader replaces COLMAP's library, which does not return from a truncated file and takes 140 MB
(`docs/decisions.md`).
"""

import os
import struct
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from ..base.errors import InputError
from ..base.gltfnodes import matrix_from_trs
from ..base.inputs import file_size, reading
from ..render.view import View
from .poses import LOST, PANORAMA, Camera

_Camera: TypeAlias = tuple[int, int, int, tuple[float, ...]]  # focal lengths, width, height, numbers
_Image: TypeAlias = tuple[int, list[float], list[float]]  # camera, quaternion w x y z, translation

_PARAMETERS = {
    "SIMPLE_PINHOLE": "f cx cy",
    "PINHOLE": "fx fy cx cy",
    "SIMPLE_RADIAL": "f cx cy k",
    "RADIAL": "f cx cy k1 k2",
    "OPENCV": "fx fy cx cy k1 k2 p1 p2",
    "OPENCV_FISHEYE": "fx fy cx cy k1 k2 k3 k4",
    "FULL_OPENCV": "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6",
    "FOV": "fx fy cx cy omega",
    "SIMPLE_RADIAL_FISHEYE": "f cx cy k",
    "RADIAL_FISHEYE": "f cx cy k1 k2",
    "THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
    "RAD_TAN_THIN_PRISM_FISHEYE": "fx fy cx cy k0 k1 k2 k3 k4 k5 p0 p1 s0 s1 s2 s3",
    "SIMPLE_DIVISION": "f cx cy k",
    "DIVISION": "fx fy cx cy k",
    "SIMPLE_FISHEYE": "f cx cy",
    "FISHEYE": "fx fy cx cy",
    "EUCM": "fx fy cx cy alpha beta",
    "EQUIRECTANGULAR": "w h",
}
"""The parameters of each camera model, in the order of the models' numbers. A panorama has no focal length. Source:
COLMAP 4.2, src/colmap/sensor/models.h."""

_BY_NUMBER = dict(enumerate(_PARAMETERS.values()))
_POINT_BYTES = struct.calcsize("<2dq")  # of a keypoint: x, y, and the point that it shows


def is_colmap(folder: Path) -> bool:
    """Return whether a folder holds a COLMAP model."""
    return any((folder / f"cameras{suffix}").is_file() for suffix in (".txt", ".bin"))


def colmap_models(folder: Path) -> list[Path]:
    """The COLMAP models in a folder of a capture, also in the numbered ones that COLMAP's mapper writes, in order."""
    found = []
    for base in (folder, folder / "sparse", folder / "colmap" / "sparse"):
        numbered = [each for each in base.iterdir() if each.name.isdecimal()] if base.is_dir() else []
        found += [*sorted(numbered, key=lambda each: (len(each.name), each.name)), base]
    return [each for each in found if is_colmap(each)]


def read_colmap(folder: str | os.PathLike[str]) -> list[Camera]:
    """Read the cameras of a COLMAP model, text or binary.

    folder: holds the files of cameras and images. What else a model holds is not read. Returns a list of View or str in
    the order of their image ids, in the frame of the model; the reason where an image gives no view. Lens distortion is
    ignored: the focal lengths and the principal point of each camera are kept. Raises InputError for a folder whose
    files are damaged or that holds no posed image.
    """
    folder = Path(folder)
    if not is_colmap(folder):
        raise InputError(f"{folder}: not a COLMAP model; expected cameras.bin or cameras.txt, as in sparse/0")
    binary = (folder / "cameras.bin").is_file()
    suffix, cameras_of, images_of = (".bin", _cameras, _images) if binary else (".txt", _text_cameras, _text_images)
    found: list[Any] = []
    for name, parse in (("cameras", cameras_of), ("images", images_of)):
        file = folder / f"{name}{suffix}"
        file_size(file, "part of the COLMAP model")
        with reading(file):
            try:
                found.append(parse(file.read_bytes()))
            except (struct.error, ValueError, IndexError, KeyError, UnicodeError) as error:
                raise InputError(f"{folder}: cannot read {file.name} of this COLMAP model ({error})") from error
    cameras, images = found
    views = []
    for image in sorted(images):
        camera, quat_wxyz, place = images[image]
        if camera not in cameras:
            raise InputError(f"{folder}: cannot read this COLMAP model (image {image} names camera {camera})")
        views.append(_view(f"{folder}: camera {camera} of the COLMAP model", cameras[camera], quat_wxyz, place))
    if PANORAMA in views and not any(isinstance(view, View) for view in views):
        raise InputError(
            f"{folder}: its pictures are panoramas, and only pinhole cameras are supported; leave `cameras` out"
        )
    if not any(isinstance(view, View) for view in views):
        raise InputError(f"{folder}: the COLMAP model holds no posed image")
    return views


def _view(where: str, camera: _Camera, quat_wxyz: list[float], place: list[float]) -> Camera:
    """The View of an image, or why there is none. Raises InputError for a camera that takes no picture."""
    focals, width, height, numbers = camera
    if not focals:
        return PANORAMA
    if not (np.isfinite([*quat_wxyz, *place, *numbers[: focals + 2]]).all() and any(quat_wxyz)):
        return LOST
    fx, fy, (cx, cy) = numbers[0], numbers[focals - 1], numbers[focals : focals + 2]
    if not (0 < width < 2**31 and 0 < height < 2**31 and min(fx, fy) > 0):
        size = f"{width} x {height} pixels, focal lengths {fx:g} and {fy:g}"
        raise InputError(f"{where} has no usable picture: {size}")
    quat_xyzw = np.roll(quat_wxyz, -1)
    return View(width, height, fx, fy, cx, cy, matrix_from_trs(np.array(place), quat_xyzw, np.ones(3)))


def _focals(names: list[str]) -> int:
    """How many of a model's parameters, the first ones, are focal lengths."""
    return sum(name in ("f", "fx", "fy") for name in names)


def _cameras(data: bytes) -> dict[int, _Camera]:
    (count,), at = struct.unpack_from("<Q", data), 8
    found: dict[int, _Camera] = {}
    for _ in range(count):  # ends with an error where the data does
        key, model, width, height = struct.unpack_from("<IiQQ", data, at)
        names = _BY_NUMBER[model].split()
        found[key] = _focals(names), width, height, struct.unpack_from(f"<{len(names)}d", data, at + 24)
        at += 24 + 8 * len(names)
    return found


def _images(data: bytes) -> dict[int, _Image]:
    (count,), at = struct.unpack_from("<Q", data), 8
    found: dict[int, _Image] = {}
    for _ in range(count):
        key, *pose, camera = struct.unpack_from("<I7dI", data, at)
        at = data.index(b"\0", at + 64) + 1
        (points,) = struct.unpack_from("<Q", data, at)
        at += 8 + points * _POINT_BYTES
        if at > len(data):
            raise ValueError(f"image {key} goes beyond the end")
        found[key] = camera, pose[:4], pose[4:]
    return found


def _text_cameras(data: bytes) -> dict[int, _Camera]:
    found = {}
    for line in data.decode().splitlines():
        words = line.split()
        if words and words[0][0] != "#":
            names, numbers = _PARAMETERS[words[1]].split(), tuple(map(float, words[4:]))
            if len(numbers) != len(names):
                raise ValueError(f"a camera {words[1]} has {len(names)} numbers, found {len(numbers)}")
            found[int(words[0])] = _focals(names), int(words[2]), int(words[3]), numbers
    return found


def _text_images(data: bytes) -> dict[int, _Image]:
    found: dict[int, _Image] = {}
    lines = iter(data.decode().splitlines())
    for line in lines:
        words = line.split()
        if words and words[0][0] != "#":
            numbers = list(map(float, words[1:8]))
            found[int(words[0])] = int(words[8]), numbers[:4], numbers[4:]
            next(lines, None)  # its keypoints
    return found
