"""The picture behind the panel: the surface in the colours of the session, the captured surface, the sky.

Our own rays find the visible face of each pixel, with and without a graphics card.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.scene import Scene

from ..light.environment import Environment
from ..light.pooling import pooled
from ..output.catcher import SIDE as PICTURE_SIDE
from ..output.catcher import Catcher, GroundLight
from ..output.sheet import PAPER, SHADE
from .camera import Orbit
from .quick import display_bytes
from .raster import Raster
from .splat_painter import SplatPainter

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight
    from .lighting import SessionLight

BACKDROP = np.array([PAPER, SHADE], np.float32)
"""Background of the scene without its sky, bottom and top: sRGB bytes."""

SMOOTH = 2
"""Samples along the side of a pixel at rest: smooth edges."""

SIDE = PICTURE_SIDE // 2
"""Points of the ground along a side of its square: half of those of pictures."""

_GRID = SIDE // 2, SIDE
"""Rows and columns of a sky that casts shadows: its texels are narrower than a shadow's directions are apart."""


class Stage:
    """Surface and sky as pictures, (H, W, 3) uint8, top row first.

    ground: the light on the ground below an object, which shows before the sky; None without.
    """

    def __init__(self, scene: Scene) -> None:
        self._drawn = Drawn(scene)
        self._captured: NDArray[np.uint8] = self._drawn.scene.colors_srgb
        self._shown: NDArray[np.generic] = self._captured
        self._objects: tuple[InsertedLight, float, NDArray[np.uint8]] | None = None
        self._sky: NDArray[np.uint8] | None = None
        self.ground: GroundLight | None = None
        self._raster: Raster | None = None
        self._behind = Raster(np.zeros((0, 3)), np.zeros((0, 3)))
        self.splats = SplatPainter(scene)

    def color(self, colors: NDArray) -> None:
        """Show the surface in these sRGB bytes, (V, 3) uint8; cards of leaves take those of the hull around them."""
        self._shown = self._drawn.values(colors)

    def show_objects(self, inserted: "InsertedLight | None", exposure: float | None) -> None:
        """Show objects beside the surface, at an exposure; None for none."""
        if inserted is None or exposure is None:
            return
        known = self._objects
        if known is not None and known[0] is inserted and known[1] == exposure:
            return
        if known is None or known[0].standing is not inserted.standing:
            self._raster = None  # of other triangles
        self._objects = inserted, exposure, display_bytes(inserted.radiance, exposure)

    def paint_sky(self, sky: NDArray, exposure: float) -> None:
        """Take the sky, (H, W, 3) linear in canonical lat-long, unrotated."""
        self._sky = display_bytes(np.ascontiguousarray(sky).reshape(-1, 3), exposure).reshape(sky.shape)

    def drawn(
        self,
        orbit: Orbit,
        size: tuple[int, int],
        split: float | None = None,
        angle_deg: float | None = None,
        smooth: bool = False,
    ) -> NDArray[np.uint8]:
        """The picture of surface, objects and sky.

        split: place of the split line, left of which the surface is as captured, or None. angle_deg: of the sky; None
        for the plain backdrop. smooth: with smooth edges, in four times the time.
        """
        if smooth:
            width, height = size
            fine = self.drawn(orbit, (SMOOTH * width, SMOOTH * height), split, angle_deg)
            sums = fine.reshape(height, SMOOTH, width, SMOOTH, 3).sum(axis=(1, 3), dtype=np.uint16)
            return ((sums + SMOOTH**2 // 2) // SMOOTH**2).astype(np.uint8)
        scene, objects = self._drawn.scene, self._objects
        vertices, faces, shown, before = scene.vertices, scene.faces, self._shown, self._captured
        if objects is not None:
            standing = objects[0].standing
            vertices = np.concatenate([vertices, standing.vertices])
            faces = np.concatenate([faces, standing.faces + len(scene.vertices)])
            shown, before = np.concatenate([shown, objects[2]]), np.concatenate([before, objects[2]])
        if self._raster is None:
            self._raster = Raster(vertices, faces)
        self._raster.look(orbit, size)
        captured = None if split is None else (before, split)
        return self._raster.paint(shown, captured, *self._back(angle_deg))

    def behind(self, orbit: Orbit, size: tuple[int, int], angle_deg: float | None = None) -> NDArray[np.uint8]:
        """The background of the scene: the sky at an angle, or without."""
        self._behind.look(orbit, size)
        return self._behind.paint(np.zeros((0, 3), np.uint8), None, *self._back(angle_deg))

    def _back(
        self, angle_deg: float | None
    ) -> tuple[tuple[NDArray[np.uint8], float] | None, NDArray[np.float32], GroundLight | None]:
        """Sky, backdrop and ground of a picture."""
        sky = None if angle_deg is None or self._sky is None else (self._sky, angle_deg)
        return sky, BACKDROP, None if sky is None else self.ground


class StandingGround:
    """The ground under a scene that is an object: its shadow, as in `preview.png` but on a coarser grid.

    A thread finds once what the object hides. The shadow follows when the light rests, as suns do, and stays while the
    camera moves.
    """

    def __init__(self, scene: Scene) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="ground")
        caster = RayCaster(scene.vertices, scene.faces)
        self._catcher: Future[Catcher] = self._thread.submit(Catcher, scene, caster, SIDE)
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
        small = Environment(pooled(light.sky, _GRID).astype(np.float32), "")
        ground = self._catcher.result().under(small.rotated(angle_deg))
        self._shown = light, angle_deg, ground
        return ground

    def wait(self) -> None:
        """Wait until it is ready."""
        self._catcher.exception()

    def close(self) -> None:
        """End the thread."""
        self._thread.shutdown(wait=False, cancel_futures=True)
