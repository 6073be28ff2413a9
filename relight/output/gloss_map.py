"""Roughness per vertex for glTF, which stores it only in textures.

One small picture holds every value, rising along its columns. The texture coordinates of a vertex are its value, so a
renderer interpolates the value itself.
"""

from typing import Any

import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from splat2mesh.scene.glb import Glb, matt_white

from .images import png_bytes

_STEPS = np.iinfo(np.uint8).max + 1


def glossy_white(file: Glb) -> Any:
    """Add the picture to a file: a white material that shines as the texture coordinates of its vertices say."""
    picture = np.zeros((1, _STEPS, 3), np.uint8)
    picture[:, :, 0], picture[:, :, 1] = 255, np.arange(_STEPS)
    view = file.data(png_bytes(picture))
    file.document.images.append(gltf.Image(bufferView=view, mimeType="image/png", name="gloss"))
    file.document.samplers.append(
        gltf.Sampler(magFilter=gltf.LINEAR, minFilter=gltf.LINEAR, wrapS=gltf.CLAMP_TO_EDGE, wrapT=gltf.CLAMP_TO_EDGE)
    )
    texture = gltf.Texture(sampler=len(file.document.samplers) - 1, source=len(file.document.images) - 1)
    file.document.textures.append(texture)
    material = matt_white()
    material.pbrMetallicRoughness.metallicRoughnessTexture = gltf.TextureInfo(index=len(file.document.textures) - 1)
    return material


def coordinates(roughness: NDArray[np.float32]) -> NDArray[np.float32]:
    """Texture coordinates (V, 2) of a roughness (V,) in [0, 1]."""
    across = (np.clip(np.asarray(roughness, np.float64), 0.0, 1.0) * (_STEPS - 1) + 0.5) / _STEPS
    return np.stack([across, np.full(len(across), 0.5)], axis=1).astype(np.float32)
