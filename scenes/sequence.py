"""A sequence: a tabletop on which one solid moves, frame by frame, as splats that keep their rows, with the truth."""

from dataclasses import replace

import numpy as np

from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.splats.splats import SH_C0, Splats

from .cameras import FLIP
from .kinds import build
from .light import bake, exposure
from .splat import COLOR_NOISE, aligned, interpolated, surface_samples

MOVING = 1
"""The column in the middle of a tabletop, by `SceneTruth.part`."""

REACH = 0.3
"""How far it moves to either side along x; the solids around it stand beyond."""


class MovingTabletop:
    """A tabletop of so many frames. still: whether nothing moves. rows of the splats are the same in every frame.

    moving: (N,) bool, the splats that move.
    """

    def __init__(self, frames, splats=20_000, vertices=8_000, seed=0, still=False):
        self._truth = build("tabletop", seed, vertices)
        self.shifts = np.zeros(frames) if still else np.linspace(-REACH, REACH, frames)
        rng = np.random.default_rng(seed)
        points, normals, _, self._faces, self._weights, *sizes = surface_samples(self._truth, splats, rng)
        shape = aligned(points, normals, np.zeros_like(points), *sizes, rng)
        self._means, self._scales, self._quats, self._opacities = shape[:4]
        self.moving = self._truth.part[self._faces[:, 0]] == MOVING

    def truth(self, number):
        """The SceneTruth of a frame."""
        vertices = self._truth.vertices.copy()
        vertices[self._truth.part == MOVING, 0] += np.float32(self.shifts[number])
        return replace(self._truth, vertices=vertices)

    def gain(self, light):
        """The exposure of all frames in a light: that of the first."""
        return float(exposure(bake(self.truth(0), light)))

    def splats(self, number, light, gain, noise=COLOR_NOISE):
        """The Splats of a frame in a light, y down. noise: standard deviation of its own noise, sRGB; 0: the truth."""
        radiance = bake(self.truth(number), light)
        colors = srgb_from_linear(interpolated(np.float32(gain) * radiance, self._faces, self._weights))
        own = np.random.default_rng([number, 1]).standard_normal(colors.shape, np.float32)
        colors = np.clip(colors + np.float32(noise) * own, 0.0, 1.0)
        means = self._means.copy()
        means[self.moving, 0] += np.float32(self.shifts[number])
        sh = ((colors - 0.5) / SH_C0)[:, None]
        return Splats(means * FLIP, self._scales, self._quats * [1.0, *FLIP], self._opacities, sh)
