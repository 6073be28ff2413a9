"""A picture that numbers the lamps of a captured room, each seen from a position of the capture."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.views.picture import FOV_DEG

from .kinds import PICTURE_SIZE
from .picture import RelitPicture
from .sheet import MARK, sheet

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

SIZE = PICTURE_SIZE[0] // 2, PICTURE_SIZE[1] // 2

RING = 0.16
"""Radius of the ring about a lamp, of the picture's height."""


def lamps_picture(scene: "Scene", lamps: Sequence[dict[str, Any]]) -> NDArray[np.uint8]:
    """Return the picture, (H, W, 3) uint8 sRGB.

    scene: a closed room, which knows where its capture stood. lamps: as the report has them, in order: `place` (3,),
    scene frame, `share_of_light` and `evidence`.
    """
    pictures = []
    eyes = np.asarray(scene.capture.get("eyes", ()), np.float64).reshape(-1, 3)
    for number, lamp in enumerate(lamps, 1):
        place = np.asarray(lamp["place"], np.float64)
        eye = _best(eyes, place, scene)
        camera = {"eye": eye.tolist(), "target": place.tolist(), "up": [0.0, 1.0, 0.0], "fov_deg": FOV_DEG}
        picture = RelitPicture(scene, camera, SIZE).of_vertices(scene.colors_linear, None, 1.0)
        name = f"lamp {number}: {lamp['share_of_light']:.0%} of the light"
        pictures.append((name, _ringed(np.array(picture, np.uint8))))
    return np.asarray(sheet(pictures), np.uint8)


def _best(eyes: NDArray[np.float64], place: NDArray[np.float64], scene: "Scene") -> NDArray[np.float64]:
    """The standpoint that sees a lamp well: neither from right below nor from far off, and with nothing in between."""
    if not len(eyes):
        return np.asarray(scene.vertices.mean(axis=0), np.float64)
    toward = place - eyes
    distance = np.linalg.norm(toward, axis=1)
    near = 0.98 - 0.1 / np.maximum(distance / scene.diagonal * 20.0, 1.0)
    rays = np.hstack([eyes, toward * near[:, None]]).astype(np.float32)
    hidden = RayCaster(scene.vertices, scene.faces).occluded(rays, 1.0)
    steep = np.abs(toward[:, 1]) / np.maximum(distance, 1e-9)
    return eyes[np.argmin(10.0 * hidden + steep)]


def _ringed(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A ring about the middle, where the camera looks."""
    height, width = picture.shape[:2]
    y, x = np.mgrid[:height, :width]
    off = np.hypot(x - width / 2, y - height / 2) / height
    picture[np.abs(off - RING) < 0.006] = MARK
    return picture
