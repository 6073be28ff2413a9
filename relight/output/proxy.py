"""The mesh of a scene as a stand-in for its splat: what receives shadows, is hit by rays and is walked on."""

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.outputs import staged_file
from splat2mesh.base.version import VERSION

from .mesh_files import _add_accessor, _add_vectors, _unit_normals

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
) -> None:
    """Write the whole scene as binary glTF 2.0: one mesh, one primitive, its vertices in the order of the scene.

    With an albedo it has NORMAL, COLOR_0 and a matt white material, so that an engine can light it; without, positions
    and triangles alone, as for collisions.
    """
    import pygltflib as gltf

    matrix = np.eye(4) if matrix is None else np.asarray(matrix, np.float64)
    vertices = (scene.vertices @ matrix[:3, :3].T + matrix[:3, 3]).astype(np.float32)
    document = gltf.GLTF2(asset=gltf.Asset(version="2.0", generator=f"splat2mesh {VERSION}"))
    blob = bytearray()
    corners = {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}
    attributes = gltf.Attributes(POSITION=_add_vectors(document, blob, vertices, **corners))
    if albedo is not None:
        attributes.NORMAL = _add_vectors(document, blob, _unit_normals(scene.normals @ matrix[:3, :3].T))
        attributes.COLOR_0 = _add_vectors(document, blob, np.clip(np.asarray(albedo, np.float32), 0.0, 1.0))
        matt = gltf.PbrMetallicRoughness(baseColorFactor=[1.0] * 4, metallicFactor=0.0, roughnessFactor=1.0)
        document.materials = [gltf.Material(name="albedo", pbrMetallicRoughness=matt, doubleSided=True)]
    indices = scene.faces.ravel().astype("<u4")
    faces = _add_accessor(document, blob, indices, "SCALAR", len(indices), 5125, 34963)
    material = None if albedo is None else 0
    primitive = gltf.Primitive(attributes=attributes, indices=faces, material=material, mode=gltf.TRIANGLES)
    document.meshes = [gltf.Mesh(name="proxy", primitives=[primitive])]
    document.nodes = [gltf.Node(name="proxy", mesh=0)]
    document.scenes, document.scene = [gltf.Scene(nodes=[0])], 0
    document.buffers = [gltf.Buffer(byteLength=len(blob))]
    document.set_binary_blob(bytes(blob))
    with staged_file(path) as staging:
        document.save_binary(staging)
