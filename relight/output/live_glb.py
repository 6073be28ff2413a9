"""Meshes for engines that light them: with albedo and transfer at their vertices, and as the proxy of a splat.

docs/engines.md describes the format of live light; the loaders are in integrations/. glTF stores roughness only in
textures: one small picture holds every value, rising along its columns. The texture coordinates of a vertex are its
value, so a renderer interpolates the value itself.
"""

import os
from typing import TYPE_CHECKING, Any

import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.glb import Glb, matt_white

from ..sh.normals import unit_normals
from ..transfer import FEW_BANDS
from .images import png_bytes
from .lamps_glb import ShownLight, add_lamps

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

FILE = "live.glb"

FORMAT_VERSION = 1

KEY = "relight_live"
"""Keys of the glTF scene's `extras` that the loaders need."""

SNORM = np.iinfo(np.int16).max
"""Scale of 16-bit normalised integers: value = max(integer / 32767, -1)."""

PLAYCANVAS_FROM_SPLAT = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Rz(180): PlayCanvas and the SuperSplat viewer show every splat file turned so, and look for `NAME.collision.glb` in
that frame."""

_STEPS = np.iinfo(np.uint8).max + 1


def write_live_glb(
    path: str | os.PathLike[str],
    scene: "Scene",
    albedo: NDArray[np.float32] | None,  # (V, 3) linear, None for white
    nine: tuple[NDArray[np.float32], NDArray[np.float32]],  # grey (V, 9) and tint (V, 3), as of `nine_coefficients`
    lit: ShownLight,  # turned as the loaders start
    roughness: NDArray[np.float32] | None = None,  # (V,), as glTF has it; matt without
) -> None:
    """Write binary glTF 2.0: a mesh per chunk with COLOR_0, _TRANSFER_0 to _TRANSFER_2, and the same as _CUSTOM0 to 2.

    COLOR_0 is linear float32 albedo. The twelve normalised 16-bit integers of the transfer are grey 0-3, 4-7, and 8
    with the tint. `extras` hold nine radiance coefficients of the light, not turned, its angle, and the exposure.
    Where something is glossy the roughness is a texture, for engines that light the mesh themselves.
    Placed lamps are KHR_lights_punctual, for what else is lit: the transfer knows the environment alone.
    """
    drawn, count = Drawn(scene), len(scene.vertices)
    albedo = drawn.colors(np.ones((count, 3), np.float32) if albedo is None else albedo)
    albedo = np.clip(albedo, 0.0, 1.0).astype(np.float32)
    scene, nine = drawn.scene, (drawn.values(nine[0]), drawn.values(nine[1]))
    roughness = None if roughness is None else drawn.values(roughness)
    packed = np.rint(np.clip(np.hstack(nine), -1.0, 1.0) * SNORM).astype(np.int16)
    file, start = Glb(), 0
    file.document.materials = [_white(file, roughness)]
    uv = None if roughness is None else _coordinates(roughness)
    normals = unit_normals(scene.normals)
    for index, chunk in enumerate(scene.chunks):
        rows = slice(start, start + len(chunk.vertices))
        start = rows.stop
        attributes = {
            "POSITION": file.positions(chunk.vertices),
            "NORMAL": file.values(normals[rows]),
            "COLOR_0": file.values(albedo[rows]),
        }
        if uv is not None:
            attributes["TEXCOORD_0"] = file.values(uv[rows])
        for part in range(3):
            accessor = file.values(packed[rows, 4 * part : 4 * part + 4], normalized=True)
            attributes |= {f"_TRANSFER_{part}": accessor, f"_CUSTOM{part}": accessor}
        faces = file.indices(chunk.faces, len(chunk.vertices))
        file.mesh(f"chunk_{index:04d}", attributes, indices=faces, material=0)
    add_lamps(file, lit.placed)
    sh = [[float(value) for value in row] for row in lit.light.rotated(-lit.light.rotation_deg).sh(3)]
    light = {"name": lit.light.name, "angle_deg": lit.light.rotation_deg, "sh": sh}
    facts = {"version": FORMAT_VERSION, "coefficients": FEW_BANDS**2, "exposure": float(lit.exposure)}
    file.save(path, {KEY: {**facts, "light": light}})


def write_proxy_glb(
    path: str | os.PathLike[str],
    scene: "Scene",
    matrix: NDArray[np.float64] | None = None,  # (4, 4) rigid or similar, file_from_scene; the scene frame without
    albedo: NDArray[np.float32] | None = None,  # (V, 3) linear
    roughness: NDArray[np.float32] | None = None,  # (V,), as glTF has it; matt without
) -> None:
    """Write the whole scene as binary glTF 2.0: one mesh, one primitive, its vertices in the order of the scene.

    With an albedo it has NORMAL, COLOR_0 and a white material, matt or with a texture of roughness, so an engine can
    light it; without, positions and triangles alone, as for collisions.
    """
    matrix = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
    file = Glb()
    file.document.materials = [] if albedo is None else [_white(file, roughness)]
    attributes = {"POSITION": file.positions(scene.vertices @ matrix[:3, :3].T + matrix[:3, 3])}
    if albedo is not None:
        attributes["NORMAL"] = file.values(unit_normals(scene.normals @ matrix[:3, :3].T))
        attributes["COLOR_0"] = file.values(np.clip(np.asarray(albedo, np.float32), 0.0, 1.0))
        if roughness is not None:
            attributes["TEXCOORD_0"] = file.values(_coordinates(roughness))
    file.mesh("proxy", attributes, indices=file.triangles(scene.faces), material=None if albedo is None else 0)
    file.save(path)


def _white(file: Glb, roughness: NDArray[np.float32] | None) -> Any:
    """A white material, which shines as the texture coordinates of its vertices say, in a picture added to the file."""
    material = matt_white()
    if roughness is None:
        return material
    picture = np.zeros((1, _STEPS, 3), np.uint8)
    picture[:, :, 0], picture[:, :, 1] = 255, np.arange(_STEPS)
    view = file.data(png_bytes(picture))
    file.document.images.append(gltf.Image(bufferView=view, mimeType="image/png", name="gloss"))
    file.document.samplers.append(
        gltf.Sampler(magFilter=gltf.LINEAR, minFilter=gltf.LINEAR, wrapS=gltf.CLAMP_TO_EDGE, wrapT=gltf.CLAMP_TO_EDGE)
    )
    texture = gltf.Texture(sampler=len(file.document.samplers) - 1, source=len(file.document.images) - 1)
    file.document.textures.append(texture)
    material.pbrMetallicRoughness.metallicRoughnessTexture = gltf.TextureInfo(index=len(file.document.textures) - 1)
    return material


def _coordinates(roughness: NDArray[np.float32]) -> NDArray[np.float32]:
    """Texture coordinates (V, 2) of a roughness (V,) in [0, 1]."""
    across = (np.clip(np.asarray(roughness, np.float64), 0.0, 1.0) * (_STEPS - 1) + 0.5) / _STEPS
    return np.stack([across, np.full(len(across), 0.5)], axis=1).astype(np.float32)
