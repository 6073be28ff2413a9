"""The mesh behind the splats as glTF: it hides suns, stops a walker and catches shadows."""

import numpy as np

from splat2mesh.base.outputs import staged_file
from splat2mesh.base.version import VERSION


def write_proxy(path, vertices, faces):
    """Write a mesh, (V, 3) float32 in the scene frame and (F, 3), as one node of a binary glTF, with normals."""
    with staged_file(path) as staging:
        staging.write_bytes(proxy_glb(vertices, faces))


def proxy_glb(vertices, faces):
    """The bytes of that file."""
    import pygltflib as gltf

    vertices = np.ascontiguousarray(vertices, "<f4")
    normals = vertex_normals(vertices, faces).astype("<f4")
    indices = np.ascontiguousarray(faces, "<u4")
    arrays = [(vertices, "VEC3", 5126, 34962), (normals, "VEC3", 5126, 34962), (indices, "SCALAR", 5125, 34963)]
    document, blob = gltf.GLTF2(asset=gltf.Asset(version="2.0", generator=f"relight {VERSION}")), b""
    for array, kind, component, target in arrays:
        document.bufferViews.append(
            gltf.BufferView(buffer=0, byteOffset=len(blob), byteLength=array.nbytes, target=target)
        )
        count = array.size if kind == "SCALAR" else len(array)
        view = len(document.bufferViews) - 1
        document.accessors.append(gltf.Accessor(bufferView=view, componentType=component, count=count, type=kind))
        blob += array.tobytes()
    document.accessors[0].min, document.accessors[0].max = vertices.min(axis=0).tolist(), vertices.max(axis=0).tolist()
    primitive = gltf.Primitive(attributes=gltf.Attributes(POSITION=0, NORMAL=1), indices=2, mode=gltf.TRIANGLES)
    document.meshes = [gltf.Mesh(name="proxy", primitives=[primitive])]
    document.nodes, document.scenes, document.scene = [gltf.Node(name="proxy", mesh=0)], [gltf.Scene(nodes=[0])], 0
    document.buffers = [gltf.Buffer(byteLength=len(blob))]
    document.set_binary_blob(blob)
    return b"".join(document.save_to_bytes())


def vertex_normals(vertices, faces):
    """Unit normals (V, 3) float64, means of the faces around by area; +y where there is none."""
    a, b, c = vertices[faces.T].astype(np.float64)
    normal = np.cross(b - a, c - a)
    sums = np.zeros((len(vertices), 3))
    for axis in range(3):
        for corner in faces.T:
            sums[:, axis] += np.bincount(corner, normal[:, axis], len(vertices))
    length = np.linalg.norm(sums, axis=1, keepdims=True)
    return np.where(length > 1e-30, sums / np.maximum(length, 1e-30), [0.0, 1.0, 0.0])
