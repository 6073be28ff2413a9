"""The arrays of a glTF 2.0 file: buffers, accessors (strided, sparse, normalised), and the nodes' first transforms.

It also reads files with KHR_mesh_quantization, as gltfpack writes them. It refuses Draco and meshopt compression by
name. Source: Khronos, "glTF 2.0 Specification".
"""

import base64
import binascii
import struct
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pygltflib as codes
from numpy.typing import NDArray

from .errors import DataWarning, InputError
from .inputs import FREE, file_size, inside, loads, reading

COMPONENTS = {
    **{codes.BYTE: "<i1", codes.UNSIGNED_BYTE: "<u1", codes.SHORT: "<i2", codes.UNSIGNED_SHORT: "<u2"},
    **{codes.UNSIGNED_INT: "<u4", codes.FLOAT: "<f4"},
}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

MODES = TRIANGLES, STRIP, FAN = codes.TRIANGLES, codes.TRIANGLE_STRIP, codes.TRIANGLE_FAN

UNREADABLE = "KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression"
"""Extensions that pack the arrays themselves."""

INSTANCING = "EXT_mesh_gpu_instancing"

HARMLESS = (
    *("KHR_mesh_quantization", INSTANCING),
    *("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_"),
)
"""Extensions, or how their names begin, that a file may require: two are read, the others concern no shape."""

SPLATS, SPZ_DRAFT = "KHR_gaussian_splatting", "KHR_spz_"
"""Extension of Gaussian splats, with which those begin that it is compressed by, and how the drafts of these begin."""

MOST_NODES = 100_000
"""Which take half a minute to place."""

FREE_CORNERS = 30_000_000
"""Corners of faces that any file may have, with all that nodes repeat: they take about 2 GB."""

_JSON, _BIN = (int.from_bytes(kind, "little") for kind in (b"JSON", b"BIN\0"))


class Record(dict):
    """A JSON object whose keys are attributes too; one that is missing is None."""

    __slots__ = ()

    def __getattr__(self, name: str) -> Any:
        return self.get(name)


