"""Binary glTF 2.0, built array by array, for all writers of .glb files."""

import os
from typing import Any

import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from ..base.gltf import COMPONENTS
from ..base.outputs import staged_file
from ..base.version import VERSION

UNLIT = "KHR_materials_unlit"

_CODES = {kind: code for code, kind in COMPONENTS.items()}


class Glb:
    """A document and its one buffer. document: holds whatever else a file needs; arrays and nodes are added here."""

    def __init__(self, generator: str = "splat2mesh", **document: Any) -> None:
        """document: fields of `pygltflib.GLTF2`, such as materials."""
        self.document = gltf.GLTF2(asset=gltf.Asset(version="2.0", generator=f"{generator} {VERSION}"), **document)
        self._blob = bytearray()

    def values(self, array: NDArray, target: int | None = gltf.ARRAY_BUFFER, **more: Any) -> int:
        """Append an array. array: (N,), (N, 2), (N, 3) or (N, 4). pygltflib aligns arrays to 4 bytes on saving. target:
        of the buffer view. **more: fields of `pygltflib.Accessor`. Returns the index of its accessor."""
        array = np.ascontiguousarray(array)
        array = array.astype(array.dtype.newbyteorder("<"), copy=False)
        kind = "SCALAR" if array.ndim == 1 else f"VEC{array.shape[1]}"
        component = _CODES["<" + array.dtype.str[1:]]
        view = self.data(array.tobytes(), target=target)
        accessor = gltf.Accessor(bufferView=view, componentType=component, count=len(array), type=kind, **more)
        self.document.accessors.append(accessor)
        return len(self.document.accessors) - 1

    def positions(self, points: NDArray) -> int:
        """Append points with the bounds that glTF asks for. points: (N, 3). Returns the index of its accessor."""
        points = np.asarray(points, np.float32)
        return self.values(points, min=points.min(axis=0).tolist(), max=points.max(axis=0).tolist())

    def colors(self, linear: NDArray) -> int:
        """Append opaque colours in 16 bits. linear: (N, 3), cut to [0, 1]. Returns the index of their accessor."""
        most = np.iinfo(np.uint16).max
        colors = np.full((len(linear), 4), most, np.uint16)
        colors[:, :3] = np.round(most * np.clip(linear, 0, 1))
        return self.values(colors, normalized=True)

    def indices(self, faces: NDArray, vertex_count: int) -> int:
        """Append faces, in 16 bits where those suffice. faces: (F, 3) integers. Returns the index of its accessor."""
        # The largest index restarts a primitive in OpenGL, so glTF forbids it.
        if vertex_count > np.iinfo(np.uint16).max:
            return self.triangles(faces)
        return self.values(faces.ravel().astype(np.uint16), gltf.ELEMENT_ARRAY_BUFFER)

    def triangles(self, faces: NDArray) -> int:
        """Append faces in 32 bits, which every loader reads. faces: (F, 3) integers. Returns the index of its
        accessor."""
        return self.values(faces.ravel().astype(np.uint32), gltf.ELEMENT_ARRAY_BUFFER)

    def data(self, content: bytes, **more: Any) -> int:
        """Append bytes. **more: fields of `pygltflib.BufferView`. Returns the index of their buffer view."""
        view = gltf.BufferView(buffer=0, byteOffset=len(self._blob), byteLength=len(content), **more)
        self._blob += content
        self.document.bufferViews.append(view)
        return len(self.document.bufferViews) - 1

    def mesh(self, name: str, attributes: dict[str, int], **primitive: Any) -> None:
        """Add a mesh of one primitive and the node that shows it. name: of both. attributes: name to accessor.
        **primitive: fields of `pygltflib.Primitive`; triangles, where they name no mode."""
        part = gltf.Primitive(attributes=gltf.Attributes(), **({"mode": gltf.TRIANGLES} | primitive))
        for key, accessor in attributes.items():  # names with a colon cannot be keyword arguments
            setattr(part.attributes, key, accessor)
        self.document.meshes.append(gltf.Mesh(name=name, primitives=[part]))
        self.document.nodes.append(gltf.Node(name=name, mesh=len(self.document.meshes) - 1))

    def content(self, extras: dict | None = None) -> bytes:
        """Return the whole file, whose one scene shows all nodes. extras: JSON values of that scene."""
        nodes = list(range(len(self.document.nodes)))
        self.document.scenes, self.document.scene = [gltf.Scene(nodes=nodes, extras=extras or {})], 0
        self.document.buffers = [gltf.Buffer(byteLength=len(self._blob))]
        self.document.set_binary_blob(bytes(self._blob))
        return b"".join(self.document.save_to_bytes())

    def save(self, path: str | os.PathLike[str], extras: dict | None = None) -> None:
        """Write the file, complete or not at all. extras: as for `content`."""
        content = self.content(extras)
        with staged_file(path) as staging:
            staging.write_bytes(content)


def matt_white() -> Any:
    """Return a material of white without gloss, seen from both sides, which COLOR_0 is multiplied with."""
    surface = gltf.PbrMetallicRoughness(baseColorFactor=[1.0] * 4, metallicFactor=0.0, roughnessFactor=1.0)
    return gltf.Material(name="albedo", pbrMetallicRoughness=surface, doubleSided=True)


def matt(name: str, unlit: bool = True) -> Any:
    """Return the same by another name, of what has COLOR_0. unlit: whether it is shown as it is, without a light."""
    surface = gltf.PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=1.0)
    extensions: dict[str, Any] = {UNLIT: {}} if unlit else {}
    return gltf.Material(name=name, pbrMetallicRoughness=surface, doubleSided=True, extensions=extensions)
