"""The surface that pixels of a splat's picture show: position, angle and mirrored direction."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Floats, Points
from splat2mesh.render.raycaster import Hits, corner_weights
from splat2mesh.surface.sight import LEAST_COSINE

from ..splats.attachment import Surface
from ..splats.blending import Blending
from ..splats.looks import Looks

LIFT = 4e-3
"""Offset of reflected rays above the mesh, in diagonals, to avoid its noise."""


class SurfacePixels(NamedTuple):
    """Q pixels of one view. known: their numbers among the pixels of `blending`. corners, weights: (Q, 3), the nodes
    that each shows. points: (Q, 3). normals, toward, mirrored: (Q, 3) unit, the second to the eye. cosine: (Q,) between
    the first two. eye: (3,). All in the frame of the splat."""

    blending: Blending
    known: NDArray[np.int64]
    corners: NDArray[np.int32]
    weights: NDArray[np.float32]
    points: Points
    normals: Directions
    toward: Directions
    mirrored: Directions
    cosine: NDArray[np.float64]
    eye: NDArray[np.float64]

    @classmethod
    def of_view(cls, looks: Looks, surface: Surface, number: int) -> "SurfacePixels":
        """The pixels of one of the views of Looks at a Surface."""
        one = looks.of_view(number)
        weights = corner_weights(one.uv)
        points = _mixed(surface.points, one.corners, weights)
        normals = _unit(_mixed(surface.normals, one.corners, weights))
        toward = _unit(one.eyes[0] - points)
        cosine = np.einsum("ij,ij->i", normals, toward)
        normals = _unit(normals + np.maximum(LEAST_COSINE - cosine, 0.0)[:, None] * toward)
        cosine = np.einsum("ij,ij->i", normals, toward)
        mirrored = 2.0 * cosine[:, None] * normals - toward
        return cls(
            one.blending,
            one.known,
            one.corners,
            weights,
            points,
            normals,
            toward,
            mirrored,
            cosine,
            one.eyes[0],
        )

    @property
    def nodes(self) -> NDArray[np.int32]:
        """(Q,) the node that each shows most of."""
        return self.corners[np.arange(len(self.corners)), self.weights.argmax(axis=1)]

    def take(self, rows: NDArray[np.bool_]) -> "SurfacePixels":
        """Some of them, rows (Q,) bool."""
        names = ("known", "corners", "weights", "points", "normals", "toward", "mirrored", "cosine")
        return self._replace(**{name: getattr(self, name)[rows] for name in names})

    def hits(self, surface: Surface, directions: Directions) -> Hits:
        """The hits of rays (Q, 3) from the pixels' positions."""
        start = self.points + LIFT * surface.diagonal * self.normals
        return surface.caster.first_hits(np.concatenate([start, directions], axis=1).astype(np.float32))

    def of_nodes(self, values: Floats) -> NDArray[np.float64]:
        """Values (M, C) of nodes at the pixels, (Q, C)."""
        return _mixed(values, self.corners, self.weights)


def _mixed(values: Floats, corners: NDArray[np.int32], weights: NDArray[np.float32]) -> NDArray[np.float64]:
    return np.einsum("qk,qkc->qc", weights.astype(np.float64), values[corners].astype(np.float64))


def _unit(vectors: Floats) -> Directions:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
