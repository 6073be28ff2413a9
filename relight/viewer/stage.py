"""The picture behind the panel: the surface in the colours of the session, the captured surface, the sky.

Our own rays find the visible face of each pixel, with and without a graphics card.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.scene import Scene

from ..light.environment import Environment
from ..light.projections import pooled
from ..output.catcher import SIDE as PICTURE_SIDE
from ..output.catcher import Catcher, GroundLight
from ..output.inserted_picture import PictureAsked, with_objects
from ..output.sheet import PAPER, SHADE
from ..sh.normals import unit_normals
from .camera import Orbit
from .quick import display_bytes
from .raster import Raster
from .splats import SplatPainter, coarser, joined

if TYPE_CHECKING:
    from .lighting import SessionLight
    from .session import Session

BACKDROP = np.array([PAPER, SHADE], np.float32)
"""Background of the scene without its sky, bottom and top: sRGB bytes."""

SMOOTH = 2
"""Samples along the side of a pixel at rest: smooth edges."""

RESTING_OBJECT_SAMPLES = 2  # along the side of a pixel

SIDE = PICTURE_SIDE // 2
"""Points of the ground along a side of its square: half of those of pictures."""

_GRID = SIDE // 2, SIDE
"""Rows and columns of a sky that casts shadows: its texels are narrower than a shadow's directions are apart."""


class Stage:
    """A scene as pictures, (H, W, 3) uint8, top row first. ground: that below an object; None in a place."""

    def __init__(self, scene: Scene) -> None:
        self._drawn, self._splats = Drawn(scene), SplatPainter(scene)
        self._raster: Raster | None = None
        self._standing: Any = None  # the objects in it
        self._behind = Raster(np.zeros((0, 3)), np.zeros((0, 3)))
        self._seen: tuple[Orbit, tuple[int, int]] | None = None
        self.ground = None if scene.is_place else StandingGround(scene)

    def picture(
        self, session: "Session", orbit: Orbit, size: tuple[int, int], rests: bool, wait: bool = False
    ) -> NDArray[np.uint8]:
        """The scene of a session: smooth at rest, coarse while the camera moves. wait: for splats to be fitted."""
        seen, self._seen = self._seen, (orbit, size)
        moves = not rests and seen != self._seen
        drawn_size = coarser(size) if moves else size
        if session.splats is not None and session.shows_splats:
            if wait:
                session.splats.wait()
            picture = self._of_splats(session, orbit, drawn_size, rests, moves)
        else:
            picture = self.drawn(session, orbit, drawn_size, rests)
        return np.asarray(Image.fromarray(picture).resize(size, Image.Resampling.BILINEAR)) if moves else picture

    def drawn(self, session: "Session", orbit: Orbit, size: tuple[int, int], rests: bool) -> NDArray[np.uint8]:
        """The picture of surface, objects and sky. rests: with smooth edges, in four times the time."""
        colors, captured, inserted = surface_colors(session), self._drawn.scene.colors_srgb, session.inserted
        shown = self._drawn.values(colors)
        if inserted is not None:
            added = _displayed(session, "objects", inserted.radiance, session.exposure())
            shown, captured = np.concatenate([shown, added]), np.concatenate([captured, added])
        standing = None if inserted is None else inserted.standing
        if self._raster is None or self._standing is not standing:
            self._standing, (vertices, faces) = standing, (self._drawn.scene.vertices, self._drawn.scene.faces)
            if standing is not None:
                faces = np.concatenate([faces, standing.faces + len(vertices)])
                vertices = np.concatenate([vertices, standing.vertices])
            self._raster = Raster(vertices, faces)
        width, height = size
        across = SMOOTH if rests else 1
        self._raster.look(orbit, (across * width, across * height))
        before = (captured, session.state.split_at) if session.state.split else None
        fine: NDArray[np.uint8] = self._raster.paint(shown, before, *self._back(session, rests))
        if not rests:
            return fine
        sums = fine.reshape(height, across, width, across, 3).sum(axis=(1, 3), dtype=np.uint16)
        return ((sums + across**2 // 2) // across**2).astype(np.uint8)

    def _of_splats(
        self, session: "Session", orbit: Orbit, size: tuple[int, int], rests: bool, moves: bool
    ) -> NDArray[np.uint8]:
        """The picture of the splats before the sky: exact at rest."""
        splats, inserted = session.splats, session.inserted
        assert splats is not None
        draw = self._splats.exact if rests or moves else self._splats.again
        self._behind.look(orbit, size)
        back = self._behind.paint(np.zeros((0, 3), np.uint8), None, *self._back(session, rests))
        shown = splats.colored()
        if inserted is not None:
            draw = self._splats.exact  # objects are other splats in each picture
            view, samples = orbit.view(size), RESTING_OBJECT_SAMPLES if rests else 1
            shown = with_objects(shown, inserted, PictureAsked(session.scene, view, session.exposure(), samples))
        picture = draw(shown, orbit, size).over(back)
        if session.state.split:
            before = draw(splats.source.captured, orbit, size).over(back)
            picture = joined(before, picture, session.state.split_at)
        return picture

    def _back(
        self, session: "Session", rests: bool
    ) -> tuple[tuple[NDArray[np.uint8], float] | None, NDArray[np.float32], GroundLight | None]:
        """Sky, backdrop and ground of a picture."""
        light, state = session.answers.light, session.state
        if light is None or not state.sky or state.mode != "relit":
            return None, BACKDROP, None
        sky = _displayed(session, "sky", light.sky, session.sky_exposure())
        ground = None if self.ground is None else self.ground.under(light, state.angle_deg, rests)
        return (sky, state.angle_deg), BACKDROP, ground


def surface_colors(session: "Session") -> NDArray:
    """The colours of the surface in the present mode, (V, 3) uint8 sRGB: the captured ones before the first light."""
    state, captured = session.state, session.scene.colors_srgb
    if session.hand is not None and state.tool == "hand":
        return captured if session.hand.shown is None else session.hand.shown.result
    radiance = session.radiance() if state.mode == "relit" else None
    if radiance is not None:
        shown = display_bytes(radiance, session.exposure())
    elif state.mode == "relit":
        shown = captured
    elif state.mode == "normals":
        shown = bytes_from_unit(0.5 + 0.5 * unit_normals(session.scene.normals))
    else:
        albedo = session.albedos[state.albedo]
        shown = np.full_like(captured, 255) if albedo is None else bytes_from_unit(srgb_from_linear(albedo))
    return shown if session.parts is None or state.tool != "parts" else session.parts.tinted(shown)


def _displayed(session: "Session", name: str, radiance: NDArray, exposure: float) -> NDArray[np.uint8]:
    """The bytes of radiance (..., 3) at an exposure, kept until one of them changes."""

    def compute() -> NDArray[np.uint8]:
        return display_bytes(np.ascontiguousarray(radiance).reshape(-1, 3), exposure).reshape(radiance.shape)

    found: NDArray[np.uint8] = session.remembered(name, exposure, compute, radiance)
    return found


class StandingGround:
    """The ground under a scene that is an object: its shadow, as in `preview.png` but on a coarser grid.

    A thread finds once what the object hides. The shadow follows when the light rests, as suns do, and stays while the
    camera moves.
    """

    def __init__(self, scene: Scene) -> None:
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="ground")
        self._catcher: Future[Catcher] = self._thread.submit(
            lambda: Catcher(scene, RayCaster(scene.vertices, scene.faces), SIDE)
        )
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
