"""The ground on which an object of a session stands: its shadow, as in `preview.png` but on a coarser grid.

A thread finds once what the object hides. The shadow follows when the light rests, as suns do, and stays while the
camera moves.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.scene.scene import Scene

from ..light.environment import Environment
from ..light.projections import pooled
from ..output.catcher import SIDE as PICTURE_SIDE
from ..output.catcher import Catcher, GroundLight

if TYPE_CHECKING:
    from .lighting import SessionLight

SIDE = PICTURE_SIDE // 2
"""Points of the ground along a side of its square: half of those of pictures."""

_GRID = SIDE // 2, SIDE
"""Rows and columns of a sky that casts shadows: its texels are narrower than a shadow's directions are apart."""


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
        ground = self._catcher.result().under(self._small[1].rotated(angle_deg))
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

    face: (H, W), negative where nothing stands. ways: (H, W, 3) float32, through the pixels, of any length from 1. eye:
    (3,) scene frame.
    """
    free, pixels = np.flatnonzero(face < 0), picture.reshape(-1, 3)
    share = ground.share_seen(eye, ways.reshape(-1, 3)[free])
    dark = (share < 1.0).any(axis=1)
    light = linear_from_srgb(pixels[free[dark]].astype(np.float32) / np.float32(255.0)) * share[dark]
    pixels[free[dark]] = bytes_from_unit(srgb_from_linear(light))
