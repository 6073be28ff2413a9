"""A triangle mesh as arrays."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

DEGENERATE_LENGTH = 1e-6
"""A normal shorter than this (files store them with length 1) carries no direction."""


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one normal and one colour per vertex.

    vertices: (V, 3) float32. normals: (V, 3) float32, unit, or zero where undefined. faces: (F, 3) int32,
    counter-clockwise seen from outside. colors_srgb: (V, 3) uint8.
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: NDArray[np.int32]
    colors_srgb: NDArray[np.uint8]

    def of_faces(self, chosen: NDArray) -> "Mesh":
        """Return the part of some faces, and the vertices that these use. chosen: (M,) of the faces, or (F,) bool."""
        used, corners = np.unique(self.faces[chosen], return_inverse=True)
        faces = corners.reshape(-1, 3).astype(np.int32)
        return Mesh(self.vertices[used], self.normals[used], faces, self.colors_srgb[used])


def edge_keys(faces: NDArray, count: int) -> NDArray[np.int64]:
    """Return a number for the edge from each corner of a face to the next, equal for equal edges in either direction.
    faces: (F, 3) integers. count: of the vertices. Returns (F, 3) int64: ascending as the ends are."""
    starts, ends = faces.astype(np.int64), np.roll(faces, -1, axis=1).astype(np.int64)
    return np.minimum(starts, ends) * count + np.maximum(starts, ends)


def edge_ends(keys: NDArray, count: int) -> NDArray[np.int64]:
    """Return the ends of edges by their `edge_keys`: (E, 2) int64, the smaller one first."""
    return np.stack(np.divmod(keys, max(count, 1)), axis=1)


def edges_of(faces: NDArray) -> NDArray:
    """Return the ends of the edges of faces (F, 3), that from a corner to the next after the other: (F, 3, 2)."""
    return np.stack([faces, np.roll(faces, -1, axis=1)], axis=-1)


def halved(faces: NDArray, chosen: NDArray, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Halve edges in all their faces.

    faces: (F, 3) int64. chosen: (F, 3) bool, which of `edges_of`; one face that chooses an edge suffices. count: of the
    vertices. Returns the new faces, (F', 3), and the parents (M, 2) of new vertices, which stand after all others.
    """
    keys = np.sort(edges_of(faces), axis=-1) @ np.array([count, 1])
    found = np.unique(keys[chosen])
    place = np.minimum(np.searchsorted(found, keys), len(found) - 1)
    cut = found[place] == keys
    middle = place + count
    first = np.select([cut.sum(axis=1) == 1, cut.sum(axis=1) == 2], [cut.argmax(axis=1), (~cut).argmax(axis=1)], 0)
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(faces, turn, axis=1).T
    ab, bc, ca = np.take_along_axis(middle, turn, axis=1).T
    parts = [[(a, b, c)], [(a, ab, c), (ab, b, c)], [(a, b, bc), (a, bc, ca), (ca, bc, c)]]
    parts.append([(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)])
    of_face = [[np.stack(corners, axis=1) for corners in each] for each in parts]
    number = cut.sum(axis=1)
    pieces = [made[number == cuts] for cuts, each in enumerate(of_face) for made in each]
    return np.concatenate(pieces), np.stack([found // count, found % count], axis=1)


def vertex_normals(points: ArrayLike, faces: ArrayLike) -> NDArray[np.float32]:
    """`normals_of` in single precision: (V, 3) float32."""
    return normals_of(points, faces).astype(np.float32)


def normals_of(points: ArrayLike, faces: ArrayLike) -> NDArray[np.float64]:
    """Compute the normals of the faces around each vertex, by area, summed in the order of the faces.

    points: (V, 3). faces: (F, 3) integers. Returns (V, 3) float64: unit. Where those of the faces cancel, as on the
    edge of a sheet of two sides, that of the largest face; where they have no area, the mean of the neighbours'; +y
    without any.
    """
    points, faces = np.asarray(points, np.float64), np.asarray(faces, np.int64).reshape(-1, 3)
    a, b, c = (points[faces[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    normals = _gathered(across, faces, len(points))
    lost = np.asarray(~normals.any(axis=1))
    if lost.any():
        rows = np.flatnonzero(lost[faces].any(axis=1))
        rows = rows[np.argsort(np.linalg.norm(across[rows], axis=1), kind="stable")]
        largest = np.zeros_like(normals)
        largest[faces[rows]] = unit(across[rows])[:, None]  # the largest comes last and stays
        normals[lost] = largest[lost]
        rows.sort()
        around = _gathered(normals[faces[rows]].sum(axis=1), faces[rows], len(points))
        for others in (around, [[0.0, 1.0, 0.0]]):
            normals = np.where(normals.any(axis=1, keepdims=True), normals, others)
    return normals


def _gathered(vectors: NDArray, faces: NDArray, count: int) -> NDArray[np.float64]:
    """(V, 3) unit: sums of vectors (F, 3) of faces over the vertices; 0 where they cancel."""
    corners = np.repeat(vectors, 3, axis=0)
    return unit(np.stack([np.bincount(faces.ravel(), corners[:, axis], count) for axis in range(3)], axis=1))


def unit(vectors: NDArray) -> NDArray[np.float64]:
    """Vectors (..., 3) at length 1; zeros stay. Returns float64."""
    vectors = np.asarray(vectors, np.float64)
    length = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
    return np.where(length > 1e-150, vectors / np.maximum(length, 1e-150), 0.0)


def without_direction(normals: NDArray) -> NDArray[np.bool_]:
    """Return which normals are missing: too short for a direction, or not finite. normals: (V, 3). Returns (V,)
    bool."""
    with np.errstate(invalid="ignore", over="ignore"):
        length = np.linalg.norm(np.asarray(normals, np.float64), axis=1)
    return ~(np.isfinite(length) & (length > DEGENERATE_LENGTH))


def known_normals(mesh: Mesh) -> NDArray[np.float32]:
    """Return the normals of a Mesh; those that are missing from the faces around. Returns (V, 3): still missing at
    vertices without faces; as they are where the arrays make no mesh."""
    normals, faces, count = np.asarray(mesh.normals), np.asarray(mesh.faces), len(mesh.vertices)
    if normals.shape != (count, 3) or not len(faces) or faces.min() < 0 or faces.max() >= count:
        return mesh.normals
    missing = without_direction(normals)
    if not missing.any():
        return mesh.normals
    used = np.zeros(count, bool)
    used[faces] = True
    return np.where((missing & used)[:, None], vertex_normals(mesh.vertices, faces), normals)
