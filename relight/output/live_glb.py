"""The mesh with live light: albedo and transfer at its vertices, so a shader of any engine can light it.

docs/engines.md describes the format; the loaders are in integrations/.
"""

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.glb import Glb, matt_white

from ..sh.normals import unit_normals
from ..transfer import FEW_BANDS
from .gloss_map import coordinates, glossy_white
from .lamps_glb import ShownLight, add_lamps

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

    from ..light.environment import Environment

FILE = "live.glb"

FORMAT_VERSION = 1

KEY = "relight_live"
"""Keys of the glTF scene's `extras` that the loaders need."""

SNORM = np.iinfo(np.int16).max
"""Scale of 16-bit normalised integers: value = max(integer / 32767, -1)."""


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
    file.document.materials = [matt_white() if roughness is None else glossy_white(file)]
    uv = None if roughness is None else coordinates(roughness)
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
    file.save(path, {KEY: described(lit.light, lit.exposure)})


def described(light: "Environment", exposure: float) -> dict:
    """The value of KEY: JSON."""
    unturned = light.rotated(-light.rotation_deg)
    return {
        "version": FORMAT_VERSION,
        "coefficients": FEW_BANDS**2,
        "exposure": float(exposure),
        "light": {
            "name": light.name,
            "angle_deg": light.rotation_deg,
            "sh": [[float(value) for value in row] for row in unturned.sh(3)],
        },
    }
