"""The mesh of a splat carried along where its Gaussians move.

Each vertex takes the rigid motion that comes closest to that of the Gaussians around it, weighted by distance and
orientation: moving least squares (Schaefer et al., "Image Deformation Using Moving Least Squares", 2006; in space Zhu
and Gortler, 2007). So what moves as one does so to a rounding, turns included, and what bends bends smoothly. Two
neighbours go apart where the distance between them changes by more than the longest standard deviation of either: of
Gaussians of a thing and of what it stands on, a vertex follows those that are more, and faces between them tear.
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Directions, Floats, Indices, Integers, Mask, Points
from ..base.threads import in_batches
from ..scene.scene import Scene
from ..splats.frames import has_moved
from ..splats.splats import Splats
from .album import ROUNDING

NEAREST = 6
"""Nearest vertices to use beside the nearest point of the surface. On a tabletop 1 gains 0.3 dB but follows the noise
of the mesh, and 32 lose 0.5 to 0.9."""

NEAR = 2e-3
"""Distance, in diagonals, below which all points weigh the same. Centres of Gaussians scatter about the surface by 0.3
to 0.7%."""

ROUND = 0.5
"""Ratio of shortest to middle axis from which a Gaussian has no normal. The flatter, the more its normal counts."""

LEAST_AGREEMENT = 0.02
"""Weight of a point whose normal is at right angles to that of a flat Gaussian, over one that agrees. Where the nearest
surface is a neighbour's side, such as the foot of an object on a table, points that agree come first."""


class Pose(NamedTuple):
    """Points of a surface in another pose, in the frame of the splats.

    before: (M, 3), in the first one. points, normals: (M, 3). moved: (M,) bool. extents: (M,), by which distances from
    them may change until neighbours are apart.
    """

    before: Points
    points: Points
    normals: Directions
    moved: Mask
    extents: Floats

    def torn(self, corners: Integers) -> Mask:
        """Which faces, (F, 3) points each, are torn: (F,) bool."""
        torn = np.zeros(len(corners), bool)
        some = np.flatnonzero(self.moved[corners].any(axis=1))
        for side in range(3):
            a, b = corners[some, side], corners[some, side - 1]
            lengths = [np.linalg.norm(each[a] - each[b], axis=1) for each in (self.before, self.points)]
            torn[some] |= np.abs(lengths[1] - lengths[0]) > np.maximum(self.extents[a], self.extents[b])
        return torn

    def vertices(self, like: Scene, node: Indices) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """The vertices and normals (V, 3) of a Scene in this pose, in its frame. node: (V,) its vertices' points."""
        matrix, rows = np.asarray(like.scene_from_splat, np.float64), self.moved[node]
        vertices, normals = like.vertices.copy(), like.normals.copy()
        vertices[rows] = self.points[node[rows]] @ matrix[:3, :3].T + matrix[:3, 3]
        turned = self.normals[node[rows]] @ np.linalg.inv(matrix[:3, :3])
        normals[rows] = turned / np.linalg.norm(turned, axis=1, keepdims=True)
        return vertices, normals


class Carrier:
    """Points of a surface as Splats carry them. points, normals: (M, 3) in the first pose, in the frame of the splats.
    diagonal: of its box. first: Splats there. rows: of those that count."""

    def __init__(self, points: Points, normals: Directions, diagonal: float, first: Splats, rows: Indices) -> None:
        self._points, self._normals, self._rows, self._first = points, normals, rows, first.take(rows)
        count = min(NEAREST, len(rows))
        distance, around = scipy.spatial.cKDTree(self._first.means).query(points, count)
        self._around = around.reshape(len(points), count)
        axes, flat = shortest_axes(self._first)
        agrees = agreement(normals, flat[self._around], axes[self._around])
        near = NEAR * diagonal
        self._weights = agrees / (distance.reshape(self._around.shape) ** 2 + near * near)
        self._weights /= self._weights.sum(axis=1, keepdims=True)
        self._extents = self._first.scales.max(axis=1).astype(np.float64)

    def at(self, splats: Splats) -> Pose:
        """Where other Splats, row by row the same, carry them. A point that follows Gaussians at rest rests."""
        now = splats.take(self._rows)
        shifted = has_moved(now, self._first)
        points, normals = self._points.copy(), self._normals.copy()
        moved, asked = np.zeros(len(points), bool), np.flatnonzero(shifted[self._around].any(axis=1))

        def carry(part: slice) -> None:
            nodes = asked[part]
            around, weights = self._around[nodes], self._weights[nodes]
            before, after = (each.means[around].astype(np.float64) for each in (self._first, now))
            weights = weights * _together(before, after, self._extents[around], weights)
            own = np.flatnonzero((weights * shifted[around]).sum(axis=1) > 0.5 * weights.sum(axis=1))
            nodes, gaussians = nodes[own], (weights[own], before[own], after[own])
            turn, shift = _rigid(*gaussians)
            points[nodes] = np.einsum("nij,nj->ni", turn, self._points[nodes]) + shift
            normals[nodes] = np.einsum("nij,nj->ni", turn, self._normals[nodes])
            moved[nodes] = True

        in_batches(carry, len(asked))
        extents = np.einsum("nk,nk->n", self._weights, self._extents[self._around])
        return Pose(self._points, points, normals, moved, extents)


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
    # Where Gaussians stand on one line, the least turn is taken.
    product += ROUNDING * np.abs(product).sum(axis=(1, 2), keepdims=True) * np.eye(3)
    left, _, right = np.linalg.svd(product)
    left[:, :, 2] *= np.linalg.det(left @ right)[:, None]
    turn = left @ right
    return turn, middle[1] - np.einsum("nij,nj->ni", turn, middle[0])


def shortest_axes(splats: Splats) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Shortest axes (N, 3) float32, of either sign, and how flat the Gaussians are, (N,) in [0, 1]."""
    shortest = splats.scales.argmin(axis=1)
    axes = np.take_along_axis(splats.rotation_matrices(), shortest[:, None, None], axis=2)[:, :, 0]
    ranked = np.sort(splats.scales, axis=1)
    return axes, np.maximum(1.0 - (ranked[:, 0] / np.maximum(ranked[:, 1], 1e-30) / ROUND) ** 2, 0.0)


def agreement(axes: Directions, flat: Floats, normals: Directions) -> Floats:
    """Weights in [LEAST_AGREEMENT, 1] of places with normals (N, k, 3) for Gaussians with these axes (N, 3): (N, k).
    flat: of the Gaussians, which may change places with the normals."""
    cosine = np.einsum("nc,nkc->nk", axes, normals)
    return 1.0 - flat * (1.0 - LEAST_AGREEMENT) * (1.0 - np.minimum(cosine * cosine, 1.0))
