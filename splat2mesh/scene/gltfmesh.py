"""The triangles of a glTF file in its rest pose, as one surface: every mesh where its nodes place it.

Vertices are sorted by material, in the order in which the nodes of the scene name these, children first. Within a
material, meshes follow the order of their nodes, parents first, and vertices that of their first use by faces;
equal vertices are joined.
"""

import os
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..base.gltf import FREE_CORNERS, MODES, TRIANGLES, GltfData, entry, triangles, warn_skipped
from ..base.gltfnodes import global_matrices, hierarchy, initial_transforms, instances
from ..base.inputs import reading
from .color import srgb_from_linear
from .gltftextures import Textures
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


def read_gltf(path: str | os.PathLike[str], painted: bool = True) -> UncheckedMesh:
    """Read the triangles of a .glb or .gltf at rest.

    painted: whether vertices take the base colours of materials, beside their own. Raises InputError for a file that is
    broken or packed, or that holds no triangles. Warns with a DataWarning with the number of points and lines, which
    are left out, and of textures that cannot be read.
    """
    data = GltfData(os.fspath(path))
    textures = Textures(data) if painted else None
    with reading(path):
        found = _joined_pieces(placed_pieces(data), _materials(data), textures)
    if textures is not None:
        textures.warn_lost()
    return found


def _joined_pieces(pieces: list[Piece], materials: list[int | None], textures: Textures | None) -> UncheckedMesh:
    points, faces, normals, colors, first = [], [], [], [], 0
    every, moved = centred(np.concatenate([piece.points for piece in pieces]))
    ends = np.cumsum([len(piece.points) for piece in pieces])
    pieces = [piece._replace(points=part) for piece, part in zip(pieces, np.split(every, ends[:-1]), strict=True)]
    groups: dict[Any, list[Piece]] = {}
    for piece in pieces:
        groups.setdefault((materials.index(piece.material), _kind(piece.held)), []).append(piece)
    named = all("NORMAL" in piece.held for piece in pieces)
    painted = textures is not None or any("COLOR_0" in piece.held for piece in pieces)
    for key in sorted(groups):
        group = groups[key]
        starts = np.cumsum([0, *(len(piece.points) for piece in group)])
        corners = np.concatenate([p.faces.reshape(-1) + start for p, start in zip(group, starts, strict=False)])
        places = np.concatenate([piece.points for piece in group])
        held = {name: np.concatenate([piece.held[name] for piece in group]) for name in group[0].held}
        row, corner = joined(corners, places, *held.values())
        triangle = corner.reshape(-1, 3) + first
        mirrored = np.repeat([piece.mirrored for piece in group], [len(piece.faces) for piece in group])
        triangle[mirrored] = triangle[mirrored][:, ::-1]
        points.append(places[row])
        faces.append(triangle)
        if named:
            normals.append(held["NORMAL"][row])
        if painted:
            color = held["COLOR_0"][row, :3] if "COLOR_0" in held else np.ones((len(row), 3))
            if textures is not None:
                kept = {name: values[row] for name, values in held.items()}
                color = np.clip(color, 0.0, 1.0) * textures.base_colors(materials[key[0]], kept)
            colors.append(srgb_from_linear(np.clip(color, 0.0, 1.0)))
        first += len(row)
    return UncheckedMesh(
        np.concatenate(points),
        np.concatenate(faces),
        np.concatenate(normals) if named else None,
        np.concatenate(colors) if painted else None,
        moved,
    )


def _materials(data: GltfData) -> list[int | None]:
    """The materials of the shown scene, the missing one last."""
    document = data.document
    found: dict[int | None, None] = {}
    nodes, (_, parent, _) = document.nodes or [], hierarchy(data)
    # Children before parents, and the first child first: the reverse of parents first with the last child first.
    for index in _parents_first(document, nodes, parent, last_first=True)[::-1]:
        if nodes[index].mesh is not None:
            for primitive in entry(document.meshes, nodes[index].mesh).primitives:
                if primitive.material is not None:
                    found.setdefault(primitive.material, None)
    return [*found, None]


