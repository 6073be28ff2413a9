"""Attach each Gaussian to points of the mesh, by position, orientation and distance.

The mesh is welded and sorted by the bits of its vertices, so the division into chunks changes no bit of the result.
"""

from collections.abc import Mapping
from copy import copy
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Faces, Floats, Indices, Integers, Points
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import in_batches, shared
from splat2mesh.render.raycaster import RayCaster, corner_weights
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.carried import NEAR, NEAREST, agreement, shortest_axes

from ..transfer.neighbors import ranked_nodes
from ..transfer.store import Cache, array_key

FAR = 0.05
"""Distance, in diagonals, at which half of a Gaussian's light is a mean over the scene. Trained Gaussians of a
surface are nearer: 99% within 0.024 to 0.031."""

PATCHES = 8
"""Along the longest side of the box, for those means."""


class Surface:
    """The welded mesh of a scene in the frame of its splats.

    points, normals: (M, 3) float32 of its nodes, which are vertices that agree in both. node: (V,) their number for
    each vertex. faces: (F, 3) int32 of nodes. used: (M,) bool, what has faces. areas: (M,) float64. diagonal: of the
    box.
    """

    def __init__(self, scene: Scene, diagonal: float | None = None, kept: Mapping[str, NDArray[Any]] | None = None):
        """diagonal: of the scene that this one is a part of, in the frame of its splats; its own box's without. kept:
        `arrays` of one for the same Scene. Raises InputError or KeyError for what does not fit it."""
        if kept is None:
            self._weld(scene)
        else:
            self._take(kept, len(scene.vertices))
        self.used = np.zeros(len(self.points), bool)
        self.used[self.faces.ravel()] = True
        used = self.used
        if diagonal is None:
            diagonal = float(np.linalg.norm(np.ptp(self.points[used].astype(np.float64), axis=0)))
        self.diagonal = diagonal
        self._caster: RayCaster | None = None

    @classmethod
    def kept_in(cls, cache: Cache, scene: Scene, diagonal: float | None = None) -> "Surface":
        """That of a Scene, from its Cache where it was kept."""
        key = array_key(np.asarray(scene.scene_from_splat, np.float64))
        found = cache.restored(lambda kept: cls(scene, diagonal, kept), "surface", key)
        if found is None:
            found = cls(scene, diagonal)
            arrays = {name: getattr(found, name) for name in ("points", "normals", "faces", "areas")}
            cache.put("surface", key, **arrays, node=found.node.astype(np.int32))
        return found

    def _take(self, kept: Mapping[str, NDArray[Any]], vertices: int) -> None:
        self.points, self.normals, self.faces, self.areas = (
            kept[name] for name in ("points", "normals", "faces", "areas")
        )
        count, node = len(self.points), kept["node"]
        self.node = node.astype(np.int64)
        kinds = [(each.dtype, each.shape[1:]) for each in (self.points, self.normals, self.faces, self.areas, node)]
        plain, rows = np.dtype(np.float32), np.dtype(np.int32)
        if kinds != [(plain, (3,)), (plain, (3,)), (rows, (3,)), (np.dtype(np.float64), ()), (rows, ())]:
            raise InputError("a kept surface is of another kind")
        if not (len(self.normals) == len(self.areas) == count and len(node) == vertices):
            raise InputError("a kept surface is of another scene")
        for each in (self.node, self.faces):
            if each.min(initial=0) < 0 or each.max(initial=-1) >= count:
                raise InputError("a kept surface has other vertices")
        if not all(np.isfinite(each).all() for each in (self.points, self.normals, self.areas)):
            raise InputError("a kept surface is not finite")

    def _weld(self, scene: Scene) -> None:
        vertices, normals = scene.vertices, scene.normals
        content = np.ascontiguousarray(np.hstack([vertices, normals]).astype(np.float32) + np.float32(0.0))
        unique, self.node = _distinct(content)
        matrix = np.asarray(scene.scene_from_splat, np.float64)
        back = np.linalg.inv(matrix)
        self.points = (unique[:, :3] @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
        turned = unique[:, 3:] @ matrix[:3, :3]  # normals go by the inverse transpose of the points' matrix
        self.normals = (turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-12)).astype(np.float32)
        corners = self.node[scene.faces]
        first = corners.argmin(axis=1)[:, None]
        corners = np.take_along_axis(corners, (first + np.arange(3)) % 3, axis=1)
        self.faces = _distinct_faces(corners, len(unique))
        a, b, c = self.points[self.faces.T].astype(np.float64)
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 6
        self.areas = np.bincount(self.faces.ravel(), np.repeat(area, 3), len(self.points))

    def of_vertices(self, values: Floats) -> Floats:
        """Values of the vertices (V, C) as values of the nodes (M, C); vertices of a node have the same."""
        result = np.zeros((len(self.points), values.shape[1]), values.dtype)
        result[self.node] = values
        return result

    def numbers_of(self, corners: Faces) -> NDArray[np.int32]:
        """The numbers (Q,) of faces given by their corners (Q, 3)."""
        bits = _bits(len(self.points))
        first, wanted = ((each[:, 0].astype(np.int64) << bits) | each[:, 1] for each in (self.faces, corners))
        edges = np.unique(first)
        keys, asked = (
            (np.searchsorted(edges, edge) << bits) | each[:, 2]
            for edge, each in ((first, self.faces), (wanted, corners))
        )
        return np.searchsorted(keys, asked).astype(np.int32)

    def posed(self, points: Points, normals: Directions, faces: Faces) -> "Surface":
        """The same nodes elsewhere, with those of its faces that are left. Their areas stay, which weigh them."""
        other = copy(self)
        other.points, other.normals, other.faces, other._caster = points, normals, faces, None
        return other

    @property
    def caster(self) -> RayCaster:
        """The RayCaster of the faces."""
        if self._caster is None:
            self._caster = RayCaster(self.points, self.faces)
        return self._caster


