"""The texture of a scene as its folder holds it, in mesh.glb, for all that is drawn and has a texture."""

import hashlib
import io
import warnings
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import imageio.v3 as iio
import numpy as np
import pygltflib
from numpy.typing import NDArray

from ..base.arrays import ColorsSrgb, Floats
from ..base.errors import DataWarning
from ..base.gltf import COMPONENTS
from ..scene.drawn import Drawn
from ..scene.folder import TEXTURED
from ..scene.mesh import Mesh
from ..scene.scene import Scene
from .atlas import Atlas, atlas_again


def textured_part(scene: Scene) -> Drawn:
    """The Drawn surfaces of a Scene that have a texture: no cards, and no chunk that was added after it was made."""
    first = _first_new(scene)
    if scene.left:
        scene = replace(scene, hull=(*scene.hull, *range(first, len(scene.chunks))))
    return Drawn.surfaces(scene)


def added_part(scene: Scene, of_vertices: Floats) -> list[tuple[Mesh, Floats]]:
    """The chunks that were added after the texture was made, each with its rows of some values (V, C) of vertices."""
    first = _first_new(scene)
    starts = np.cumsum([0, *(len(chunk.vertices) for chunk in scene.chunks)])
    return [
        (chunk, of_vertices[start : start + len(chunk.vertices)])
        for chunk, start in zip(scene.chunks[first:], starts[first:], strict=False)
    ]


def kept_file(scene: Scene) -> bytes | None:
    """mesh.glb of a scene's folder; None where there is none and, with a warning, if `splat2mesh` did not write it."""
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


def kept_texture(part: Drawn, content: bytes) -> tuple[Atlas, ColorsSrgb]:
    """The Atlas of a scene's `textured_part` and the colours of its texels, (T, 3) uint8, from bytes of mesh.glb."""
    document = pygltflib.GLTF2.load_from_bytes(content)
    blob = document.binary_blob()

    def array(accessor: int, kind: str, width: int) -> NDArray:
        entry = document.accessors[accessor]
        view = document.bufferViews[entry.bufferView]
        return np.frombuffer(blob, kind, entry.count * width, view.byteOffset)

    uv, faces = [], []
    scene = part.scene
    left: Sequence[Any] = scene.left or (None,) * len(scene.chunks)
    for mesh, rows in zip(document.meshes, left, strict=False):
        drawn = mesh.primitives[0]
        kind = COMPONENTS[document.accessors[drawn.indices].componentType]
        corners = array(drawn.indices, kind, 1).reshape(-1, 3).astype(np.int32)
        coordinates = array(drawn.attributes.TEXCOORD_0, "<f4", 2).reshape(-1, 2)
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


def _first_new(scene: Scene) -> int:
    """The number of the first chunk that no texture was made for: of all where nothing was changed."""
    return sum(len(rows) > 0 for rows in scene.left) + len(scene.hull) if scene.left else len(scene.chunks)
