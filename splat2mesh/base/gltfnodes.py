"""The nodes of a glTF 2.0 file: their hierarchy, and their transforms before anything moves."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InputError
from .gltf import INSTANCING, MOST_NODES, GltfData

_INSTANCE = {"TRANSLATION": (0.0, 0.0, 0.0), "ROTATION": (0.0, 0.0, 0.0, 1.0), "SCALE": (1.0, 1.0, 1.0)}


def shown_nodes(data: GltfData) -> Iterator[tuple[int, Any, NDArray]]:
    """Go through the nodes of the shown scene, parents first. Yields index; node; world-from-node matrix, (4, 4)
    float64, before any animation. Raises InputError where nodes do not form trees."""
    order, parent, shown = hierarchy(data)
    matrices = global_matrices(initial_transforms(data), order, parent)
    yield from ((index, data.document.nodes[index], matrices[index]) for index in order if shown[index])


def initial_transforms(data: GltfData) -> list[dict]:
    """Find the transform of every node before any animation. Returns translation, rotation (x y z w) and scale, or
    matrix."""
    transforms = []
    for node in data.document.nodes or []:
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


def instances(data: GltfData, index: int) -> NDArray:
    """Find the copies of a node's mesh that EXT_mesh_gpu_instancing places.

    Returns (I, 4, 4) float64: node_from_copy; the identity alone without the extension. Raises InputError for arrays of
    other shapes, and for more than `MOST_NODES` copies.
    """
    extension = (data.document.nodes[index].extensions or {}).get(INSTANCING) or {}
    named, what = extension.get("attributes") or {}, f"the copies of node {index}"
    given = {name: data.array(named[name], what) for name in _INSTANCE if name in named}
    if not given:
        return np.eye(4)[None]
    count = max(len(values) for values in given.values())
    if count > MOST_NODES:
        raise InputError(f"{data.path}: {what} are {count:,}, expected at most {MOST_NODES:,}; export less of it")
    parts = []
    for name, usual in _INSTANCE.items():
        values = np.broadcast_to(np.array(usual), (count, len(usual))) if name not in given else given[name]
        if values.shape != (count, len(usual)) or not np.isfinite(values).all():
            raise InputError(f"{data.path}: {what} have a {name} of shape {values.shape} for {count}, or not finite")
        parts.append(values.astype(np.float64))
    return np.array([matrix_from_trs(*each) for each in zip(*parts, strict=True)]).reshape(-1, 4, 4)


def hierarchy(data: GltfData) -> tuple[list[int], NDArray, NDArray]:
    """Find the hierarchy of nodes. Returns order: all nodes, parents first; parent: integers, of every node, -1 without
    one; shown: bool, whether each is in the shown scene. Raises InputError where they do not form trees."""
    nodes = data.document.nodes or []
    parent = np.full(len(nodes), -1)
    for index, node in enumerate(nodes):
        for child in node.children or []:
            if not 0 <= child < len(nodes) or parent[child] != -1:
                raise InputError(f"{data.path}: its nodes do not form a tree; export it again")
            parent[child] = index
    order = np.flatnonzero(parent == -1).tolist()
    for index in order:
        order += nodes[index].children or []
    if len(order) < len(nodes):
        raise InputError(f"{data.path}: its nodes do not form a tree; export it again")
    scenes, shown = data.document.scenes, np.ones(len(nodes), bool)
    if scenes:
        shown[:] = False
        shown[scenes[data.document.scene or 0].nodes or []] = True
        for index in order:
            shown[index] |= parent[index] >= 0 and shown[parent[index]]
    return order, parent, shown


def global_matrices(transforms: list[dict], order: list[int], parent: NDArray) -> NDArray:
    """Return the world-from-node matrices, also of joints outside the shown scene. transforms: as `initial_transforms`
    returns them. order: parents first. parent: (nodes,) integers. Returns (nodes, 4, 4) float64."""
    result = np.zeros((len(transforms), 4, 4))
    for index in order:
        own = transforms[index]
        local = own["matrix"] if "matrix" in own else matrix_from_trs(*own.values())
        result[index] = local if parent[index] < 0 else result[parent[index]] @ local
    return result


def for_normals(matrices: NDArray) -> NDArray:
    """Matrices (..., 3, 3) that turn normals where (..., 4, 4) move points, up to a positive factor.

    The inverse transpose times the absolute determinant, which also exists for a matrix that flattens to a plane.
    """
    a, b, c = (matrices[..., :3, column] for column in range(3))
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=-1)
    sign = np.where(np.einsum("...i,...i->...", a, np.cross(b, c)) < 0, -1.0, 1.0)
    return cofactors * sign[..., None, None]


def matrix_from_trs(translation: NDArray, quat_xyzw: NDArray, scale: NDArray) -> NDArray:
    """Return the matrix that scales, then rotates, then moves. translation: (3,). quat_xyzw: (4,), of any length.
    scale: (3,). Returns (4, 4) float64."""
    x, y, z, w = np.asarray(quat_xyzw, np.float64) / max(float(np.linalg.norm(quat_xyzw)), 1e-300)
    # fmt: off
    rotation = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])
    # fmt: on
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation * np.asarray(scale, np.float64), translation
    return matrix
