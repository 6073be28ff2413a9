"""Moving pictures if OpenGL draws on the CPU: a rasteriser that keeps the visible face of every pixel.

A frame under another light then only mixes three colours per pixel. Software OpenGL transforms and rasterises all
triangles again for every picture, which takes ten times as long or more (`scripts/bench session`). Still pictures
are OpenGL's, with smooth edges; a test compares the two.

A pixel looks along d. With the corners a, b, c of a triangle as columns, the weights w of a w0 + b w1 + c w2 = d are
linear in d: w0 = d . (b x c) / det, and so on. Where none is negative the triangle is hit, at a depth of one over their
sum; triangles that reach behind the eye are no exception. Source: Olano, Greer, "Triangle scan conversion using 2D
homogeneous coordinates", 1997.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import read_only, shared

from .camera import Orbit

SOFTWARE = "llvmpipe", "softpipe", "swrast", "swiftshader", "software"
"""Parts of the names of renderers that draw on the CPU."""

_NEAR = 1e-6  # of the scene's diagonal: nearer corners count as behind the eye


class Raster:
    """The triangles of a scene before a camera.

    size: width and height of the last picture.
    """

    def __init__(self, vertices: NDArray, faces: NDArray, diagonal: float) -> None:
        self._vertices = np.ascontiguousarray(vertices, np.float32)
        self._faces, self._near = read_only(faces, np.int32), _NEAR * diagonal
        self._seen: tuple[Orbit, tuple[int, int]] | None = None
        self._sky_places: NDArray | None = None
        self.size = (0, 0)

    def look(self, orbit: Orbit, size: tuple[int, int]) -> None:
        """Find the visible face of every pixel from an Orbit: once per view, for any number of lights."""
        if (orbit, size) == self._seen:
            return
        width, height = size
        if size != self.size:
            self.size = size
            self._face = np.zeros((height, width), np.int32)
            self._weights = np.zeros((height, width, 3), np.float32)  # two of the corners, and one over the depth
        # Camera axes x right, y up, z ahead, x and y in pixels of the picture plane.
        right, up, backward = orbit.axes
        focal = 0.5 * width / math.tan(math.radians(orbit.fov_deg) / 2.0)
        axes = np.stack([right * focal, up * focal, -backward]).astype(np.float32)
        local = (self._vertices - orbit.eye.astype(np.float32)) @ axes.T
        _rasterise(height, local, self._faces, np.float32(self._near), self._face, self._weights)
        self._seen, self._sky_places = (orbit, size), None

    def paint(
        self,
        colors: NDArray,
        captured: NDArray | None = None,
        split: float = 0.0,
        sky: NDArray | None = None,
        angle_deg: float = 0.0,
        backdrop: Any = ((0, 0, 0), (0, 0, 0)),
    ) -> NDArray:
        """The picture, (H, W, 3) uint8, BOTTOM row first.

        colors: (V, 3) uint8. captured: the same, shown left of `split`, 0..1 over the width. sky: (H', W', 3) uint8
        canonical lat-long, turned by `angle_deg`; without one `backdrop`, sRGB bytes at the bottom and the top.
        """
        width, height = self.size
        out = np.zeros((height, width, 3), np.uint8)
        left = width * split if captured is not None else 0.0
        captured = colors if captured is None else captured
        low, high = np.asarray(backdrop, np.float32)
        ramp = np.linspace(low, high, height).astype(np.float32)
        if sky is None:
            places, sky = np.zeros((0, 0, 2), np.float32), np.zeros((1, 1, 3), np.uint8)
        else:
            places = self._places()
        shift = np.float32(angle_deg % 360.0 / 360.0)
        arrays = self._faces, self._face, self._weights, colors, captured, np.float32(left)
        _paint(height, *arrays, places, sky, shift, ramp, out)
        return out

    def _places(self) -> NDArray:
        """Where in the unrotated sky the pixels without a face look: (H, W, 2) float32, u and v in 0..1."""
        if self._sky_places is None:
            assert self._seen is not None
            orbit, (width, height) = self._seen
            right, up, backward = (axis.astype(np.float32) for axis in orbit.axes)
            focal = np.float32(0.5 * width / math.tan(math.radians(orbit.fov_deg) / 2.0))
            self._sky_places = np.zeros((height, width, 2), np.float32)
            _look_up(height, self._face, right, up, -backward, focal, self._sky_places)
        return self._sky_places


def prepare() -> None:
    """Compile these kernels or load them compiled, before the first picture would wait seconds for it."""
    raster = Raster(np.zeros((3, 3)), np.zeros((1, 3)), 1.0)
    raster.look(Orbit((0.0, 0.0, 0.0), 1.0, 0.0, 0.0, 40.0, 1.0), (8, 8))
    raster.paint(np.zeros((3, 3), np.uint8), sky=np.zeros((2, 4, 3), np.uint8))


@shared
@kernel
def _rasterise(
    begin: int, end: int, local: NDArray, faces: NDArray, near: np.float32, face: NDArray, weights: NDArray
) -> None:
    """Find the nearest face at every pixel of rows begin..end, or -1."""
    height, width = face.shape
    middle_x, middle_y = np.float32(0.5 * width - 0.5), np.float32(0.5 * height - 0.5)
    for y in range(begin, end):
        for x in range(width):
            face[y, x] = -1
            weights[y, x, 2] = np.float32(0.0)
    for f in range(len(faces)):
        a, b, c = faces[f]
        ax, ay, az = local[a, 0], local[a, 1], local[a, 2]
        bx, by, bz = local[b, 0], local[b, 1], local[b, 2]
        cx, cy, cz = local[c, 0], local[c, 1], local[c, 2]
        if max(az, bz, cz) <= near:
            continue
        low_x, high_x, low_y, high_y = 0, width - 1, begin, end - 1
        if min(az, bz, cz) > near:
            pa, pb, pc = ay / az + middle_y, by / bz + middle_y, cy / cz + middle_y
            low_y = max(begin, math.ceil(min(pa, pb, pc)))
            high_y = min(end - 1, math.floor(max(pa, pb, pc)))
            if low_y > high_y:
                continue
            pa, pb, pc = ax / az + middle_x, bx / bz + middle_x, cx / cz + middle_x
            low_x, high_x = max(0, math.ceil(min(pa, pb, pc))), min(width - 1, math.floor(max(pa, pb, pc)))
            if low_x > high_x:
                continue
        # In doubles: a small triangle's planes are differences of large numbers.
        ux, uy, uz = np.float64(by) * cz - np.float64(bz) * cy, np.float64(bz) * cx - np.float64(bx) * cz, 0.0
        uz = np.float64(bx) * cy - np.float64(by) * cx
        vx, vy = np.float64(cy) * az - np.float64(cz) * ay, np.float64(cz) * ax - np.float64(cx) * az
        vz = np.float64(cx) * ay - np.float64(cy) * ax
        wx, wy = np.float64(ay) * bz - np.float64(az) * by, np.float64(az) * bx - np.float64(ax) * bz
        wz = np.float64(ax) * by - np.float64(ay) * bx
        determinant = ax * ux + ay * uy + az * uz
        if determinant == 0.0:
            continue
        scale = 1.0 / determinant
        for y in range(low_y, high_y + 1):
            dy = y - np.float64(middle_y)
            for x in range(low_x, high_x + 1):
                dx = x - np.float64(middle_x)
                first = (ux * dx + uy * dy + uz) * scale
                second = (vx * dx + vy * dy + vz) * scale
                third = (wx * dx + wy * dy + wz) * scale
                if first >= 0.0 and second >= 0.0 and third >= 0.0:
                    total = first + second + third
                    if total > weights[y, x, 2]:
                        face[y, x] = f
                        weights[y, x, 0], weights[y, x, 1] = second / total, third / total
                        weights[y, x, 2] = total


@shared
@kernel
def _look_up(
    begin: int, end: int, face: NDArray, right: NDArray, up: NDArray, ahead: NDArray, focal: np.float32, places: NDArray
) -> None:
    height, width = face.shape
    turn = np.float32(0.5 / math.pi)
    for y in range(begin, end):
        dy = (np.float32(y) - np.float32(0.5 * height - 0.5)) / focal
        for x in range(width):
            if face[y, x] >= 0:
                continue
            dx = (np.float32(x) - np.float32(0.5 * width - 0.5)) / focal
            tx = ahead[0] + dx * right[0] + dy * up[0]
            ty = ahead[1] + dx * right[1] + dy * up[1]
            tz = ahead[2] + dx * right[2] + dy * up[2]
            places[y, x, 0] = np.float32(0.5) - math.atan2(tx, tz) * turn
            places[y, x, 1] = np.float32(0.5) - math.atan2(ty, math.sqrt(tx * tx + tz * tz)) * np.float32(2.0) * turn


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
