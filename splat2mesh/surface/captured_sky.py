"""The sky that a capture saw: its far splats, seen from the middle, as a lat-long picture with its coverage.

Far splats are a picture of the light that the scene stood in: a measurement where the photographs were not clipped,
and a lower bound where they were.
"""

import numpy as np

from ..base.arrays import Directions, Floats, Mask, Matrix4, Vector
from ..base.sphere import texel_directions
from ..render.rasterize import rasterize
from ..render.view import View
from ..scene.color import CLIPPED_SRGB, linear_from_srgb
from ..scene.measured import SKY_HEIGHT, SKY_WIDTH, CapturedSky
from ..splats.splats import Splats
from ..views.eyes import FOV_DEG
from ..views.viewpoints import bounds_of

SUBSAMPLES = 4
"""Samples along a side of each texel."""

FACE_PIXELS = SUBSAMPLES * SKY_HEIGHT // 2
"""Side of each of the six pictures that are drawn, a quarter turn wide: a pixel for each sample."""

SEEN = 0.5
"""Alpha from which a direction counts as seen: below it is the fringe of a splat that no photograph showed alone."""

MIN_COVERAGE = 0.01
"""Least part of the sphere: a smaller sky carries no information on the light."""


def captured_sky(
    splats: Splats,  # Splats, in their own frame
    far: Mask,  # (N,) bool, which of them are far background
    scene_from_splat: Matrix4,  # (4, 4)
    eye: Vector
    | None = None,  # (3,) in the frame of the splats, where the capture stood; the middle of what is not far without
) -> CapturedSky | None:
    """The CapturedSky of far splats, in the scene frame; None where they cover too little of the sphere."""
    if not far.any():
        return None
    if eye is None:
        eye = bounds_of(splats.take(np.flatnonzero(~far))).mean(axis=0)
    turn = np.asarray(scene_from_splat, np.float64)[:3, :3]
    turn = turn / np.cbrt(np.linalg.det(turn))
    directions = texel_directions(SKY_HEIGHT * SUBSAMPLES, SKY_WIDTH * SUBSAMPLES).reshape(-1, 3) @ turn
    color, alpha = _looked_up(splats.take(np.flatnonzero(far)), np.asarray(eye, np.float64), directions)
    seen = alpha > SEEN
    color = np.clip(color / np.maximum(alpha, np.float32(SEEN))[:, None], 0.0, 1.0)
    clipped = seen[:, None] & (color > CLIPPED_SRGB)
    linear = np.where(clipped, np.float32(0.0), linear_from_srgb(color.astype(np.float32)))
    shape = SKY_HEIGHT, SUBSAMPLES, SKY_WIDTH, SUBSAMPLES

    def mean(values: Floats) -> Floats:
        return values.reshape(*shape, -1).mean(axis=(1, 3), dtype=np.float32)

    bound = seen[:, None] & ~clipped
    share = mean(bound.astype(np.float32))
    radiance = mean(np.where(bound, linear, np.float32(0.0))) / np.maximum(share, np.float32(1e-6))
    sky = CapturedSky(radiance, share, mean(clipped.astype(np.float32)))
    return sky if sky.coverage >= MIN_COVERAGE else None


def _looked_up(splats: Splats, eye: Vector, directions: Directions) -> tuple[Floats, Floats]:
    """Premultiplied sRGB (D, 3) and alpha (D,) float32 of splats as seen from an eye along directions (D, 3)."""
    color, alpha = np.zeros((len(directions), 3), np.float32), np.zeros(len(directions), np.float32)
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    face = (directions @ axes.T).argmax(axis=1)
    near = 1e-3 * float(np.median(np.linalg.norm(splats.means - eye.astype(np.float32), axis=1)))
    for index, axis in enumerate(axes):
        rows = np.flatnonzero(face == index)
        view = View.look_at(eye, eye + axis, axes[(index + 1) % 3], FOV_DEG, FACE_PIXELS)
        drawn = rasterize(splats, view, near)
        pixels, _ = view.project(eye + directions[rows])
        column, row = np.clip(pixels.astype(np.int64), 0, FACE_PIXELS - 1).T
        color[rows], alpha[rows] = drawn.color[row, column], drawn.alpha[row, column]
    return color, alpha
