"""Cards: small quads in place of leaves, each the two long axes of a Gaussian, in its colour."""

import numpy as np
import scipy

from ..base.arrays import Floats, Indices, Points
from ..scene.color import bytes_from_unit
from ..scene.mesh import Mesh
from ..splats.harmonics import SH_C0
from ..splats.splats import SOLID, Splats

REACH = 0.05
"""Distance from the hull of leaves, in diagonals of the scene, up to which Gaussians belong to it."""

MOST_GROWTH = 2.0
"""How much longer and wider the cards may become to stand for those that the budget leaves out."""

FACES = 2
"""Of a card."""


def leaf_splats(splats: Splats, surface: Points, hull: Mesh, diagonal: float) -> Indices:
    """Rows of the splats that are leaves: opaque, and nearer to the hull than to the rest of the mesh. splats: Splats
    in the frame of the hull. surface: (V, 3) vertices of the rest, which may be none. diagonal: of the scene."""
    opaque = np.flatnonzero(splats.opacities > SOLID)
    points = splats.means[opaque]
    to_hull, _ = scipy.spatial.cKDTree(hull.vertices).query(points, workers=-1)
    to_mesh = np.full(len(points), np.inf)
    if len(surface):
        to_mesh, _ = scipy.spatial.cKDTree(surface).query(points, workers=-1)
    return opaque[(to_hull <= to_mesh) & (to_hull < REACH * diagonal)]


def cards(splats: Splats, hull: Mesh, budget: int) -> tuple[Mesh, float]:
    """(Mesh of cards, the part of the splats' covered area that they keep, in [0, 1]).

    A card covers as much as its Gaussian hides: the integral of its opacity. Within a budget of faces the largest come
    first, and grow up to MOST_GROWTH times for those that are left out. splats: Splats of leaves, in the frame of the
    hull, whose normals say which side of a card is outside.
    """
    covered = covered_area(splats)
    wanted = float(covered.sum())
    chosen = np.sort(np.argsort(-covered, kind="stable")[: budget // FACES])
    kept = float(covered[chosen].sum())
    growth = min(np.sqrt(wanted / max(kept, 1e-30)), MOST_GROWTH)
    some = splats.take(chosen)
    half = growth * np.sqrt(some.opacities.astype(np.float64) * np.pi / 2.0)
    order = np.argsort(-some.scales, axis=1, kind="stable")
    axes = np.take_along_axis(some.rotation_matrices().astype(np.float64), order[:, None, :], axis=2)
    lengths = np.take_along_axis(some.scales.astype(np.float64), order, axis=1)
    first, second = (axes[:, :, k] * (half * lengths[:, k])[:, None] for k in (0, 1))
    normals = np.cross(axes[:, :, 0], axes[:, :, 1])
    _, near = scipy.spatial.cKDTree(hull.vertices).query(some.means, workers=-1)
    inward = (normals * hull.normals[near]).sum(axis=1) < 0.0
    normals[inward] *= -1.0
    second[inward] *= -1.0
    corners = np.stack([-first - second, first - second, first + second, second - first], axis=1)
    vertices = (some.means[:, None, :] + corners).reshape(-1, 3).astype(np.float32)
    faces = (4 * np.arange(len(some))[:, None, None] + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3)
    colors = bytes_from_unit(np.clip(0.5 + SH_C0 * some.sh[:, 0].astype(np.float32), 0.0, 1.0))
    mesh = Mesh(
        vertices,
        np.repeat(normals, 4, axis=0).astype(np.float32),
        faces.astype(np.int32),
        np.repeat(colors, 4, axis=0),
    )
    return mesh, growth**2 * kept / max(wanted, 1e-30)


def covered_area(splats: Splats) -> Floats:
    """What each Gaussian hides seen along its shortest axis, (N,): the integral of its opacity, 2 pi o s1 s2."""
    scales = np.sort(splats.scales.astype(np.float64), axis=1)
    return 2.0 * np.pi * splats.opacities.astype(np.float64) * scales[:, 1] * scales[:, 2]
