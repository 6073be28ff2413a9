"""Textured scenes as binary glTF: a mesh for each chunk, one material, the picture inside."""

import io
from collections.abc import Sequence
from typing import Any

import imageio.v3 as iio
import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from ..scene.color import linear_from_srgb
from ..scene.glb import UNLIT, Glb, matt
from ..scene.mesh import Mesh
from ..scene.scene import Scene
from .atlas import Atlas
from .texture import Texture

PNG = b"\x89PNG"
"""Bytes that a PNG begins with."""

QUALITY = 95
"""Quality of the JPEG, with colours as fine as brightness. A PNG of the same picture is four times as large."""


def textured_glb(
    scene: Scene,
    atlas: Atlas,
    pictures: Sequence[bytes],  # JPEG or PNG of (size, size, 3) sRGB; also of roughness in green, metalness in blue
    chunks: int,  # the first chunks of `scene` that are drawn under their numbers; those after them are background
    material: str = "captured",
    unlit: bool = True,  # shown as it is; False: lit by the viewer, as a matt surface
) -> Glb:
    """Make the file of a scene in its texture, double-sided.

    Vertices stand in the order of the atlas; on seams of the texture there are several of one scene vertex. Where the
    scene has fewer chunks than the atlas, the others are left out.
    """
    surface = gltf.PbrMetallicRoughness(
        baseColorTexture=gltf.TextureInfo(index=0), metallicFactor=float(len(pictures) > 1), roughnessFactor=1.0
    )
    if len(pictures) > 1:
        surface.metallicRoughnessTexture = gltf.TextureInfo(index=1)
    flat: dict[str, Any] = {UNLIT: {}} if unlit else {}
    file = Glb(
        extensionsUsed=list(flat),
        materials=[gltf.Material(name=material, pbrMetallicRoughness=surface, doubleSided=True, extensions=flat)],
        samplers=[
            gltf.Sampler(
                magFilter=gltf.LINEAR,
                minFilter=gltf.LINEAR_MIPMAP_LINEAR,
                wrapS=gltf.CLAMP_TO_EDGE,
                wrapT=gltf.CLAMP_TO_EDGE,
            )
        ],
        textures=[gltf.Texture(sampler=0, source=source) for source in range(len(pictures))],
    )
    normals, first = _unit(scene.normals), 0
    for number, (chunk, used) in enumerate(zip(scene.chunks, atlas.chunks, strict=False)):
        rows, faces = atlas.vertex[used.start : used.stop], atlas.faces[first : first + len(chunk.faces)] - used.start
        first += len(chunk.faces)
        attributes = {
            "POSITION": file.positions(scene.vertices[rows]),
            "NORMAL": file.values(normals[rows]),
            "TEXCOORD_0": file.values(atlas.uv[used.start : used.stop]),
        }
        name = f"chunk_{number:04d}" if number < chunks else f"background_{number - chunks:04d}"
        file.mesh(name, attributes, indices=file.indices(faces, len(rows)), material=0)
    file.document.images = [
        gltf.Image(bufferView=file.data(each), mimeType=f"image/{'png' if each[:4] == PNG else 'jpeg'}", name=name)
        for name, each in zip(("color", "gloss"), pictures, strict=False)
    ]
    return file


def add_cards(file: Glb, cards: Sequence[tuple[Mesh, NDArray[np.float32]]], unlit: bool = True) -> None:
    """Add cards of leaves to a file: meshes with COLOR_0 and a double-sided material without a texture. cards: Mesh and
    (V, 3) linear colours of its vertices. unlit: as of the rest of the file."""
    if not cards:
        return
    materials = file.document.materials
    materials.append(matt("cards", unlit))
    for number, (mesh, colors) in enumerate(cards):
        attributes = {
            "POSITION": file.positions(mesh.vertices),
            "NORMAL": file.values(_unit(mesh.normals)),
            "COLOR_0": file.values(np.clip(colors, 0.0, 1.0).astype(np.float32)),
        }
        indices = file.indices(mesh.faces, len(mesh.vertices))
        file.mesh(f"cards_{number:04d}", attributes, indices=indices, material=len(materials) - 1)


def mesh_glb(texture: Texture, chunks: int, extras: dict[str, Any], cards: Sequence[Mesh] = ()) -> bytes:
    """Return mesh.glb of a Texture, with cards beside it. chunks: as of `textured_glb`. extras: of the glTF scene."""
    atlas = texture.atlas
    image = atlas.image(texture.colors)
    file = textured_glb(texture.scene, atlas, [jpeg_bytes(image)], chunks)
    bytes_per_unit = np.float32(255.0)
    add_cards(file, [(each, linear_from_srgb(each.colors_srgb.astype(np.float32) / bytes_per_unit)) for each in cards])
    return file.content(extras)


def jpeg_bytes(image: NDArray[np.uint8]) -> bytes:
    """Return a picture (H, W, 3) as JPEG."""
    file = io.BytesIO()
    iio.imwrite(file, image, extension=".jpg", quality=QUALITY, subsampling=0)
    return file.getvalue()


def _unit(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Normals of unit length, as glTF demands; +y where there is none."""
    length = np.linalg.norm(normals.astype(np.float64), axis=1, keepdims=True)
    unit = np.where(length > 1e-12, normals / np.maximum(length, 1e-12), [0.0, 1.0, 0.0])
    return unit.astype(np.float32)
