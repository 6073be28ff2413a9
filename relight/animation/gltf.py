"""The arrays of a glTF 2.0 file: buffers, accessors (strided, sparse, normalised), and the nodes' first transforms."""

import json
import struct
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning, InputError

from .skinning import matrix_from_trs

COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

UNREADABLE = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"
"""Extensions that pack the arrays themselves."""


class GltfData:
    """A .glb or .gltf with its buffers in memory.

    document: as pygltflib parses it. node_weights: the morph weights of every node, which it drops; None without.
    """

    def __init__(self, path: str | Path) -> None:
        """Raises InputError for a file that is missing, broken, or packed by an extension."""
        import pygltflib

        self.path = Path(path)
        if not self.path.is_file():
            raise InputError(f"{self.path}: no such file")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                self.document = pygltflib.GLTF2().load(str(self.path))
            self.node_weights = [node.get("weights") for node in _parsed(self.path).get("nodes", [])]
        except Exception as error:  # pygltflib lets through whatever json, struct and dataclasses raise
            raise InputError(f"{self.path}: not a readable glTF 2.0 file ({error!r}); export it again") from error
        if self.document is None or not self.document.meshes:
            raise InputError(f"{self.path}: holds no meshes; expected a .glb or .gltf with triangles")
        packed = [name for name in self.document.extensionsRequired or [] if name in UNREADABLE]
        if packed:
            raise InputError(f"{self.path}: needs {', '.join(packed)}, which is not read; export it uncompressed")
        self._buffers: dict = {}

    def array(self, index: int, what: str) -> NDArray:
        """Accessor `index`, (N,) or (N, width), as stored or, where it is normalised, float32 in [-1, 1].

        Raises InputError, which names `what`, where it does not fit its buffer.
        """
        try:
            accessor = self.document.accessors[index]
            dtype, width = np.dtype(COMPONENTS[accessor.componentType]), WIDTHS[accessor.type]
            if accessor.bufferView is None:
                values = np.zeros((accessor.count, width), dtype)
            else:
                values = self._view(accessor.bufferView, accessor.byteOffset or 0, dtype, accessor.count, width)
            if accessor.sparse is not None:
                values = self._sparse(accessor.sparse, values.copy())
        except (IndexError, KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"{self.path}: {what} is damaged ({error}); export it again") from error
        if accessor.normalized and dtype.kind != "f":
            values = np.maximum(values.astype(np.float32) / np.float32(np.iinfo(dtype).max), np.float32(-1.0))
        return values[:, 0] if width == 1 else values

    def vectors(self, index, count: int, width: int, what: str) -> NDArray:
        """Accessor `index` as (count, width) float32. Raises InputError for another shape, and unless it is finite."""
        values = self.array(index, what)
        if values.shape != (count, width):
            raise InputError(f"{self.path}: {what} must have shape ({count}, {width}), found {values.shape}")
        values = values.astype(np.float32)
        if not np.isfinite(values).all():
            raise InputError(f"{self.path}: {what} is not finite; repair the file first")
        return values

    def _sparse(self, sparse, values):
        index, new = sparse.indices, sparse.values
        dtype = np.dtype(COMPONENTS[index.componentType])
        rows = self._view(index.bufferView, index.byteOffset or 0, dtype, sparse.count, 1)[:, 0]
        values[rows] = self._view(new.bufferView, new.byteOffset or 0, values.dtype, sparse.count, values.shape[1])
        return values

    def _view(self, index, offset, dtype, count, width):
        view = self.document.bufferViews[index]
        start = (view.byteOffset or 0) + offset
        stride = view.byteStride or dtype.itemsize * width
        data = self._buffer(view.buffer)
        end = start + (count - 1) * stride + dtype.itemsize * width if count else start
        if end > min(len(data), (view.byteOffset or 0) + view.byteLength):
            raise ValueError(f"{end} bytes of {len(data)}")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

    def _buffer(self, index):
        if index not in self._buffers:
            buffer = self.document.buffers[index]
            if buffer.uri is None:
                data = self.document.binary_blob() or b""
            elif buffer.uri.startswith("data:"):
                data = self.document.get_data_from_buffer_uri(buffer.uri)
            else:
                from urllib.parse import unquote

                file = self.path.parent / unquote(buffer.uri)
                if not file.is_file():
                    raise InputError(f"{self.path}: its buffer {buffer.uri} is not beside it")
                data = file.read_bytes()
            self._buffers[index] = data
        return self._buffers[index]

    def initial_transforms(self) -> list[dict]:
        """Where every node stands before anything moves: translation, rotation and scale, or a matrix; float64."""
        transforms = []
        for node in self.document.nodes:
            if node.matrix is not None and node.translation is None and node.rotation is None and node.scale is None:
                transforms.append({"matrix": np.reshape(np.array(node.matrix, np.float64), (4, 4)).T})
                continue
            transforms.append(
                {
                    "translation": np.array(node.translation or [0.0, 0.0, 0.0], np.float64),
                    "rotation": np.array(node.rotation or [0.0, 0.0, 0.0, 1.0], np.float64),
                    "scale": np.array([1.0, 1.0, 1.0] if node.scale is None else node.scale, np.float64),
                }
            )
        return transforms

    def hierarchy(self) -> tuple[list[int], NDArray, NDArray]:
        """All nodes, parents first; the parent of every node, -1 without one; whether each is in the shown scene."""
        nodes = self.document.nodes or []
        parent = np.full(len(nodes), -1)
        for index, node in enumerate(nodes):
            for child in node.children or []:
                if not 0 <= child < len(nodes) or parent[child] != -1:
                    raise InputError(f"{self.path}: its nodes do not form a tree; export it again")
                parent[child] = index
        order = np.flatnonzero(parent == -1).tolist()
        for index in order:
            order += nodes[index].children or []
        if len(order) < len(nodes):
            raise InputError(f"{self.path}: its nodes do not form a tree; export it again")
        scenes, shown = self.document.scenes, np.ones(len(nodes), bool)
        if scenes:
            shown[:] = False
            shown[scenes[self.document.scene or 0].nodes or []] = True
            for index in order:
                shown[index] |= parent[index] >= 0 and shown[parent[index]]
        return order, parent, shown


def global_matrices(transforms: list[dict], order: list[int], parent: NDArray) -> NDArray:
    """World-from-node matrices, (nodes, 4, 4) float64, also of joints outside the shown scene."""
    result = np.zeros((len(transforms), 4, 4))
    for index in order:
        own = transforms[index]
        local = own["matrix"] if "matrix" in own else matrix_from_trs(*own.values())
        result[index] = local if parent[index] < 0 else result[parent[index]] @ local
    return result


def _parsed(path):
    """The JSON of a .glb or .gltf."""
    data = path.read_bytes()
    if data[:4] == b"glTF":
        (length,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + length]
    return json.loads(data)


def warn_skipped(path: str | Path, count: int, what: str) -> None:
    """One DataWarning for parts of a file that are left out."""
    if count:
        warnings.warn(f"{path}: skipped {count} {what}", DataWarning, stacklevel=3)
