"""The mesh under the splats as glTF: it occludes suns, blocks a walker and receives shadows."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Points
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.glb import Glb


def write_proxy(path: Path, vertices: NDArray[np.float32], faces: Faces) -> None:
    """Write a mesh, (V, 3) float32 in the scene frame and (F, 3), as one node of a binary glTF, with normals."""
    with staged_file(path) as staging:
        staging.write_bytes(proxy_glb(vertices, faces))


def proxy_glb(vertices: NDArray[np.float32], faces: Faces, normals: bool = True) -> bytes:
    """The bytes of that file. normals: whether it has them."""
    file = Glb("relight")
    attributes = {"POSITION": file.positions(vertices)}
    if normals:
        attributes["NORMAL"] = file.values(vertex_normals(vertices, faces).astype(np.float32))
    file.mesh("proxy", attributes, indices=file.triangles(faces))
    return file.content()


def vertex_normals(vertices: Points, faces: Faces) -> NDArray[np.float64]:
    """Unit normals (V, 3) float64, means of the faces around by area; +y where there is none."""
    a, b, c = vertices[faces.T].astype(np.float64)
    normal = np.cross(b - a, c - a)
    sums = np.zeros((len(vertices), 3))
    for axis in range(3):
        for corner in faces.T:
            sums[:, axis] += np.bincount(corner, normal[:, axis], len(vertices))
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 1e-30, sums / np.maximum(length, 1e-30), [0.0, 1.0, 0.0])
