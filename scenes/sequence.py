"""A sequence: a tabletop on which one solid moves, frame by frame, as splats that keep their rows, with the truth."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.splats import SH_C0, Splats

from .cameras import FLIP
from .kinds import build
from .light import bake, exposure
from .splat import COLOR_NOISE, aligned, interpolated, surface_samples

COLUMN, BOX = 1, 3
"""The solids that move, by `SceneTruth.part`: the column in the middle of a tabletop, and the box beside it."""

REACH = 0.3
"""How far the column moves to either side along x; the solids around it stand beyond."""

MOTIONS = "slide", "turn", "none"
"""What moves: the column across the table; the box by 90 degrees about one of its upright edges, as a door; nothing."""


class MovingTabletop:
    """A tabletop of so many frames, of one of MOTIONS. rows of the splats are the same in every frame.

    moving: (N,) bool, the splats that move.
    """

    def __init__(self, frames, splats=20_000, vertices=8_000, seed=0, motion="slide"):
        self._truth, self._count, self._motion = build("tabletop", seed, vertices), frames, motion
        rng = np.random.default_rng(seed)
        points, normals, _, self._faces, self._weights, *sizes = surface_samples(self._truth, splats, rng)
        shape = aligned(points, normals, np.zeros_like(points), *sizes, rng)
        self._means, self._scales, self._quats, self._opacities = shape[:4]
        self._part = COLUMN if motion == "slide" else BOX
        self.moving = self._truth.part[self._faces[:, 0]] == self._part

    def pose(self, number):
        """(rotation or None, shift (3,)) of what moves, in a frame: about the origin, in the scene frame."""
        if self._motion != "turn":
            reach = REACH if self._motion == "slide" else 0.0
            return None, np.array([np.linspace(-reach, reach, self._count)[number], 0.0, 0.0], np.float32)
        turn = Rotation.from_euler("y", np.linspace(0.0, 90.0, self._count)[number], degrees=True)
        box = self._truth.vertices[self._truth.part == BOX].astype(np.float64)
        hinge = box[np.abs(box[:, [0, 2]] - box.mean(axis=0)[[0, 2]]).sum(axis=1).argmax()]
        return turn, hinge - turn.apply(hinge)

    def truth(self, number):
        """The SceneTruth of a frame."""
        (turn, shift), rows = self.pose(number), self._truth.part == self._part
        vertices, normals = self._truth.vertices.copy(), self._truth.normals.copy()
        if turn is not None:
            vertices[rows], normals[rows] = turn.apply(vertices[rows]), turn.apply(normals[rows])
        vertices[rows] += shift
        return replace(self._truth, vertices=vertices, normals=normals)

    def gain(self, light):
        """The exposure of all frames in a light: that of the first."""
        return float(exposure(bake(self.truth(0), light)))

    def splats(self, number, light, gain, noise=COLOR_NOISE):
        """The Splats of a frame in a light, y down. noise: standard deviation of its own noise, sRGB; 0: the truth."""
        radiance = bake(self.truth(number), light)
        colors = srgb_from_linear(interpolated(np.float32(gain) * radiance, self._faces, self._weights))
        own = np.random.default_rng([number, 1]).standard_normal(colors.shape, np.float32)
        colors = np.clip(colors + np.float32(noise) * own, 0.0, 1.0)
        (turn, shift), rows = self.pose(number), self.moving
        means, quats = self._means.copy(), self._quats.copy()
        if turn is not None:
            means[rows] = turn.apply(means[rows])
            quats[rows] = (turn * Rotation.from_quat(quats[rows], scalar_first=True)).as_quat(scalar_first=True)
        means[rows] += shift
        sh = ((colors - 0.5) / SH_C0)[:, None]
        return Splats(means * FLIP, self._scales, quats * [1.0, *FLIP], self._opacities, sh)
