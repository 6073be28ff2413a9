"""Pictures of a mesh and a sky: the visible face of every pixel is found once, by rays.

A picture under another light then only mixes three colours per pixel. A test compares it with rays of its own.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import read_only, shared
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear

from ..output.catcher import GroundLight
from .camera import Orbit


class Raster:
    """The triangles of a scene before a camera.

    size: width and height of the last picture.
    """

    def __init__(self, vertices: NDArray, faces: NDArray) -> None:
        self._faces = read_only(faces, np.int32)
        self._caster = RayCaster(vertices, faces) if len(faces) else None
        self._seen: tuple[Orbit, tuple[int, int]] | None = None
        self._sky_places: NDArray | None = None
        self.size = (0, 0)

    def look(self, orbit: Orbit, size: tuple[int, int]) -> None:
        """Find the visible face of every pixel from an Orbit: once per view, for any number of lights."""
        if (orbit, size) == self._seen:
            return
        width, height = self.size = size
        ways = orbit.view(size).ray_directions()
        self._ways, self._sky_places = ways.astype(np.float32), None
        self._seen = orbit, size
        self._face, self._weights = np.full((height, width), -1, np.int32), np.zeros((height, width, 2), np.float32)
        if self._caster is not None:
            rays = np.concatenate([np.broadcast_to(orbit.eye.astype(np.float32), ways.shape), self._ways], axis=-1)
            _, self._face, self._weights, _ = self._caster.first_hits(rays)

    def paint(
        self,
        colors: NDArray,  # (V, 3) uint8
        captured: tuple[NDArray, float] | None = None,  # the same, shown left of a place, 0..1 over the width
        sky: tuple[NDArray, float] | None = None,  # (H', W', 3) uint8 canonical lat-long, turned by an angle in degrees
        backdrop: Any = ((0, 0, 0), (0, 0, 0)),  # without a sky, sRGB bytes at the bottom and the top
        ground: GroundLight | None = None,  # on which an object stands
    ) -> NDArray:
        """The picture, (H, W, 3) uint8, top row first."""
        width, height = self.size
        out = np.zeros((height, width, 3), np.uint8)
        before, split = (colors, 0.0) if captured is None else captured
        low, high = np.asarray(backdrop, np.float32)
        ramp = np.linspace(high, low, height).astype(np.float32)
        places, image, shift = np.zeros((0, 0, 2), np.float32), np.zeros((1, 1, 3), np.uint8), np.float32(0.0)
        if sky is not None:
            places, image, shift = self._places(), sky[0], np.float32(sky[1] % 360.0 / 360.0)
        arrays = self._faces, self._face, self._weights, colors, before, np.float32(width * split)
        _paint(height, *arrays, places, image, shift, ramp, out)
        if ground is not None and self._seen is not None:
            _shade_ground(out, self._face, self._ways, self._seen[0].eye, ground)
        return out

    def _places(self) -> NDArray:
        """Where in the unrotated sky the pixels look: (H, W, 2) float32, u and v in 0..1."""
        if self._sky_places is None:
            x, y, z = np.moveaxis(self._ways, -1, 0)
            u, v = np.arctan2(x, z) / (2.0 * math.pi), np.arctan2(y, np.hypot(x, z)) / math.pi
            self._sky_places = np.float32(0.5) - np.stack([u, v], axis=-1).astype(np.float32)
        return self._sky_places


@shared
@kernel
def _paint(
    begin: int,
    end: int,
    faces: NDArray,
    face: NDArray,
    weights: NDArray,
    colors: NDArray,
    captured: NDArray,
    left: np.float32,
    places: NDArray,
    sky: NDArray,
    shift: np.float32,
    ramp: NDArray,
    out: NDArray,
) -> None:
    _, width = face.shape
    rows, columns, _ = sky.shape
    texels, half = sky.reshape(-1), np.float32(0.5)
    for y in range(begin, end):
        for x in range(width):
            f = face[y, x]
            if f >= 0:
                source = captured if x + half < left else colors
                a, b, c = faces[f]
                second, third = weights[y, x, 0], weights[y, x, 1]
                first = np.float32(1.0) - second - third
                for channel in range(3):
                    mixed = np.float32(source[a, channel]) * first + np.float32(source[b, channel]) * second
                    out[y, x, channel] = np.uint8(np.int32(mixed + np.float32(source[c, channel]) * third + half))
            elif len(places) > 0:
                u = places[y, x, 0] + shift
                u -= np.float32(int(u))  # places and shift are both in 0..1
                column = u * np.float32(columns) - half
                row = min(max(places[y, x, 1] * np.float32(rows) - half, np.float32(0.0)), np.float32(rows - 1))
                one, upper = int(column + np.float32(1.0)) - 1, int(row)  # a column is -1/2 at the least
                rightward, downward = column - np.float32(one), row - np.float32(upper)
                lower = min(upper + 1, rows - 1)
                two = one + 1 if one + 1 < columns else 0
                one = one if one >= 0 else columns - 1
                # Unsigned, or every index would be asked whether it counts from the end.
                a, b = np.uint64(3 * (upper * columns + one)), np.uint64(3 * (upper * columns + two))
                c, d = np.uint64(3 * (lower * columns + one)), np.uint64(3 * (lower * columns + two))
                for channel in range(3):
                    at = np.uint64(channel)
                    above, below = np.float32(texels[a + at]), np.float32(texels[c + at])
                    above += (np.float32(texels[b + at]) - above) * rightward
                    below += (np.float32(texels[d + at]) - below) * rightward
                    out[y, x, channel] = np.uint8(np.int32(above + (below - above) * downward + half))
            else:
                for channel in range(3):
                    out[y, x, channel] = np.uint8(ramp[y, channel] + half)


def _shade_ground(picture: NDArray[np.uint8], face: NDArray, ways: NDArray, eye: NDArray, ground: GroundLight) -> None:
    """Darken the ground in a picture (H, W, 3) uint8 sRGB of the sky, in place, where nothing stands before it.

    face: (H, W), negative where nothing stands. ways: (H, W, 3) float32, through the pixels, of any length from 1. eye:
    (3,) scene frame.
    """
    free, pixels = np.flatnonzero(face < 0), picture.reshape(-1, 3)
    share = ground.share_seen(eye, ways.reshape(-1, 3)[free])
    dark = (share < 1.0).any(axis=1)
    light = linear_from_srgb(pixels[free[dark]].astype(np.float32) / np.float32(255.0)) * share[dark]
    pixels[free[dark]] = bytes_from_unit(srgb_from_linear(light))
