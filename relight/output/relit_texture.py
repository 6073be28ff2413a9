"""relit.glb of a scene that has a texture: the captured texels, without the light of the capture, in the new light."""

import hashlib
import io
import os
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Radiance
from splat2mesh.base.beside import Beside
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.folder import TEXTURED
from splat2mesh.texture.atlas import Atlas, atlas_again
from splat2mesh.texture.fill import filled
from splat2mesh.texture.glb import add_cards, textured_glb

from .lamps_glb import NO_LAMPS, PlacedLamps, add_lamps

if TYPE_CHECKING:
    from splat2mesh.scene.mesh import Mesh
    from splat2mesh.scene.scene import Scene

    from ..engine.appearance import Appearance

BATCH = 1 << 20
"""Texels that are lit at once."""


class RelitTexture:
    """The texture of a scene under one light after another.

    scene: Scene. atlas: Atlas of its drawn surfaces. albedo: (T, 3) float16 linear of its texels.
    """

    def __init__(self, scene: "Scene", atlas: Atlas, albedo: NDArray[np.float16]) -> None:
        self._scene, self._atlas, self._albedo = scene, atlas, albedo
        self._surfaces, self._drawn = Drawn.surfaces(_textured(scene)), Drawn(scene)

    @classmethod
    def of_scene(cls, scene: "Scene", appearance: "Appearance") -> "RelitTexture | None":
        """That of a Scene from a folder with mesh.glb; None without, and where albedo is known of vertices alone."""
        return cls.begun(scene, appearance)()

    @classmethod
    def begun(cls, scene: "Scene", appearance: "Appearance") -> "Callable[[], RelitTexture | None]":
        """The function that returns the same, made beside other work from now on."""
        if appearance.prior is None and appearance.albedo is not appearance.captured:
            return lambda: None
        surfaces = Drawn.surfaces(_textured(scene))
        content = _content(surfaces.scene)
        return Beside(lambda: cls._made(scene, appearance, surfaces, content)).result if content else lambda: None

    @classmethod
    def _made(cls, scene: "Scene", appearance: "Appearance", surfaces: Drawn, content: bytes) -> "RelitTexture":
        from ..albedo import albedo_of

        atlas, colors = _read(surfaces.scene, content)
        albedo = np.empty((len(colors), 3), np.float16)
        for start in range(0, len(colors), BATCH):
            rows = slice(start, start + BATCH)
            found = linear_from_srgb(colors[rows] / np.float32(255.0))
            if appearance.prior is not None and appearance.irradiance is not None:
                irradiance = surfaces.values(appearance.irradiance)
                found = albedo_of(found, atlas.interpolate(irradiance, rows), appearance.prior)
            albedo[rows] = found
        return cls(scene, atlas, albedo)

    @property
    def size(self) -> int:
        """Texels along a side."""
        return self._atlas.size

    def image(self, received: Radiance, exposure: float) -> NDArray[np.uint8]:
        """The picture, (size, size, 3) sRGB, under a light: (V, 3) irradiance over pi, display value per unit."""
        colors, received = np.empty((len(self._albedo), 3), np.uint8), self._surfaces.values(received)
        for start in range(0, len(colors), BATCH):
            rows = slice(start, start + BATCH)
            light = self._atlas.interpolate(received, rows) * np.float32(exposure)
            colors[rows] = bytes_from_unit(srgb_from_linear(np.clip(self._albedo[rows] * light, 0.0, 1.0)))
        return filled(self._atlas.size, self._atlas.texels, colors)

    def write(
        self,
        path: str | os.PathLike[str],
        received: Radiance,
        exposure: float,
        extras: dict,
        placed: PlacedLamps = NO_LAMPS,
        radiance: Radiance | None = None,
    ) -> None:
        """Write the scene in the new light as binary glTF. received: (V, 3) irradiance over pi. extras: of the glTF
        scene, beside `exposure`. radiance: (V, 3) that vertices send out, by which cards are lit; none are written
        without."""
        image, surfaces = self.image(received, exposure), self._surfaces.scene
        file = textured_glb(surfaces, self._atlas, image, len(surfaces.chunks), "relit")
        if radiance is not None:
            shown = radiance * np.float32(exposure)
            add_cards(file, self._drawn.cards_in(shown) + _added(self._scene, shown))
        add_lamps(file, placed)
        file.save(path, {"exposure": float(exposure), **extras})


def _first_new(scene: "Scene") -> int:
    """The number of the first chunk that no texture was made for: of all where nothing was changed."""
    return sum(len(rows) > 0 for rows in scene.left) + len(scene.hull) if scene.left else len(scene.chunks)


def _textured(scene: "Scene") -> "Scene":
    """The Scene whose drawn chunks have a texture: what was added later is a hull."""
    first = _first_new(scene)
    return replace(scene, hull=(*scene.hull, *range(first, len(scene.chunks)))) if scene.left else scene


def _added(scene: "Scene", shown: Radiance) -> "list[tuple[Mesh, Radiance]]":
    """The chunks that were added later, each with what its vertices send out, of (V, 3)."""
    first = _first_new(scene)
    starts = np.cumsum([0, *(len(chunk.vertices) for chunk in scene.chunks)])
    return [
        (chunk, shown[start : start + len(chunk.vertices)])
        for chunk, start in zip(scene.chunks[first:], starts[first:], strict=False)
    ]


def _content(scene: "Scene") -> bytes | None:
    """The file of a scene's texture, or None where its folder has none, or another."""
    digest = scene.statistics.get("texture_sha256")
    if digest is None or scene.path is None or not (scene.path / TEXTURED).is_file():
        return None
    content = (scene.path / TEXTURED).read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        warnings.warn(
            f"{scene.path / TEXTURED} is not as splat2mesh wrote it; relit.glb has the colours of vertices",
            DataWarning,
            stacklevel=3,
        )
        return None
    return content


def _read(scene: "Scene", content: bytes) -> tuple[Atlas, NDArray[np.uint8]]:
    """The Atlas of a scene's chunks and the colours of its texels, (T, 3) uint8, in the file of its texture."""
    import imageio.v3 as iio
    import pygltflib

    document = pygltflib.GLTF2.load_from_bytes(content)
    blob = document.binary_blob()

    def array(accessor: int, kind: str, width: int) -> NDArray:
        entry = document.accessors[accessor]
        view = document.bufferViews[entry.bufferView]
        return np.frombuffer(blob, kind, entry.count * width, view.byteOffset)

    kinds = {5123: "<u2", 5125: "<u4"}
    uv, faces = [], []
    left: Sequence[Any] = scene.left or (None,) * len(scene.chunks)
    for mesh, rows in zip(document.meshes, left, strict=False):
        part = mesh.primitives[0]
        kind = kinds[document.accessors[part.indices].componentType]
        corners = array(part.indices, kind, 1).reshape(-1, 3).astype(np.int32)
        coordinates = array(part.attributes.TEXCOORD_0, "<f4", 2).reshape(-1, 2)
        if rows is not None:
            used, numbers = np.unique(corners[rows], return_inverse=True)
            corners, coordinates = numbers.reshape(-1, 3).astype(np.int32), coordinates[used]
        if len(corners):
            uv.append(coordinates)
            faces.append(corners)
    view = document.bufferViews[document.images[0].bufferView]
    picture = iio.imread(
        io.BytesIO(blob[view.byteOffset : view.byteOffset + view.byteLength]), extension=".jpg", mode="RGB"
    )
    atlas = atlas_again(scene, uv, faces, len(picture))
    return atlas, picture.reshape(-1, 3)[atlas.texels]
