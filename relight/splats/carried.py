"""The mesh of a splat carried along where its Gaussians move.

Each vertex takes the rigid motion that comes closest to that of the Gaussians around it, weighted as in the attachment:
moving least squares (Schaefer et al., "Image Deformation Using Moving Least Squares", 2006; in space Zhu and Gortler,
2007). So what moves as one does so to a rounding, turns included, and what bends bends smoothly. Two neighbours go
apart where the distance between them changes by more than the longest standard deviation of either: of Gaussians of a
thing and of what it stands on, a vertex follows those that are more, and faces between them tear.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Indices, Integers, Mask, Points
from splat2mesh.base.threads import in_batches
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import INVISIBLE_OPACITY, Splats

from .attachment import NEAR, NEAREST, Surface, agreement, shortest_axes

_BATCH = 1 << 13
_ROUNDING = 1e-9  # of a sum of squares: where Gaussians stand on one line, the least turn is taken


def has_moved(splats: Splats, first: Splats) -> Mask:
    """(N,) bool: which of Splats are seen and have moved, row by row, by more than their standard deviation along their
    longest axis."""
    far = ((splats.means.astype(float) - first.means) ** 2).sum(axis=1)
    return np.asarray((far > first.scales.max(axis=1).astype(float) ** 2) & (first.opacities >= INVISIBLE_OPACITY))


class MovedMesh(NamedTuple):
    """A mesh in another pose, its M nodes in the frame of the splats.

    first, surface: the Surface in either pose, the latter without torn faces. moved: (M,) bool, nodes that moved.
    extents: (M,), by which distances from them may change until neighbours are apart.
    """

    first: Surface
    surface: Surface
    moved: Mask
    extents: Floats

    def torn(self, corners: Integers) -> Mask:
        """Which faces, (F, 3) nodes each, are torn: (F,) bool."""
        torn = np.zeros(len(corners), bool)
        some = np.flatnonzero(self.moved[corners].any(axis=1))
        for side in range(3):
            a, b = corners[some, side], corners[some, side - 1]
            lengths = [np.linalg.norm(each.points[a] - each.points[b], axis=1) for each in (self.first, self.surface)]
            torn[some] |= np.abs(lengths[1] - lengths[0]) > np.maximum(self.extents[a], self.extents[b])
        return torn

    def scene(self, like: Scene) -> Scene:
        """The Scene in this pose: its moved vertices and their normals, and the faces that are whole."""
        node, matrix = self.first.node, np.asarray(like.scene_from_splat, np.float64)
        rows = self.moved[node]
        vertices, normals = like.vertices.copy(), like.normals.copy()
        vertices[rows] = self.surface.points[node[rows]] @ matrix[:3, :3].T + matrix[:3, 3]
        turned = self.surface.normals[node[rows]] @ np.linalg.inv(matrix[:3, :3])
        normals[rows] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        chunks, start = [], 0
        for chunk in like.chunks:
            part = slice(start, start + len(chunk.vertices))
            whole = ~self.torn(node[part][chunk.faces])
            chunks.append(replace(chunk, vertices=vertices[part], normals=normals[part], faces=chunk.faces[whole]))
            start = part.stop
        return replace(like, chunks=chunks, path=None)


class CarriedMesh:
    """A mesh as Splats carry it. surface: in the first pose. first: of the Splats there those that count, at `rows`."""

    def __init__(self, surface: Surface, first: Splats, rows: Indices) -> None:
        self._surface, self._rows, self._first, points = surface, rows, first, surface.points
        count = min(NEAREST, len(first))
        distance, around = scipy.spatial.cKDTree(first.means).query(points, count)
        self._around = around.reshape(len(points), count)
        axes, flat = shortest_axes(first)
        agrees = agreement(self._surface.normals, flat[self._around], axes[self._around])
        near = NEAR * self._surface.diagonal
        self._weights = agrees / (distance.reshape(self._around.shape) ** 2 + near * near)
        self._weights /= self._weights.sum(axis=1, keepdims=True)
        self._extents = first.scales.max(axis=1).astype(np.float64)

    def at(self, splats: Splats) -> MovedMesh:
        """The mesh where other Splats, row by row the same, carry it. A node that follows Gaussians at rest rests."""
        now, surface = splats.take(self._rows), self._surface
        shifted = has_moved(now, self._first)
        points, normals = surface.points.copy(), surface.normals.copy()
        moved, asked = np.zeros(len(points), bool), np.flatnonzero(shifted[self._around].any(axis=1))

        def carry(part: slice) -> None:
            nodes = asked[part]
            around, weights = self._around[nodes], self._weights[nodes]
            before, after = (each.means[around].astype(np.float64) for each in (self._first, now))
            weights = weights * _together(before, after, self._extents[around], weights)
            own = np.flatnonzero((weights * shifted[around]).sum(axis=1) > 0.5 * weights.sum(axis=1))
            nodes, gaussians = nodes[own], (weights[own], before[own], after[own])
            turn, shift = _rigid(*gaussians)
            points[nodes] = np.einsum("nij,nj->ni", turn, surface.points[nodes]) + shift
            normals[nodes] = np.einsum("nij,nj->ni", turn, surface.normals[nodes])
            moved[nodes] = True

        in_batches(carry, len(asked), _BATCH)
        extents = np.einsum("nk,nk->n", self._weights, self._extents[self._around])
        found = MovedMesh(surface, surface.posed(points, normals, surface.faces), moved, extents)
        whole = surface.faces[~found.torn(surface.faces)]
        return found._replace(surface=surface.posed(points, normals, whole))


def _together(before: Points, after: Points, extents: Floats, weights: Floats) -> Mask:
    """Which of Gaussians (N, k) stay together with the one that most of the weight stays with: (N, k) bool. before,
    after: (N, k, 3) where they are."""
    apart = [np.linalg.norm(each[:, :, None] - each[:, None], axis=3) for each in (before, after)]
    kept = np.abs(apart[1] - apart[0]) <= np.maximum(extents[:, :, None], extents[:, None])
    leader = np.einsum("nij,nj->ni", kept, weights).argmax(axis=1)
    return np.asarray(kept[np.arange(len(kept)), leader])


def _rigid(weights: Floats, before: Points, after: Points) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rotations (N, 3, 3) and shifts (N, 3) closest to the motions of points (N, k, 3) (Kabsch, 1976)."""
    share = (weights / weights.sum(axis=1, keepdims=True))[:, :, None]
    middle = [(share * each).sum(axis=1) for each in (before, after)]
    first, second = (each - center[:, None] for each, center in zip((before, after), middle, strict=True))
    product = np.einsum("nki,nkj->nij", share * second, first)
    product += _ROUNDING * np.abs(product).sum(axis=(1, 2), keepdims=True) * np.eye(3)
    left, _, right = np.linalg.svd(product)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    turn = left @ right
    return turn, middle[1] - np.einsum("nij,nj->ni", turn, middle[0])
