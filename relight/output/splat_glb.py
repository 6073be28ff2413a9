"""Splats as binary glTF 2.0 by KHR_gaussian_splatting, as ratified: float attributes of one point primitive.

Source: github.com/KhronosGroup/glTF, extensions/2.0/Khronos/KHR_gaussian_splatting.
"""

import os
import warnings

import numpy as np

from splat2mesh.base.errors import DataWarning
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.version import VERSION
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import Splats

from .mesh_files import _add_accessor

EXTENSION = "KHR_gaussian_splatting"


def write_splat_glb(
    path: str | os.PathLike[str],
    splats: Splats,  # as read, in their own frame
    scene_from_splat,  # (4, 4) similarity: glTF is y-up, and its splats look from a world direction
    extras: dict | None = None,  # dict of JSON values, kept in the glTF scene's `extras`
) -> int:
    """Write splats in the scene frame, harmonics turned too; returns how many.

    Colours are display-referred sRGB (`srgb_rec709_display`), harmonics with the signs of 3DGS, as the extension has
    both. COLOR_0 is what a viewer of points alone shows, linear. Splats that are not finite or have no rotation cannot
    be written: they are left out, with a DataWarning, and so are those of opacity 0, silently; the rest keeps its
    order.
    """
    import pygltflib as gltf

    splats = placed(splats.take(showable(splats)), scene_from_splat)
    document = gltf.GLTF2(
        asset=gltf.Asset(version="2.0", generator=f"splat2mesh {VERSION}"), extensionsUsed=[EXTENSION]
    )
    blob = bytearray()

    def add(values, kind, **bounds):
        return _add_accessor(document, blob, values.astype("<f4"), kind, len(splats), 5126, 34962, **bounds)

    corners = {"min": splats.means.min(axis=0).tolist(), "max": splats.means.max(axis=0).tolist()}
    shown = linear_from_srgb(np.clip(splats.colors_diffuse, 0.0, 1.0))
    accessors = {
        "POSITION": add(splats.means, "VEC3", **corners),
        "COLOR_0": add(np.hstack([shown, splats.opacities[:, None]]), "VEC4"),
        f"{EXTENSION}:ROTATION": add(splats.quats_wxyz[:, [1, 2, 3, 0]], "VEC4"),
        f"{EXTENSION}:SCALE": add(splats.scales, "VEC3"),
        f"{EXTENSION}:OPACITY": add(splats.opacities, "SCALAR"),
    }
    for degree in range(splats.degree + 1):
        for order in range(2 * degree + 1):
            coefficient = splats.sh[:, degree * degree + order]
            accessors[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"] = add(coefficient, "VEC3")
    look = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    primitive = gltf.Primitive(attributes=gltf.Attributes(), mode=gltf.POINTS, extensions={EXTENSION: look})
    for name, accessor in accessors.items():  # names with a colon cannot be keyword arguments
        setattr(primitive.attributes, name, accessor)
    document.meshes = [gltf.Mesh(name="splats", primitives=[primitive])]
    document.nodes = [gltf.Node(name="splats", mesh=0)]
    document.scenes, document.scene = [gltf.Scene(nodes=[0], extras=extras or {})], 0
    document.buffers = [gltf.Buffer(byteLength=len(blob))]
    document.set_binary_blob(bytes(blob))
    with staged_file(path) as staging:
        document.save_binary(staging)
    return len(splats)


def showable(splats: Splats) -> np.ndarray:
    """(N,) bool: splats that a file without NaN can hold and a viewer would show. Warns of those that are damaged."""
    from ..splats.binding import usable

    sound = usable(splats)
    if not sound.all():
        lost = int(np.count_nonzero(~sound))
        warnings.warn(f"left out {lost} of {len(splats)} splats that are damaged", DataWarning, stacklevel=3)
    return sound & (splats.opacities > 0.0)
