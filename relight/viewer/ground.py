"""The ground on which an object of a session stands: its shadow, as in `preview.png` but on a coarser grid.

A thread finds once what the object hides. The shadow follows when the light rests, as suns do, and stays while the
camera moves.
"""

import math
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.kernels import kernel
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.scene import Scene

from ..light.environment import Environment
from ..light.pooling import pooled
from ..output.catcher import Catcher, GroundLight, gathered_steps
from .quick import SRGB_BYTES

if TYPE_CHECKING:
    from .lighting import SessionLight

SIDE = 64
"""Points of the ground along a side of its square: half of those of pictures."""

UNSEEN = 0.995
"""Share of the light that is no shadow: half a byte of a bright sky."""

_GRID = SIDE // 2, SIDE
"""Rows and columns of a sky that casts shadows: its texels are narrower than a shadow's directions are apart."""

_GATHERED = gathered_steps()
_BRIGHTEST = np.float32(np.iinfo(np.uint8).max)
_LINEAR = linear_from_srgb(np.arange(_BRIGHTEST + 1, dtype=np.float32) / _BRIGHTEST).astype(np.float32)


class StandingGround:
    """The ground under a scene that is an object."""

    def __init__(self, scene: Scene) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="ground")
        self._catcher: Future[Catcher] = self._thread.submit(_catcher_of, scene)
        self._small: tuple[SessionLight, Environment] | None = None
        self._shown: tuple[SessionLight, float, GroundLight] | None = None

    @property
    def ready(self) -> bool:
        """Whether it is known what the object hides."""
        return self._catcher.done() and self._catcher.exception() is None

    def under(self, light: "SessionLight", angle_deg: float, rests: bool = True) -> GroundLight | None:
        """The ground in a light at an angle; None before it is ready, and in a light that is new and does not rest."""
        if self._shown is not None and self._shown[0] is light and self._shown[1] == angle_deg:
            return self._shown[2]
        if not (rests and self.ready):
            return None
        if self._small is None or self._small[0] is not light:
            self._small = light, Environment(pooled(light.sky, _GRID).astype(np.float32), "")
        ground = self._catcher.result().quickly_under(self._small[1].rotated(angle_deg))
        self._shown = light, angle_deg, ground
        return ground

    def wait(self) -> None:
        """Wait until it is ready."""
        self._catcher.exception()

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _catcher_of(scene: Scene) -> Catcher:
    return Catcher(scene, RayCaster(scene.vertices, scene.faces), SIDE)


def shade_ground(picture: NDArray[np.uint8], face: NDArray, ways: NDArray, eye: NDArray, ground: GroundLight) -> None:
    """Darken the ground in a picture (H, W, 3) uint8 sRGB of the sky, in place, where nothing stands before it.

    face: (H, W), negative where nothing stands. ways: (H, W, 3) float32, through the pixels. eye: (3,) scene frame.
    """
    above = float(eye[1]) - ground.height
    if above <= 0.0:
        return
    place = np.array([eye[0] - ground.middle[0], eye[2] - ground.middle[1], above]) / ground.reach
    shares, last = ground.shares, len(ground.shares) - 1
    dark = shares.min(axis=2) < UNSEEN
    dark = dark[:-1, :-1] | dark[1:, :-1] | dark[:-1, 1:] | dark[1:, 1:]
    if not dark.any():
        return
    cells = (_GATHERED + np.float32(1.0)) * np.float32(0.5 * last)
    sides = []
    for axis in (0, 1):  # outside these the ground is as bright as ever
        there = np.flatnonzero(dark.any(axis=axis))
        within = np.flatnonzero((cells >= there[0]) & (cells <= there[-1] + 1))
        sides += [2.0 * within[0] / (len(cells) - 1) - 1.0, 2.0 * within[-1] / (len(cells) - 1) - 1.0]
    box = np.array(sides, np.float32)
    _shade(
        0, len(face), face, ways, place.astype(np.float32), box, 1 - shares, dark, cells, _LINEAR, SRGB_BYTES, picture
    )


@kernel
def _shade(
    begin: int,
    end: int,
    face: NDArray,
    ways: NDArray,
    place: NDArray,
    box: NDArray,
    hidden: NDArray,
    dark: NDArray,
    cells: NDArray,
    linear: NDArray,
    of_linear: NDArray,
    out: NDArray,
) -> None:
    width, last, half = face.shape[1], len(hidden) - 1, np.float32(0.5 * (len(cells) - 1))
    parts, row_step = hidden.reshape(-1), np.uint64(3 * (last + 1))
    one, most, rounded = np.float32(1.0), np.float32(len(of_linear) - 1), np.float32(0.5)
    for y in range(begin, end):
        down = -ways[y, 0, 1]  # of a whole row: cameras stand upright
        if down <= np.float32(0.0):
            continue
        scale = place[2] / down
        for x in range(width):
            u, v = place[0] + scale * ways[y, x, 0], place[1] + scale * ways[y, x, 2]
            if not (box[0] < u < box[1] and box[2] < v < box[3]) or face[y, x] >= 0:
                continue
            away = u * u + v * v
            if not away < one:
                continue
            column, row = cells[int((u + one) * half + rounded)], cells[int((v + one) * half + rounded)]
            left, top = min(int(column), last - 1), min(int(row), last - 1)
            if not dark[top, left]:
                continue
            fade = min(np.float32(4.0) * (one - np.float32(math.sqrt(away))), one)
            right, low = column - np.float32(left), row - np.float32(top)
            low, high = low * fade, (one - low) * fade
            at = np.uint64(3 * (top * (last + 1) + left))  # unsigned: no index counts from the end
            for channel in range(3):
                near, far = at + np.uint64(channel), at + row_step + np.uint64(channel)
                gone = high * (parts[near] * (one - right) + parts[near + np.uint64(3)] * right)
                gone += low * (parts[far] * (one - right) + parts[far + np.uint64(3)] * right)
                light = linear[np.uint64(out[y, x, channel])] * (one - gone)
                out[y, x, channel] = of_linear[np.uint64(light * most + rounded)]
