"""Fairing: removes the noise of the depth maps from a mesh, most where the surface was seen least sharply."""

import numpy as np
import scipy

from ..base.arrays import Faces, Floats, Mask, Points

STRENGTH = 250.0
"""Weight of smoothness where edges are one training pixel long, or shorter, where the equations would take long to
solve and folds go. Noise has the size of Gaussians, so it counts in pixels: longer edges have averaged it already, with
the fourth power of their length."""

LEAST_THICKNESS, MOST_THICKNESS = 0.3, 2.5
"""Thickness in training pixels that is added to every vertex's, and the most that counts: even fuzz keeps its place."""

TOLERANCE, MAX_ITERATIONS = 1e-4, 300
"""Relative residual at which the solution counts as found, and iterations at most."""


def fair(
    points: Points,  # (V, 3) float64
    faces: Faces,  # (F, 3)
    thickness: Floats,  # (V,) of the surface at each vertex, in training pixels; inf where unseen
    pixel: float,  # size of a training pixel, in the points' unit
    fixed: Mask | None = None,  # (V,) bool, which stay where they are; none without
) -> Points:
    """Smooth a mesh: (V, 3) float64, the points that minimise trust x displacement^2 + strength x Laplacian^2.

    Trust falls with the square of the thickness. The Laplacian has equal weights, which also evens out the triangles;
    on borders it is 0. Source: Botsch et al., "Polygon Mesh Processing" (2010), chapter 4.
    """
    smoothness = _laplacian(faces, len(points))
    edge = np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1))
    strength = STRENGTH * min(pixel / max(edge, 1e-300), 1.0) ** 4
    bending = (strength * (smoothness.T @ smoothness)).tocsr()
    trust = 1.0 / (LEAST_THICKNESS + np.minimum(thickness, MOST_THICKNESS)) ** 2
    system = (scipy.sparse.diags_array(trust) + bending).tocsr()
    free = np.flatnonzero(~fixed) if fixed is not None else np.arange(len(points))
    faired = points.astype(np.float64)
    faired[free] += solved(system[free][:, free], -(bending @ points)[free])
    return faired


def solved(system: "scipy.sparse.csr_matrix", right: Floats) -> Floats:
    """(V, 3) solution of a positive definite system for three right sides, by conjugate gradients with the diagonal as
    preconditioner. Products are summed by einsum: those of BLAS depend on how many threads it has."""
    inverse = (1.0 / system.diagonal())[:, None]
    solution, rest, direction = np.zeros_like(right), right.copy(), np.zeros_like(right)
    enough = TOLERANCE**2 * _products(right, right)
    before = np.ones(3)
    for _ in range(MAX_ITERATIONS):
        going = _products(rest, rest) > enough
        if not going.any():
            break
        scaled = inverse * rest
        now = _products(rest, scaled)
        direction = scaled + np.where(going, now / before, 0.0) * direction
        image = system @ direction
        length = np.where(going, now / np.where(going, _products(direction, image), 1.0), 0.0)
        solution += length * direction
        rest -= length * image
        before = np.where(going, now, 1.0)
    return solution


def _products(a: Floats, b: Floats) -> Floats:
    """(3,) inner products of the columns of two (V, 3) arrays."""
    return np.einsum("ij,ij->j", a, b)


def _laplacian(faces: Faces, count: int) -> "scipy.sparse.csr_matrix":
    """(V, V) sparse: a vertex less the mean of its neighbours; rows of border vertices are 0."""
    uses = edge_uses(faces, count)
    inner = np.ones(count)
    inner[np.diff(uses.indptr) == 0] = 0.0  # in no face: it would be drawn to the origin
    inner[np.repeat(np.arange(count), np.diff(uses.indptr))[uses.data == 1]] = 0.0
    neighbors = scipy.sparse.csr_matrix((np.ones_like(uses.data), uses.indices, uses.indptr), uses.shape)
    mean = scipy.sparse.diags_array(inner / np.maximum(np.diff(uses.indptr), 1)) @ neighbors
    return (scipy.sparse.diags_array(inner) @ scipy.sparse.eye_array(count) - mean).tocsr()


def edge_uses(faces: Faces, count: int) -> "scipy.sparse.csr_matrix":
    """(V, V) sparse: the number of faces at each edge, in both directions. count: of the vertices."""
    corners = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    ends = np.concatenate([corners, corners[:, ::-1]])
    uses = scipy.sparse.csr_matrix((np.ones(len(ends)), ends.T), (count, count))
    uses.sum_duplicates()
    return uses
