"""Splats as binary glTF 2.0 by KHR_gaussian_splatting, as ratified: float attributes of one point primitive.

Source: github.com/KhronosGroup/glTF, extensions/2.0/Khronos/KHR_gaussian_splatting.
"""

import os
import warnings

import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.glb import Glb
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import Splats

EXTENSION = "KHR_gaussian_splatting"


def write_splat_glb(
    path: str | os.PathLike[str],
    splats: Splats,  # as read, in their own frame
    scene_from_splat: NDArray,  # (4, 4) similarity: glTF is y-up, and its splats look from a world direction
    extras: dict | None = None,  # dict of JSON values, kept in the glTF scene's `extras`
) -> int:
    """Write splats in the scene frame, harmonics turned too; returns how many.

    Colours are display-referred sRGB (`srgb_rec709_display`), harmonics with the signs of 3DGS, as the extension has
    both. COLOR_0 is what a viewer of points alone shows, linear. Splats that are not finite or have no rotation cannot
    be written: they are left out, with a DataWarning, and so are those of opacity 0, silently; the rest keeps its
    order.
    """
    splats = placed(splats.take(showable(splats)), scene_from_splat)
    file = Glb(extensionsUsed=[EXTENSION])
    shown = linear_from_srgb(np.clip(splats.colors_diffuse, 0.0, 1.0))
    opacities = splats.opacities.astype(np.float32)
    arrays = {
        "COLOR_0": np.hstack([shown, opacities[:, None]]),
        f"{EXTENSION}:ROTATION": splats.quats_wxyz[:, [1, 2, 3, 0]],
        f"{EXTENSION}:SCALE": splats.scales,
        f"{EXTENSION}:OPACITY": opacities,
    }
    for degree in range(splats.degree + 1):
        for order in range(2 * degree + 1):
            arrays[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"] = splats.sh[:, degree * degree + order]
    attributes = {"POSITION": file.positions(splats.means)}
    attributes |= {name: file.values(array.astype(np.float32)) for name, array in arrays.items()}
    look = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    file.mesh("splats", attributes, mode=gltf.POINTS, extensions={EXTENSION: look})
    file.save(path, extras)
    return len(splats)


def showable(splats: Splats) -> NDArray[np.bool_]:
    """(N,) bool: splats that a file without NaN can hold and a viewer would show. Warns of those that are damaged."""
    whole = sound(splats)
    if not whole.all():
        lost = int(np.count_nonzero(~whole))
        warnings.warn(f"left out {lost} of {len(splats)} splats that are damaged", DataWarning, stacklevel=3)
    return whole & (splats.opacities > 0.0)
