"""inserted.glb: the inserted objects in their light, with the materials and pictures of their files.

The light is in COLOR_0, which multiplies the picture of a material; materials are unlit, so no viewer lights them
again. Values above 1 are clipped, as in `relit.glb`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from splat2mesh.base.gltf import GltfData
from splat2mesh.scene.glb import UNLIT, Glb
from splat2mesh.scene.gltftextures import Textures, base_color

from ..insert.objects import Part

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight


KEPT = "name", "alphaMode", "alphaCutoff", "doubleSided"
"""Fields of a material that stay as they are."""


def inserted_glb(inserted: "InsertedLight", exposure: float) -> bytes:
    """The file of the meshes of an InsertedLight, in the frame of `relit.glb`; empty without any.

    exposure: display value per unit of radiance."""
    standing, clipped, first = inserted.standing, 0, 0
    if all(each.splat is not None for each in standing.objects):
        return b""
    file = Glb(extensionsUsed=[UNLIT], materials=[], textures=[], images=[], samplers=[])
    for number, each in enumerate(standing.objects):
        if each.splat is not None:
            first += len(each.joined("vertices"))
            continue
        materials = _Materials(file, each.document)
        for part in each.parts:
            rows = slice(first, first + len(part.vertices))
            first = rows.stop
            if not len(part.faces):  # cut away
                continue
            color = _shown(part, inserted.light[rows], exposure)
            clipped += int((color[:, :3] > 1.0).any(axis=1).sum())
            attributes = {
                "POSITION": file.positions(standing.vertices[rows]),
                "NORMAL": file.values(standing.normals[rows]),
                "COLOR_0": file.values(np.clip(color, 0.0, 1.0).astype(np.float32)),
            }
            if part.uv is not None:
                attributes["TEXCOORD_0"] = file.values(part.uv)
            indices = file.indices(part.faces, len(part.vertices))
            file.mesh(f"{number + 1} {each.name}", attributes, indices=indices, material=materials.of(part))
    if not file.document.images:
        file.document.textures, file.document.samplers = [], []
    return file.content({"exposure": float(exposure), "clipped_vertices": clipped})


def _shown(part: Part, light: NDArray[np.float32], exposure: float) -> NDArray[np.float32]:
    """COLOR_0 (V, 4), linear: the factor on the texture; without a texture, the exit radiance."""
    color = np.ones((len(light), 4), np.float32)
    color[:, 3] = part.color[:, 3]
    if part.uv is None:
        color[:, :3] = part.albedo * light + part.emission
    else:
        color[:, :3] = part.color[:, :3] * light
    color[:, :3] *= np.float32(exposure)
    return color


class _Materials:
    """The materials of one object in a new file, each once, with the pictures they show."""

    def __init__(self, file: Glb, document: GltfData | None) -> None:
        self._file, self._data = file, document
        self._known: dict[tuple[int | None, bool], int] = {}
        self._textures: dict[int, int] = {}
        self._pictures = None if document is None else Textures(document)

    def of(self, part: Part) -> int:
        """Index of the material of a Part."""
        key = part.material, part.uv is not None
        if key not in self._known:
            self._file.document.materials.append(self._made(part))
            self._known[key] = len(self._file.document.materials) - 1
        return self._known[key]

    def _made(self, part: Part) -> Any:
        surface = gltf.PbrMetallicRoughness(baseColorFactor=[1.0] * 4, metallicFactor=0.0, roughnessFactor=1.0)
        made = gltf.Material(name="inserted", pbrMetallicRoughness=surface, extensions={UNLIT: {}})
        if self._data is None or part.material is None:
            made.doubleSided = True
            return made
        source = self._data.document.materials[part.material]
        for name in KEPT:
            if getattr(source, name) is not None:
                setattr(made, name, getattr(source, name))
        _, texture = base_color(source)
        if part.uv is not None and texture:
            surface.baseColorTexture = gltf.TextureInfo(index=self._texture(texture["index"]))
        return made

    def _texture(self, index: int) -> int:
        if index in self._textures:
            return self._textures[index]
        assert self._data is not None and self._pictures is not None  # of a part with a picture
        document, made = self._data.document, self._file.document
        texture = document.textures[index]
        content = self._pictures.encoded(index)
        kind = "image/png" if content[:4] == b"\x89PNG" else "image/jpeg"
        made.images.append(gltf.Image(bufferView=self._file.data(content), mimeType=kind))
        sampler = None
        if texture.sampler is not None:
            given = document.samplers[texture.sampler]
            fields = ("magFilter", "minFilter", "wrapS", "wrapT")
            made.samplers.append(gltf.Sampler(**{name: getattr(given, name) for name in fields}))
            sampler = len(made.samplers) - 1
        made.textures.append(gltf.Texture(source=len(made.images) - 1, sampler=sampler))
        self._textures[index] = len(made.textures) - 1
        return self._textures[index]
