"""A picture of the scene with an arrow on the ground that points north, as used for the sun of a date."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from .kinds import PICTURE_SIZE
from .picture import RelitPicture
from .preview import NOWHERE
from .sheet import MARK

if TYPE_CHECKING:
    from splat2mesh.render.view import View
    from splat2mesh.scene.scene import Scene

ANCHOR = 0.5, 0.7
"""Position of the arrow's middle, in widths and heights of the picture: on the ground in front of the middle."""

LENGTH = 0.2
"""Length of the arrow, over its distance from the camera."""

HALF = np.array([[0.5, 0.0], [0.1, 0.22], [0.1, 0.07], [-0.5, 0.07]])
OUTLINE = np.concatenate([HALF, HALF[:0:-1] * [1.0, -1.0]])
"""Outline of an arrow of length 1 along x, its tip first."""

LETTER = 0.62
"""Distance of the N from the middle of the arrow, as a share of its length."""

NEAREST = 1e-3
"""Near limit over its distance: closer parts are not drawn."""


def north(north_deg: float) -> NDArray[np.float64]:
    """Return the direction of north, (3,) unit, scene frame.

    north_deg: by how much it is turned about +y from -z, counter-clockwise from above.
    """
    turn = np.radians(north_deg)
    return np.array([-np.sin(turn), 0.0, -np.cos(turn)])


def north_picture(
    scene: "Scene", radiance: NDArray[np.float32], north_deg: float, camera: dict | None = None
) -> NDArray[np.uint8]:
    """Return the picture, (H, W, 3) uint8 sRGB.

    radiance: (V, 3) float32, linear, in which the mesh is drawn. north_deg: as of `north`. camera: as of `Preview`;
    that of the preview without.
    """
    picture = RelitPicture(scene, camera, PICTURE_SIZE)
    image = Image.fromarray(np.array(picture.of_vertices(radiance, None, 1.0), np.uint8))
    view = picture.view
    anchor = _ground(view, picture.mesh.depth(), scene)
    forward = north(north_deg)
    side = np.array([-forward[2], 0.0, forward[0]])
    length = LENGTH * float(np.linalg.norm(anchor - view.center))
    places = np.concatenate([OUTLINE, [[LETTER, 0.0]]])
    world = anchor + length * (places[:, :1] * forward + places[:, 1:] * side)
    pixels, depth = _seen(view, world)
    if (depth > NEAREST * length).all():
        draw = ImageDraw.Draw(image)
        draw.polygon([tuple(each) for each in pixels[:-1].tolist()], fill=MARK)
        draw.text(tuple(pixels[-1].tolist()), "N", MARK, ImageFont.load_default(PICTURE_SIZE[1] // 24), anchor="mm")
    return np.asarray(image)


def _ground(view: "View", depth: NDArray[np.float32], scene: "Scene") -> NDArray[np.float64]:
    """(3,) scene frame: the point that the camera sees at the arrow's position; below the middle of the scene where it
    sees nothing there."""
    column, row = round(ANCHOR[0] * view.width), round(ANCHOR[1] * view.height)
    found = float(depth[row, column])
    if not found < NOWHERE:
        low, high = scene.vertices.min(axis=0), scene.vertices.max(axis=0)
        return np.array([(low[0] + high[0]) / 2.0, low[1], (low[2] + high[2]) / 2.0], np.float64)
    camera = found * np.array([(column + 0.5 - view.cx) / view.fx, (row + 0.5 - view.cy) / view.fy, 1.0])
    pose = view.camera_from_world
    return np.asarray(pose[:3, :3].T @ (camera - pose[:3, 3]), np.float64)


def _seen(view: "View", places: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Pixels (N, 2) and depths (N,) of places (N, 3) in the frame of the scene."""
    camera = places @ view.camera_from_world[:3, :3].T + view.camera_from_world[:3, 3]
    depth = np.maximum(camera[:, 2], 1e-12)
    return np.stack([camera[:, 0] * view.fx / depth + view.cx, camera[:, 1] * view.fy / depth + view.cy], 1), camera[
        :, 2
    ]
