"""The mesh of a scene as a proxy of its splat: for shadows, ray casts and walking."""

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.glb import Glb, matt_white

from ..sh.normals import unit_normals
from .gloss_map import coordinates, glossy_white

if TYPE_CHECKING:
    from splat2mesh.scene.scene import Scene

PLAYCANVAS_FROM_SPLAT = np.diag([-1.0, -1.0, 1.0, 1.0])
"""Rz(180): PlayCanvas and the SuperSplat viewer show every splat file turned so, and look for `NAME.collision.glb` in
that frame."""


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
    file.document.materials = [] if albedo is None else [matt_white() if roughness is None else glossy_white(file)]
    attributes = {"POSITION": file.positions(scene.vertices @ matrix[:3, :3].T + matrix[:3, 3])}
    if albedo is not None:
        attributes["NORMAL"] = file.values(unit_normals(scene.normals @ matrix[:3, :3].T))
        attributes["COLOR_0"] = file.values(np.clip(np.asarray(albedo, np.float32), 0.0, 1.0))
        if roughness is not None:
            attributes["TEXCOORD_0"] = file.values(coordinates(roughness))
    file.mesh("proxy", attributes, indices=file.triangles(scene.faces), material=None if albedo is None else 0)
    file.save(path)