def _kind(held: dict[str, NDArray]) -> int:
    """A number for what vertices hold: what has more stands later."""
    bits = 1 * ("NORMAL" in held) + 2 * ("TANGENT" in held)
    for number in range(8):
        bits += (0x100 << number) * (f"TEXCOORD_{number}" in held)
        bits += (0x1000000 << number) * (f"COLOR_{number}" in held)
    return bits


def placed_pieces(data: GltfData) -> list[Piece]:
    """Every primitive with triangles, where the nodes of the shown scene place it. Raises InputError without any."""
    document, pieces, skipped, corners = data.document, [], 0, 0
    order, parent, shown = hierarchy(data)
    matrices = global_matrices(initial_transforms(data), order, parent)
    nodes = document.nodes or []
    most, known = max(FREE_CORNERS, data.size), {}
    for index in _parents_first(document, nodes, parent):
        node = nodes[index]
        if node.mesh is None or not shown[index]:
            continue
        copies = instances(data, index)
        for primitive in entry(document.meshes, node.mesh).primitives:
            mode = TRIANGLES if primitive.mode is None else primitive.mode
            if mode not in MODES or primitive.attributes.POSITION is None:
                skipped += 1
                continue
            if id(primitive) not in known:  # nodes may repeat it
                known[id(primitive)] = _read(data, index, primitive, mode)
            faces, local, held = known[id(primitive)]
            corners += len(copies) * max(3 * len(faces), len(local))
            if corners > most:
                raise InputError(f"{data.path}: its nodes repeat meshes to over {most:,} corners; export less of it")
            placed = matrices[index] @ copies if len(faces) else []
            pieces += [_placed(primitive.material, faces, local, held, each)._replace(node=index) for each in placed]
    warn_skipped(data.path, skipped, "sets of points or lines")
    if not pieces:
        raise InputError(f"{data.path}: holds no triangles; expected a triangle mesh")
    return pieces


def _parents_first(document: Any, nodes: Any, parent: NDArray, last_first: bool = False) -> list[int]:
    """Nodes of the shown scene, each before its children and these before the next, or before the one before."""
    way = 1 if last_first else -1
    if document.scenes:
        roots = list(entry(document.scenes, document.scene or 0).nodes or [])
    else:
        roots = np.flatnonzero(parent == -1).tolist()
    pending, found = roots[::way], []
    while pending:
        index = pending.pop()
        found.append(index)
        pending.extend((nodes[index].children or [])[::way])
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
    for name in _attributes(attributes):
        values = np.asarray(data.array(attributes[name], what), np.float32)
        if values.ndim != 2 or len(values) != count or (name == "NORMAL" and values.shape[1] != 3):
            raise InputError(f"{data.path}: {what} has {name} of shape {values.shape} for {count} vertices")
        held[name] = values
    return triangles(indices, mode), local, held


def _placed(material: Any, faces: NDArray, local: NDArray, held: dict[str, NDArray], matrix: NDArray) -> Piece:
    turn = matrix[:3, :3]
    if "NORMAL" in held:
        held = held | {"NORMAL": _turned(held["NORMAL"].astype(np.float64), turn)}
    return Piece(material, faces, local @ turn.T + matrix[:3, 3], held, bool(np.linalg.det(turn) < 0.0))


def _attributes(attributes: Any) -> list[str]:
    names = ["NORMAL", "TANGENT"] * (attributes.NORMAL is not None)
    for kind in ("TEXCOORD", "COLOR"):
        for number in range(8):
            if attributes.get(f"{kind}_{number}") is None:
                break
            names.append(f"{kind}_{number}")
    return [name for name in names if attributes.get(name) is not None]


def _turned(normals: NDArray, turn: NDArray) -> NDArray:
    """Normals under a matrix that may stretch: by its cofactors, which exist where the inverse does not."""
    cofactors = np.stack([np.cross(turn[:, i - 2], turn[:, i - 1]) for i in range(3)], axis=1)
    turned = normals @ cofactors.T * (-1.0 if np.linalg.det(turn) < 0.0 else 1.0)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)
