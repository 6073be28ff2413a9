"""The mesh under the splats as glTF: it occludes suns, blocks a walker and receives shadows."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces
from splat2mesh.base.outputs import staged_file
from splat2mesh.scene.glb import Glb
from splat2mesh.scene.mesh import vertex_normals


def write_proxy(path: Path, vertices: NDArray[np.float32], faces: Faces) -> None:
    """Write a mesh, (V, 3) float32 in the scene frame and (F, 3), as one node of a binary glTF, with normals."""
    with staged_file(path) as staging:
        staging.write_bytes(proxy_glb(vertices, faces))


def proxy_glb(vertices: NDArray[np.float32], faces: Faces, normals: bool = True) -> bytes:
    """The bytes of that file. normals: whether it has them."""
    file = Glb("relight")
    attributes = {"POSITION": file.positions(vertices)}
    if normals:
        attributes["NORMAL"] = file.values(vertex_normals(vertices, faces))
    file.mesh("proxy", attributes, indices=file.triangles(faces))
    return file.content()
