"""Relit scenes as files: GLB and PLY meshes, raw radiance as NumPy.

Every writer takes `radiance`, (V, 3) linear in the scene's vertex order, and writes complete files or none.
"""

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.glb import UNLIT, Glb, matt
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import write_mesh_ply

from ..sh.normals import unit_normals
from .lamps_glb import NO_LAMPS, PlacedLamps, add_lamps

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene


def write_glb(
    path: str | os.PathLike[str],
    scene: "Scene",
    radiance: NDArray,  # (V, 3) linear radiance
    exposure: float,  # display value per unit of radiance
    extras: dict | None = None,  # dict of JSON values, kept in the glTF scene's `extras`
    placed: PlacedLamps = NO_LAMPS,  # whose light is in the colours, for what else is lit
) -> int:
    """Write the relit scene as binary glTF 2.0: one unlit, double-sided mesh per drawn chunk.

    COLOR_0 is linear float32, clip(radiance * exposure, 0, 1), since glTF colours end at 1. 16-bit colours
    would save 8% of the file; floats give back every unclipped radiance as COLOR_0 / exposure. The scene's
    `extras` also carry `exposure` and `clipped_vertices`.
    Returns the number of clipped vertices, those brighter than 1. Raises InputError for radiance that does
    not fit the scene.
    """
    drawn = Drawn(scene)
    scene, exposed = drawn.scene, drawn.colors(check_radiance(scene, radiance)) * np.float32(exposure)
    clipped = int((exposed > 1.0).any(axis=1).sum())
    file, start = Glb(extensionsUsed=[UNLIT], materials=[matt("relit")]), 0
    normals = unit_normals(scene.normals)
    for index, chunk in enumerate(scene.chunks):
        rows = slice(start, start + len(chunk.vertices))
        start = rows.stop
        attributes = {
            "POSITION": file.positions(chunk.vertices),
            "NORMAL": file.values(normals[rows]),
            "COLOR_0": file.values(np.clip(exposed[rows], 0.0, 1.0)),
        }
        faces = file.indices(chunk.faces, len(chunk.vertices))
        file.mesh(f"chunk_{index:04d}", attributes, indices=faces, material=0)
    add_lamps(file, placed)
    file.save(path, {"exposure": float(exposure), "clipped_vertices": clipped, **(extras or {})})
    return clipped


def write_ply(path: str | os.PathLike[str], scene: "Scene", radiance: NDArray, exposure: float) -> None:
    """Write the relit scene as one binary PLY mesh: float position and normal, uchar sRGB colour.

    Vertices stand chunk after chunk. radiance: (V, 3) linear. exposure: display value per unit of radiance;
    what exceeds 1 is clipped.
    Raises InputError for radiance that does not fit the scene.
    """
    drawn = Drawn(scene)
    scene, shown = drawn.scene, drawn.colors(check_radiance(scene, radiance))
    exposed = np.clip(shown * np.float32(exposure), 0.0, 1.0)
    mesh = Mesh(scene.vertices, scene.normals, scene.faces, bytes_from_unit(srgb_from_linear(exposed)))
    with staged_file(path) as staging:
        write_mesh_ply(staging, mesh)


def write_npy(path: str | os.PathLike[str], scene: "Scene", radiance: NDArray) -> None:
    """Write the radiance itself: (V, 3) float32 linear, unexposed, unclipped. Raises InputError as above."""
    radiance = check_radiance(scene, radiance)
    with staged_file(path) as staging, open(staging, "wb") as file:
        np.save(file, radiance)


def check_radiance(scene: "Scene", radiance: NDArray) -> NDArray:
    """The radiance as (V, 3) float32. Raises InputError when it is not one finite RGB per scene vertex."""
    radiance = np.asarray(radiance, np.float32)
    count = sum(len(chunk.vertices) for chunk in scene.chunks)
    if radiance.shape != (count, 3):
        raise InputError(f"radiance must have shape ({count}, 3), one RGB per scene vertex; found {radiance.shape}")
    finite = np.isfinite(radiance).all(axis=1)
    if not finite.all():
        raise InputError(
            f"radiance of {np.sum(~finite)} of {count} vertices is not finite; "
            "check the environment for NaN and infinity"
        )
    return radiance
