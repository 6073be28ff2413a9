"""The picture of a relit scene: the relit mesh on the ground, before the light, with an inset that shows the light."""

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.threads import in_batches
from splat2mesh.render.rasterize import Rendering, rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.drawn import Drawn
from splat2mesh.splats.splats import Splats
from splat2mesh.views.standpoints import NEAR_DIAGONAL

from ..insert.probe import usual_box
from ..light.tonemap import compress_highlights
from .backdrop import behind
from .catcher import Catcher
from .inset import add_inset
from .kinds import PICTURE_SIZE
from .mesh_files import check_radiance
from .preview import Preview

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene
    from splat2mesh.texture.atlas import Atlas

    from ..light.environment import Environment

PLAIN = 0.62
"""Display value of the background without a known light: no surface is as even."""

HIDDEN = 1e-3
"""Part of what is behind that a pixel of splats may let through unseen: a quarter of a step of a byte."""


class RelitPicture:
    """A camera before a scene. What does not depend on the light is found once.

    The splats, where there are any, are drawn as any viewer draws them, else the mesh, in its texture or by its
    vertices. An object throws its shadow on the ground below it; a place has its own ground. camera, samples: as of
    `Preview`. size: width and height in pixels. indoors: the scene is a closed room: holes in its floor are black, as
    in any viewer, and do not show the ground outside.
    """

    def __init__(
        self,
        scene: "Scene",
        camera: dict | None = None,
        size: tuple[int, int] = PICTURE_SIZE,
        samples: int = 4,
        indoors: bool = False,
    ) -> None:
        self._scene, self._samples, self._indoors = scene, samples, indoors
        self.mesh = Preview(scene, camera, *size, samples)
        self.camera, self.view = self.mesh.camera, self.mesh.view
        self._drawn, self._surfaces = Drawn(scene), Drawn.surfaces(scene)
        self._previews: dict[bool, Preview] = {}

    def of_splats(
        self, splats: Splats, environment: "Environment | None", exposure: float, inset: bool = True
    ) -> NDArray:
        """The picture, (H, W, 3) uint8 sRGB, of splats in the frame that `scene_from_splat` starts from.

        environment: what they were relit with, or None: before plain grey, without an inset. exposure: display value
        per unit of radiance, for what is behind them.
        """
        seen = self.seen(splats)
        image = np.clip(seen.color, 0.0, 1.0)
        through = seen.alpha < 1.0 - HIDDEN
        image[through] += (1.0 - seen.alpha[through, None]) * self._behind(environment, exposure, through)[through]
        return self._finished(image, environment, exposure, inset)

    def seen(self, splats: Splats) -> Rendering:
        """The Rendering of splats in the frame that `scene_from_splat` starts from, before nothing."""
        frame = np.asarray(self._scene.scene_from_splat, np.float64)
        return rasterize(splats, *in_frame(self.view, frame, NEAR_DIAGONAL * self._scene.diagonal))

    def of_vertices(
        self, radiance: NDArray, environment: "Environment | None", exposure: float, inset: bool = True
    ) -> NDArray:
        """The same of the mesh: radiance (V, 3), linear."""
        layer = self._preview(True).layer(self._drawn.colors(check_radiance(self._scene, radiance)), exposure)
        return self._of_layer(*layer, environment, exposure, inset)

    def of_texture(self, atlas: "Atlas", image: NDArray, environment: "Environment | None", exposure: float) -> NDArray:
        """The same of the mesh in a texture: image (size, size, 3) uint8 sRGB, in the light of the environment."""
        return self._of_layer(*self._preview(False).texture_layer(atlas, image), environment, exposure, True)

    def _preview(self, cards: bool) -> Preview:
        """The Preview of what is drawn of the mesh, with or without cards."""
        shown = (self._drawn if cards else self._surfaces).scene
        if shown is self._scene:
            return self.mesh
        if cards not in self._previews:
            view, samples = self.view, self._samples
            self._previews[cards] = Preview(shown, self.camera, view.width, view.height, samples)
        return self._previews[cards]

    def _of_layer(
        self, color: NDArray, alpha: NDArray, environment: "Environment | None", exposure: float, inset: bool
    ) -> NDArray[np.uint8]:
        image = srgb_from_linear(color)
        if not alpha.all():
            image = _over(color, alpha, self._behind(environment, exposure, alpha < 1.0))
        return self._finished(image, environment, exposure, inset)

    def _finished(
        self, image: NDArray, environment: "Environment | None", exposure: float, inset: bool
    ) -> NDArray[np.uint8]:
        image = np.ascontiguousarray(image, np.float32)
        if inset and environment is not None:
            add_inset(image, self.view, environment, exposure)
        return bytes_from_unit(image)

    def _behind(
        self, environment: "Environment | None", exposure: float, wanted: NDArray[np.bool_]
    ) -> NDArray[np.float32]:
        """Display values, (H, W, 3) float32 sRGB, of the light and of the ground, without the scene.

        wanted: (H, W) bool, the requested pixels; the others are black.
        """
        image = np.zeros((*wanted.shape, 3), np.float32)
        if environment is None:
            image[wanted] = PLAIN
            return image
        if self._indoors:
            wanted = wanted & ~self._through_floor(wanted)
        shadows = None if self._catcher is None else self._catcher.under(environment)
        rows, columns = np.nonzero(wanted)

        def work(part: slice) -> None:
            directions = self._toward(rows[part], columns[part])
            shown = behind(environment, directions, exposure)
            if shadows is not None:
                shown *= shadows.share_seen(self.view.center, directions)
            image[rows[part], columns[part]] = srgb_from_linear(compress_highlights(shown))

        if len(rows):
            work(slice(1))  # what is found once, by one thread
            in_batches(work, len(rows))
        return image

    def _toward(self, rows: NDArray, columns: NDArray) -> NDArray[np.float32]:
        """Unit directions (N, 3) float32 through the middles of N pixels."""
        view = self.view
        x, y = (columns + 0.5 - view.cx) / view.fx, (rows + 0.5 - view.cy) / view.fy
        seen = np.stack([x, y, np.ones_like(x)], axis=-1)
        seen /= np.linalg.norm(seen, axis=1, keepdims=True)
        return (seen @ view.camera_from_world[:3, :3]).astype(np.float32)

    def _through_floor(self, wanted: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(H, W) bool, which of some pixels look through the floor between the walls of a room."""
        low, high = usual_box(self._scene)
        rows, columns = np.nonzero(wanted)
        directions, eye = self._toward(rows, columns), self.view.center
        down = np.maximum(-directions[:, 1], 1e-6)
        met = eye + directions * np.maximum((eye[1] - low[1]) / down, 0.0)[:, None]
        through = np.zeros(wanted.shape, bool)
        through[wanted] = ((met > low) & (met < high))[:, [0, 2]].all(axis=1) & (directions[:, 1] < 0.0)
        return through

    @cached_property
    def _catcher(self) -> Catcher | None:
        """The ground; None for a place, which has its own."""
        return None if self._scene.is_place else Catcher(self._scene, self.mesh.caster)


def _over(color: NDArray, alpha: NDArray, back: NDArray) -> NDArray:
    """A layer of linear light, premultiplied, over display values: what covers a part of a pixel mixes with them."""
    alpha = alpha[..., None]
    own = np.divide(color, alpha, out=np.zeros_like(color), where=alpha > 0.0)
    return srgb_from_linear(own) * alpha + back * (1.0 - alpha)


def in_frame(view: View, scene_from_other: NDArray, near: float = 0.0) -> tuple[View, float]:
    """A View of the scene, and a distance, in another frame that a similarity (4, 4) leads from: the picture is the
    same, since all grows alike from the eye on."""
    matrix = view.camera_from_world @ scene_from_other
    scale = float(np.cbrt(abs(np.linalg.det(scene_from_other[:3, :3]))))
    return replace(view, camera_from_world=np.concatenate([matrix[:3] / scale, matrix[3:]])), near / scale