class GltfData:
    """A .glb or .gltf with its buffers in memory. document: its JSON, as Records. size: bytes of the file."""

    def __init__(self, path: str | Path, meshless: bool = False) -> None:
        """meshless: it may hold no meshes. Raises InputError for a file that is missing, broken, or packed."""
        self.path = Path(path)
        self.size = file_size(self.path, "glTF file")
        with reading(self.path):
            document, self._blob = self._parsed(self.path.read_bytes())
            if not isinstance(document, Record):
                raise InputError(f"{self.path}: not a readable glTF 2.0 file: its JSON is not an object")
            if not meshless and (not isinstance(document.meshes, list) or not document.meshes):
                raise InputError(f"{self.path}: holds no meshes; expected a .glb or .gltf with triangles")
            self.document = document
            required = [str(name) for name in document.extensionsRequired or []]
            nodes = document.nodes or []
            if len(nodes) > MOST_NODES:
                raise InputError(f"{self.path}: has {len(nodes):,} nodes, expected at most {MOST_NODES:,}")
        packed = [name for name in required if name in UNREADABLE]
        if packed:
            raise InputError(f"{self.path}: needs {', '.join(packed)}, which is not read; export it uncompressed")
        unknown = [name for name in required if not name.startswith((*HARMLESS, SPLATS, SPZ_DRAFT))]
        if unknown:
            raise InputError(f"{self.path}: needs {', '.join(unknown)}, which is not read; export it without")
        self._buffers: dict = {}

    def _parsed(self, data: bytes) -> tuple[Any, bytes]:
        """The JSON of a .glb or .gltf, and the binary chunk."""
        if data[:4] != b"glTF":
            return loads(data, object_hook=Record), b""
        version, total = struct.unpack_from("<II", data, 4)
        if version != 2:
            raise InputError(f"{self.path}: glTF {version} is not supported: expected 2")
        if total > len(data):
            raise InputError(
                f"{self.path}: not a readable glTF 2.0 file: it announces {total} bytes, found {len(data)}"
            )
        chunks: list[tuple[int, bytes]] = []
        start = 12
        while start + 8 <= total and len(chunks) < 2:
            length, kind = struct.unpack_from("<II", data, start)
            if start + 8 + length > total:
                raise InputError(
                    f"{self.path}: not a readable glTF 2.0 file: a chunk of {length} bytes goes beyond its end"
                )
            chunks.append((kind, data[start + 8 : start + 8 + length]))
            start += 8 + length
        if not chunks or chunks[0][0] != _JSON:
            raise InputError(f"{self.path}: not a readable glTF 2.0 file: its first chunk is not JSON")
        blob = chunks[1][1] if len(chunks) > 1 and chunks[1][0] == _BIN else b""
        return loads(chunks[0][1], object_hook=Record), blob

    def array(self, index: int, what: str) -> NDArray:
        """Read an accessor. what: what it is of, for messages. Returns (N,) or (N, width): as stored or, where it is
        normalised, float32 in [-1, 1]. Raises InputError where it does not fit its buffer."""
        try:
            accessor = entry(self.document.accessors, index)
            dtype, width = np.dtype(COMPONENTS[accessor.componentType]), WIDTHS[accessor.type]
            if not isinstance(accessor.count, int) or not 0 <= accessor.count <= max(self.size, FREE) * 4:
                raise ValueError(f"it announces {accessor.count} items")
            if accessor.bufferView is None:
                if accessor.sparse is None:
                    raise ValueError("it holds no data")
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

    def vectors(self, index: Any, count: int, width: int, what: str) -> NDArray:
        """Read an accessor of vectors. count, width: the shape that it must have. what: what it is of, for messages.
        Returns (count, width) float32. Raises InputError for another shape, and unless it is finite."""
        values = self.array(index, what)
        if values.shape != (count, width):
            raise InputError(f"{self.path}: {what} must have shape ({count}, {width}), found {values.shape}")
        values = values.astype(np.float32)
        if not np.isfinite(values).all():
            raise InputError(f"{self.path}: {what} is not finite; repair the file first")
        return values

    def _sparse(self, sparse: Any, values: NDArray) -> NDArray:
        index, new = sparse["indices"], sparse["values"]
        dtype = np.dtype(COMPONENTS[index.componentType])
        rows = self._view(index.bufferView, index.byteOffset or 0, dtype, sparse.count, 1)[:, 0]
        values[rows] = self._view(new.bufferView, new.byteOffset or 0, values.dtype, sparse.count, values.shape[1])
        return values

    def _view(self, index: Any, offset: int, dtype: np.dtype, count: int, width: int) -> NDArray:
        view = entry(self.document.bufferViews, index)
        start = (view.byteOffset or 0) + offset
        stride = view.byteStride or dtype.itemsize * width
        if min(offset, view.byteOffset or 0, count, stride, view.byteLength) < 0:
            raise ValueError("a size is negative")
        data = self._buffer(view.buffer)
        end = start + (count - 1) * stride + dtype.itemsize * width if count else start
        if end > min(len(data), (view.byteOffset or 0) + view.byteLength):
            raise ValueError(f"{end} bytes of {len(data)}")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

    def _buffer(self, index: Any) -> bytes:
        if index not in self._buffers:
            buffer = entry(self.document.buffers, index)
            if buffer.uri is None:
                if index != 0 or not self._blob:
                    raise ValueError(f"buffer {index} holds no data")
                data = self._blob
            elif buffer.uri.startswith("data:"):
                data = _inline(buffer.uri)
            else:
                data = self._beside(buffer.uri, "buffer")
            self._buffers[index] = data
        return self._buffers[index]

    def _beside(self, uri: str, what: str) -> bytes:
        file = inside(self.path.parent, unquote(uri), self.path)
        if not file.is_file():
            raise InputError(f"{self.path}: its {what} {uri} is not beside it")
        return file.read_bytes()

    def encoded(self, image: Any) -> bytes:
        """Return the bytes of a picture, packed as in its file. image: an entry of `document.images`, or what names a
        `bufferView` alone. Raises InputError where its file is missing."""
        if image.uri is None:
            length = entry(self.document.bufferViews, image.bufferView).byteLength
            return self._view(image.bufferView, 0, np.dtype("u1"), length, 1).tobytes()
        return _inline(image.uri) if image.uri.startswith("data:") else self._beside(image.uri, "picture")


def triangles(indices: NDArray, mode: int) -> NDArray[np.int32]:
    """Return the triangles of a list, a strip or a fan. indices: (N,) integers. mode: one of `MODES`. Returns (F, 3)
    int32."""
    if mode == TRIANGLES:
        faces = indices[: len(indices) // 3 * 3].reshape(-1, 3)
    elif len(indices) < 3:
        faces = np.zeros((0, 3), np.int32)
    elif mode == FAN:
        faces = np.stack([np.full(len(indices) - 2, indices[0]), indices[1:-1], indices[2:]], axis=1)
    else:
        faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
        faces[1::2] = faces[1::2, [1, 0, 2]]
    return np.ascontiguousarray(faces, np.int32)


def entry(entries: Any, index: Any) -> Any:
    """Return one of a list, by a number that a file gives: a negative one would count from the end. Raises IndexError
    for what is no number of one that is there."""
    if not isinstance(index, int) or isinstance(index, bool) or not 0 <= index < len(entries):
        raise IndexError(f"it names entry {index} of {len(entries)}")
    return entries[index]


def _inline(uri: str) -> bytes:
    """The bytes of a data URI."""
    try:
        return base64.b64decode(uri.partition(",")[2], validate=True)
    except binascii.Error as error:
        raise ValueError(f"a data URI is no base64 ({error})") from None


def warn_skipped(path: str | Path, count: int, what: str) -> None:
    """Give one DataWarning for parts of a file that are left out. count: 0 gives none. what: what they are."""
    if count:
        warnings.warn(f"{path}: skipped {count} {what}", DataWarning, stacklevel=3)
