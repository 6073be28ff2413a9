"""The triangles of a glTF file in its rest pose, as one surface: every mesh where its nodes place it."""

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.gltf import FREE_CORNERS, MODES, TRIANGLES, GltfData, entry, triangles, warn_skipped
from ..base.gltfnodes import for_normals, instances, shown_nodes
from ..base.inputs import reading
from .color import srgb_from_linear
from .gltftextures import Textures
from .mesh import unit
from .surfaces import UncheckedMesh, centred, joined


class Piece(NamedTuple):
    """A primitive at a node. held: what its vertices hold besides their place, by name; (N, k) each.
    node: that places it."""

    material: int | None
    faces: NDArray
    points: NDArray
    held: dict[str, NDArray]
    mirrored: bool
    node: int = -1


class Primitive(NamedTuple):
    """A primitive of a node, in the frame of its mesh. source: its JSON. node: its number. matrix: (4, 4)
    world_from_node at rest. copies: (I, 4, 4) node_from_copy. The others as of a Piece; points (N, 3) float64."""

    source: Any
    material: int | None
    faces: NDArray
    points: NDArray
    held: dict[str, NDArray]
    node: int
    matrix: NDArray
    copies: NDArray

    def placed(self, copy: NDArray) -> Piece:
        """One of its copies where the node places it."""
        matrix, held = self.matrix @ copy, self.held
        turn = matrix[:3, :3]
        if "NORMAL" in held:
            held = held | {"NORMAL": unit(held["NORMAL"] @ for_normals(matrix).T)}
        points, mirrored = self.points @ turn.T + matrix[:3, 3], bool(np.linalg.det(turn) < 0.0)
        return Piece(self.material, self.faces, points, held, mirrored, self.node)


def read_gltf(path: str | os.PathLike[str], painted: bool = True) -> UncheckedMesh:
    """Read the triangles of a .glb or .gltf at rest.

    painted: whether vertices take the base colours of materials, beside their own. Raises InputError for a file that is
    broken or packed, or that holds no triangles. Warns with a DataWarning with the number of points and lines, which
    are left out, and of textures that cannot be read.
    """
    data = GltfData(os.fspath(path))
    textures = Textures(data) if painted else None
    with reading(path):
        found = _as_one(placed_pieces(data), textures)
    if textures is not None:
        textures.warn_lost()
    return found


def _as_one(pieces: list[Piece], textures: Textures | None) -> UncheckedMesh:
    """All pieces in their order. Corners at one place that have the same normal and colour are one vertex."""
    points, moved = centred(np.concatenate([piece.points for piece in pieces]))
    starts = np.cumsum([0, *(len(piece.points) for piece in pieces)])
    faces = np.concatenate(
        [(p.faces[:, ::-1] if p.mirrored else p.faces) + start for p, start in zip(pieces, starts, strict=False)]
    )
    normals, colors = None, None
    if all("NORMAL" in piece.held for piece in pieces):
        normals = np.concatenate([piece.held["NORMAL"] for piece in pieces])
    if textures is not None or any("COLOR_0" in piece.held for piece in pieces):
        colors = srgb_from_linear(np.concatenate([painted(piece, textures) for piece in pieces]))
    row, corner = joined(faces.reshape(-1), points, normals, colors)
    normals, colors = (None if values is None else values[row] for values in (normals, colors))
    return UncheckedMesh(points[row], corner.reshape(-1, 3), normals, colors, moved)


def painted(piece: "Piece | Primitive", textures: Textures | None) -> NDArray:
    """(N, 3) linear: those of the vertices, times the base colour of the material where there are `textures`."""
    own = piece.held.get("COLOR_0")
    color = np.ones((len(piece.points), 3)) if own is None else np.clip(own[:, :3], 0.0, 1.0)
    return color if textures is None else np.clip(color * textures.base_colors(piece.material, piece.held), 0.0, 1.0)


def placed_pieces(data: GltfData) -> list[Piece]:
    """Every primitive with triangles, where the nodes of the shown scene place it. Raises InputError without any."""
    return [each.placed(copy) for each in primitives(data) for copy in each.copies]


def primitives(data: GltfData) -> list[Primitive]:
    """Every primitive with triangles at each node of the shown scene, parents first. Raises InputError without any."""
    found, skipped, corners = [], 0, 0
    most, known = max(FREE_CORNERS, data.size), {}
    for index, node, matrix in shown_nodes(data):
        if node.mesh is None:
            continue
        copies = instances(data, index)
        for source in entry(data.document.meshes, node.mesh).primitives:
            mode = TRIANGLES if source.mode is None else source.mode
            if mode not in MODES or source.attributes.POSITION is None:
                skipped += 1
                continue
            if id(source) not in known:  # nodes may repeat it
                known[id(source)] = _read(data, index, source, mode)
            faces, points, held = known[id(source)]
            corners += len(copies) * max(3 * len(faces), len(points))
            if corners > most:
                raise InputError(f"{data.path}: its nodes repeat meshes to over {most:,} corners; export less of it")
            if len(faces):
                found.append(Primitive(source, source.material, faces, points, held, index, matrix, copies))
    warn_skipped(data.path, skipped, "sets of points or lines")
    if not found:
        raise InputError(f"{data.path}: holds no triangles; expected a triangle mesh")
    return found


def _read(data: GltfData, index: int, primitive: Any, mode: int) -> tuple[NDArray, NDArray, dict[str, NDArray]]:
    """Faces, points and what else the vertices of a primitive hold, before its node places it."""
    attributes, what = primitive.attributes, f"the mesh of node {index}"
    count = len(data.array(attributes.POSITION, what))
    local = data.vectors(attributes.POSITION, count, 3, what).astype(np.float64)
    if primitive.indices is None:
        indices = np.arange(count)
    else:
        indices = data.array(primitive.indices, what)
        if indices.ndim != 1 or indices.dtype.kind == "f":
            raise InputError(f"{data.path}: {what} has indices that are not whole numbers; export it again")
    indices = indices.astype(np.int64)
    if len(indices) and (indices.min() < 0 or indices.max() >= count):
        raise InputError(f"{data.path}: {what} has a face that names a vertex beyond its {count}; export it again")
    held = {}
    for name in (each for each in attributes if each in ("NORMAL", "COLOR_0") or each.startswith("TEXCOORD_")):
        values = np.asarray(data.array(attributes[name], what), np.float32)
        if values.ndim != 2 or len(values) != count or (name == "NORMAL" and values.shape[1] != 3):
            raise InputError(f"{data.path}: {what} has {name} of shape {values.shape} for {count} vertices")
        held[name] = values
    return triangles(indices, mode), local, held