def _distinct(content: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    """The distinct rows (M, 6) of positions and normals (N, 6), along a curve through space and by their bits where
    they share a place, and the number of each row among them, (N,)."""
    size = max(float(np.abs(content[:, :3]).max()), 1e-30)  # of the curve; beyond it a place is sorted like its edge
    points = np.ascontiguousarray(content[:, :3] / np.float32(size))
    order, new, _ = ranked_nodes(points, np.ascontiguousarray(content[:, 3:]))
    number = np.empty(len(content), np.int64)
    number[order] = np.cumsum(new) - 1
    return content[order[new]], number


def _distinct_faces(corners: Integers, nodes: int) -> Faces:
    """The distinct rows, sorted, of corners (F, 3) among so many nodes: (G, 3) int32."""
    bits = _bits(nodes)
    if 3 * bits > 63:
        return np.unique(corners, axis=0).astype(np.int32)
    a, b, c = corners.T.astype(np.int64)
    keys, last = np.sort((a << 2 * bits) | (b << bits) | c), (1 << bits) - 1
    keys = keys[np.append(True, keys[1:] != keys[:-1])[: len(keys)]]
    return np.stack([keys >> 2 * bits, keys >> bits & last, keys & last], axis=1).astype(np.int32)


def _bits(nodes: int) -> int:
    return max(int(nodes - 1).bit_length(), 1)


class Places:
    """The attachment of N Gaussians to a Surface: values of nodes in, values of Gaussians out.

    columns: (N, 9) int32 nodes. weights: (N, 9) float32, rows that sum to 1. far: (N,) float32, the part that a mean
    over the scene has.
    """

    def __init__(self, surface: Surface, splats: Splats, kept: Mapping[str, NDArray[Any]] | None = None) -> None:
        """Ask the mesh, or take the `columns`, `weights` and `far` of a dict that were `kept` for the same.

        Needs finite means and quaternions that are not zero. Raises InputError or KeyError for what does not fit.
        """
        self._surface, self._means = surface, splats.means
        if kept is None:
            self._ask(surface, splats)
        else:
            self.columns, self.weights, self.far = _checked(kept, len(splats), len(surface.points))

    def _ask(self, surface: Surface, splats: Splats) -> None:
        count, near = len(splats), NEAR * surface.diagonal
        self.columns = np.zeros((count, 3 + NEAREST), np.int32)
        self.weights = np.zeros((count, 3 + NEAREST), np.float32)
        self.far = np.zeros(count, np.float32)
        tree, nearest = scipy.spatial.cKDTree(surface.points), min(NEAREST, len(surface.points))

        order = splats.spatial_order()  # neighbours ask for the same part of the mesh
        touching = surface.caster.closest(splats.means[order])

        def ask(part: slice) -> None:
            rows = order[part]
            means = splats.means[rows]
            corners = surface.faces[touching.faces[part]]
            shares = corner_weights(np.clip(touching.uv[part], 0.0, 1.0))
            touched = np.linalg.norm(touching.points[part] - means, axis=1)
            distance, index = tree.query(means, nearest)
            distance, index = distance.reshape(len(means), -1), index.reshape(len(means), -1)
            axis, flat = shortest_axes(splats.take(rows))
            agrees = agreement(axis, flat[:, None], surface.normals[index])
            on_face = np.einsum("nk,nkc->nc", shares, surface.normals[corners])[:, None]
            ahead = agreement(axis, flat[:, None], on_face) / (touched * touched + near * near)[:, None]
            around = agrees / (distance * distance + near * near)
            total = ahead + around.sum(axis=1, keepdims=True)
            self.columns[rows, :3], self.columns[rows, 3 : 3 + nearest] = corners, index
            self.weights[rows, :3] = shares * ahead / total / shares.sum(axis=1, keepdims=True)
            self.weights[rows, 3 : 3 + nearest] = around / total
            self.far[rows] = 1.0 - 1.0 / (1.0 + (touched / (FAR * surface.diagonal)) ** 4)

        in_batches(ask, count)

    def renewed(self, rows: Indices, surface: Surface, splats: Splats) -> "Places":
        """These, of which some rows (R,) ask a Surface anew, as all of these Splats lie on it."""
        other, some = copy(self), Places(surface, splats.take(rows))
        for name in ("columns", "weights", "far", "_means"):
            values = getattr(self, name).copy()
            values[rows] = getattr(some, name)
            setattr(other, name, values)
        return other

    def interpolate(self, values: Floats) -> NDArray[np.float32]:
        """(M, C) float32 of nodes -> (N, C) float32 of Gaussians."""
        patches = Patches.of(self._surface, values)
        result = np.zeros((len(self.far), values.shape[1]), np.float32)
        _mix(len(result), self.columns, self.weights, np.ascontiguousarray(values, np.float32), result)
        lost = np.flatnonzero(self.far > 1e-3)  # less than that is no step of a display

        def fade(part: slice) -> None:
            rows = lost[part]
            result[rows] += self.far[rows, None] * (patches.seen_from(self._means[rows]) - result[rows])

        in_batches(fade, len(lost))
        return result


@shared
@kernel
def _mix(begin: int, end: int, columns: Integers, weights: Floats, values: Floats, result: Floats) -> None:
    """Add to the result (N, C) the values (M, C) of the columns (N, 9), by their weights."""
    for row in range(begin, end):
        for k in range(columns.shape[1]):
            for channel in range(values.shape[1]):
                result[row, channel] += weights[row, k] * values[columns[row, k], channel]


def _checked(
    kept: Mapping[str, NDArray[Any]], count: int, nodes: int
) -> tuple[NDArray[np.int32], NDArray[np.float32], NDArray[np.float32]]:
    """(columns, weights, far) of what was kept, where it is of so many Gaussians and nodes."""
    columns, weights, far = kept["columns"], kept["weights"], kept["far"]
    shape = count, 3 + NEAREST
    kinds = columns.dtype == np.int32 and weights.dtype == far.dtype == np.float32
    if not kinds or columns.shape != shape or weights.shape != shape or far.shape != (count,):
        raise InputError(f"kept places are of another kind than {count} splats have")
    if columns.min(initial=0) < 0 or columns.max(initial=-1) >= nodes:
        raise InputError("kept places are on another mesh")
    if not (np.isfinite(weights).all() and (np.abs(far - 0.5) <= 0.5).all()):
        raise InputError("kept places are not finite")
    return columns, weights, far


class Patches(NamedTuple):
    """Means over P patches of a surface, for Gaussians too far from it to attach to one point.

    centers: (P, 3) float64. areas: (P,). values: (P, C). side: of a patch.
    """

    centers: NDArray[np.float64]
    areas: NDArray[np.float64]
    values: Floats
    side: float

    @classmethod
    def of(cls, surface: Surface, values: Floats) -> "Patches":
        """The patches of a Surface and of values (M, C) of its nodes."""
        used = surface.used
        points = surface.points.astype(np.float64)
        low = points[used].min(axis=0)
        side = max(np.ptp(points[used], axis=0).max(), 1e-30) / PATCHES
        cells = np.clip(((points - low) / side).astype(np.int64), 0, PATCHES)
        _, cell = np.unique(cells @ [1, 100, 10000], return_inverse=True)
        area = np.asarray(np.bincount(cell, surface.areas), np.float64)
        kept = area > 0.0
        area = area[kept]

        def mean(of: Floats) -> NDArray[np.float64]:
            sums = [np.bincount(cell, surface.areas * column)[kept] for column in of.astype(np.float64).T]
            return np.stack(sums, axis=1) / area[:, None]

        return cls(mean(points), area, mean(values), float(side))

    def seen_from(self, points: Points) -> NDArray[np.float32]:
        """Means (N, C) float32 by area over the fourth power of distance: far away, the mean of all patches."""
        result = np.zeros((len(points), self.values.shape[1]), np.float32)
        for start in range(0, len(points), 4096):
            rows = slice(start, start + 4096)
            distance = _squared_distances(points[rows].astype(np.float64), self.centers)
            weights = self.areas / (distance / self.side**2 + 0.25) ** 2
            result[rows] = weights @ self.values / weights.sum(axis=1, keepdims=True)
        return result


def _squared_distances(points: NDArray[np.float64], centers: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N, P) float64 of points (N, 3) and centers (P, 3)."""
    total = np.zeros((len(points), len(centers)))
    for axis in range(3):
        apart = points[:, axis, None] - centers[:, axis]
        apart *= apart
        total += apart
    return total
