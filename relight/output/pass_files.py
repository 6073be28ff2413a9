"""Render passes: an OpenEXR file for each camera with albedo, light by its path, normals and depth of the mesh.

The light that surfaces receive is stored per pixel as the factor from albedo to picture: pi times the light they send
out by that path, over the albedo. So all passes together give the picture in any colour space, on edges too.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import BLACK

from ..light.color_spaces import SPACES, converted
from .images import write_exr
from .kinds import FILES, PICTURE_SIZE, SUN
from .preview import Preview
from .subject import LightParts, LitFolder, WrittenScene

FOLDER = "passes"
"""Names of files with several cameras."""


class PassFiles:
    """Writes the passes of a scene, light after light."""

    def __init__(self, written: WrittenScene, _: object) -> None:
        self._written, self._scene, self._space = written, written.scene, SPACES[written.asked.color_space]

    def write(self, into: LitFolder) -> list[str]:
        """Write them; returns the names of the files."""
        assert self._written.light_parts is not None
        with self._written.stages.stage("passes"):
            exposure = np.float32(into.shaded.exposure)
            parts = {name: part * exposure for name, part in self._written.light_parts(into.shaded).items()}
            names, header = [], {"chromaticities": self._space.chromaticities}
            pictures = self._pictures()
            if len(pictures) > 1:
                (into.path / FOLDER).mkdir(exist_ok=True)
            for number, picture in enumerate(pictures, 1):
                names.append(FILES["passes"] if len(pictures) == 1 else f"{FOLDER}/{number:04d}.exr")
                write_exr(into.path / names[-1], self.channels(picture, parts), header)
            return names

    def _pictures(self) -> list[Preview]:
        first, views = Preview(self._scene, None, *PICTURE_SIZE), self._written.pass_views()
        return [first] if views is None else [first.at(view) for view in views]

    def channels(self, picture: Preview, parts: LightParts) -> dict[str, NDArray[np.float32]]:
        """The channels of a file, (H, W) float32 by name. parts: as shown, exposed."""
        albedo, alpha = picture.values(self._written.albedo)
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
