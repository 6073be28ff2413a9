"""A mesh in several poses as binary glTF: one file for each, or one that plays them as morph targets.

Vertices that rest have no place in a target: its accessors are sparse.
"""

from collections.abc import Sequence

import numpy as np
import pygltflib as gltf
from numpy.typing import NDArray

from .color import linear_from_srgb
from .glb import UNLIT, Glb, matt
from .mesh import Mesh


def glb_of(chunks: Sequence[Mesh]) -> Glb:
    """A file of chunks in their captured colours, unlit: a mesh and a node for each."""
    file = Glb(extensionsUsed=[UNLIT], materials=[matt("captured")])
    for index, chunk in enumerate(chunks):
        attributes = {
            "POSITION": file.positions(chunk.vertices),
            "NORMAL": file.values(chunk.normals),
            "COLOR_0": file.colors(linear_from_srgb(chunk.colors_srgb.astype(np.float32) / np.float32(255.0))),
        }
        file.mesh(f"chunk_{index:04d}", attributes, indices=file.indices(chunk.faces, len(chunk.vertices)), material=0)
    return file


class PlayedGlb:
    """The file of a first pose that plays further ones. first: its chunks, whose vertices and faces all poses have."""

    def __init__(self, first: Sequence[Mesh]) -> None:
        self._first = first
        self._changes: list[list[tuple[NDArray[np.intp], dict[str, NDArray[np.float32]]]]] = [[] for _ in first]

    def add(self, chunks: Sequence[Mesh]) -> None:
        """Add the next pose."""
        for first, chunk, changes in zip(self._first, chunks, self._changes, strict=True):
            change = {"POSITION": chunk.vertices - first.vertices, "NORMAL": chunk.normals - first.normals}
            rows = np.flatnonzero(np.hstack(list(change.values())).any(axis=1))
            changes.append((rows, {name: values[rows] for name, values in change.items()}))

    def content(self, times_s: NDArray[np.float64]) -> bytes:
        """The file. times_s: (P,) when each pose is shown, the first one at 0; between two of them it is a mix. A pose
        that was added differs from the first."""
        file, count = glb_of(self._first), len(times_s) - 1
        times, weights = times_s.astype(np.float32), np.eye(count + 1, count, -1, np.float32)
        shown = file.values(times, None, min=[float(times[0])], max=[float(times[-1])])
        mixed = file.values(weights.ravel(), None)
        channels = []
        for number, changes in enumerate(self._changes):
            if not any(len(rows) for rows, _ in changes):
                continue
            size, mesh = len(self._first[number].vertices), file.document.meshes[number]
            mesh.weights = [0.0] * count
            mesh.primitives[0].targets = [
                {name: _sparse(file, size, rows, values) for name, values in change.items()} for rows, change in changes
            ]
            target = gltf.AnimationChannelTarget(node=number, path="weights")
            channels.append(gltf.AnimationChannel(sampler=0, target=target))
        sampler = gltf.AnimationSampler(input=shown, output=mixed, interpolation="LINEAR")
        file.document.animations = [gltf.Animation(name="sequence", samplers=[sampler], channels=channels)]
        return file.content()


def _sparse(file: Glb, size: int, rows: NDArray[np.intp], values: NDArray[np.float32]) -> int:
    """Append an array (size, 3) that is 0 but in some rows. Returns the index of its accessor."""
    if not len(rows):  # an accessor without any would hold no data
        rows, values = np.zeros(1, np.intp), np.zeros((1, 3), np.float32)
    views = [file.data(each.tobytes()) for each in (rows.astype("<u4"), values.astype("<f4"))]
    sparse = gltf.Sparse(
        count=len(rows),
        indices=gltf.AccessorSparseIndices(bufferView=views[0], componentType=gltf.UNSIGNED_INT),
        values=gltf.AccessorSparseValues(bufferView=views[1]),
    )
    ends = np.concatenate([values, np.zeros((int(len(rows) < size), 3), np.float32)])
    bounds = {"min": ends.min(axis=0).tolist(), "max": ends.max(axis=0).tolist()}
    accessor = gltf.Accessor(
        componentType=gltf.FLOAT, count=size, type="VEC3", byteOffset=None, sparse=sparse, **bounds
    )
    file.document.accessors.append(accessor)
    return len(file.document.accessors) - 1
