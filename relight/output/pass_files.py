"""Render passes: an OpenEXR file for each camera with albedo, light by its path, normals and depth of the mesh.

The light that surfaces receive is stored per pixel as the factor from albedo to picture: pi times the light they send
out by that path, over the albedo. So all passes together give the picture in any colour space, on edges too.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.view import View
from splat2mesh.scene.scene import Scene

from ..light.color_spaces import SPACES, converted
from .kinds import FILES, SUN
from .preview import Preview
from .probe_files import write_exr

if TYPE_CHECKING:
    from ..engine.relighter import Shaded

FOLDER = "passes"
"""Names of files with several cameras."""

BLACK = 1e-6
"""Albedo, premultiplied, below which a pixel does not show light."""

LightParts = Mapping[str, NDArray[np.float32]]


class PassFiles:
    """Writes the passes of a scene, light after light.

    albedo: returns (V, 3) linear, or None for white. parts: of a Shaded, what vertices send out, (V, 3), by the way
    that its light came: those but `SUN`, which is a part of another, are all of it. views: returns those to render,
    frame of the scene; None is the preview's. space: a key of SPACES.
    """

    def __init__(
        self,
        scene: Scene,
        albedo: Callable[[], NDArray[np.float32] | None],
        parts: "Callable[[Shaded], LightParts]",
        views: Callable[[], Sequence[View] | None],
        space: str = "srgb",
    ) -> None:
        self._scene, self._albedo, self._parts, self._views = scene, albedo, parts, views
        self._space = SPACES[space]

    def write(self, folder: Path, shaded: "Shaded", size: tuple[int, int]) -> list[str]:
        """Write them into a folder: names of the files. size: of the preview, in pixels."""
        parts = {name: part * np.float32(shaded.exposure) for name, part in self._parts(shaded).items()}
        names = []
        header = {"chromaticities": self._space.chromaticities}
        pictures = self._pictures(size)
        if len(pictures) > 1:
            (folder / FOLDER).mkdir(exist_ok=True)
        for number, picture in enumerate(pictures, 1):
            names.append(FILES["passes"] if len(pictures) == 1 else f"{FOLDER}/{number:04d}.exr")
            write_exr(folder / names[-1], self.channels(picture, parts), header)
        return names

    def _pictures(self, size: tuple[int, int]) -> list[Preview]:
        first = Preview(self._scene, None, *size)
        views = self._known_views
        return [first] if views is None else [first.at(view) for view in views]

    @cached_property
    def _known_views(self) -> list[View] | None:
        views = self._views()
        return None if views is None else list(views)

    def channels(self, picture: Preview, parts: LightParts) -> dict[str, NDArray[np.float32]]:
        """The channels of a file, (H, W) float32 by name. parts: as shown, exposed."""
        own = self._albedo()
        albedo, alpha = picture.values(np.ones_like(self._scene.vertices) if own is None else own)
        albedo = converted(albedo, self._space)
        sent = {name: converted(picture.values(part)[0], self._space) for name, part in parts.items()}
        beauty = np.sum([each for name, each in sent.items() if name != SUN], axis=0)
        received = {"irradiance": beauty, **sent}
        normals = picture.values(self._scene.normals)[0]
        length = np.linalg.norm(normals, axis=2, keepdims=True)
        normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0.0)
        found = {"R": beauty[..., 0], "G": beauty[..., 1], "B": beauty[..., 2], "A": alpha, "Z": picture.depth()}
        found |= _layer("albedo", albedo, "RGB") | _layer("normals", normals, "XYZ")
        for name, each in received.items():
            light = np.divide(np.pi * each, albedo, out=np.zeros_like(each), where=albedo > BLACK)
            found |= _layer(name, light, "RGB")
        return found


def _layer(name: str, image: NDArray[np.float32], letters: str) -> dict[str, NDArray[np.float32]]:
    return {f"{name}.{letter}": image[..., channel] for channel, letter in enumerate(letters)}
