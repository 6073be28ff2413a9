"""A part grown from a point of the surface: what is joined to it by like colours, without a crease between.

Concave creases part things, convex ones belong to one (the minima rule; Hoffman and Richards, "Parts of recognition",
Cognition 18, 1984). So the angle across a concave edge counts in full and that across a convex one a fifth, each as
1 - cos (Katz and Tal, "Hierarchical mesh decomposition using fuzzy clustering and cuts", SIGGRAPH 2003). Colours are
compared in CIELAB. Lightness counts half, as in CMC(2:1) (ISO 105-J03): shadows that are left in a colour change it
most.
"""

from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Mask, Points, Vector
from splat2mesh.splats.splats import Splats

from ..light.color_spaces import REC709, xyz_from_rgb
from .attachment import FAR, Surface

CONVEX = 0.2
"""Part of the angle of a convex edge that counts."""

LIGHTNESS = 0.5
"""Part of a difference in lightness that counts."""

_XYZ = np.asarray(xyz_from_rgb(REC709))


class GrowingSurface:
    """The surface of a scene on which parts grow. surface: its Surface. colors: (V, 3) of its vertices, linear, best
    without the captured light."""

    def __init__(self, surface: Surface, colors: Floats) -> None:
        self._surface = surface
        own = surface.of_vertices(_compared(np.asarray(colors, np.float64)))
        around, degree = np.zeros_like(own), np.ones(len(own))
        for one, other in (self._edges.T, self._edges.T[::-1]):
            degree += np.bincount(one, minlength=len(own))
            for channel in range(3):
                around[:, channel] += np.bincount(one, own[other, channel], len(own))
        self._colors = (own + around) / degree[:, None]

    def grown(self, place: Vector, reach: float) -> Mask:
        """The vertices (V,) of the part around a place (3,), in the frame of the splat.

        reach: how far colours may be from that at the place, in hundreds of CIELAB units; how much a crease may turn,
        as 1 - cos.
        """
        start = int(self._used[self._tree.query(place)[1]])
        apart = np.linalg.norm(self._colors - self._colors[start], axis=1) / 100.0
        near = apart <= reach
        near[start] = True
        passed = self._edges[(self._creases <= reach) & near[self._edges].all(axis=1)]
        count = len(self._surface.points)
        graph = scipy.sparse.coo_matrix((np.ones(len(passed), bool), tuple(passed.T)), (count, count))
        _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
        found: Mask = (label == label[start])[self._surface.node]
        return found

    def splats_of(self, part: Mask, splats: Splats) -> Mask:
        """The splats (N,) whose nearest vertex is in a part (V,). Those far from the surface are in none."""
        nodes = np.zeros(len(self._surface.points), bool)
        nodes[self._surface.node] = part
        found = np.zeros(len(splats), bool)
        rows = np.flatnonzero(np.isfinite(splats.means).all(axis=1))
        reach = FAR * float(self._surface.diagonal)
        apart, nearest = self._tree.query(splats.means[rows], distance_upper_bound=reach)
        found[rows] = np.isfinite(apart) & nodes[self._used[np.minimum(nearest, len(self._used) - 1)]]
        return found

    @cached_property
    def _edges(self) -> NDArray[np.int64]:
        """Each edge once, (E, 2)."""
        faces = self._surface.faces.astype(np.int64)
        pairs = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
        keys = np.unique(pairs[:, 0] * len(self._surface.points) + pairs[:, 1])
        return np.stack(np.divmod(keys, len(self._surface.points)), axis=1)

    @cached_property
    def _creases(self) -> Floats:
        """How much each edge turns, (E,)."""
        one, other = self._edges.T
        points, normals = self._surface.points, self._surface.normals
        turn = 1.0 - np.einsum("ek,ek->e", normals[one], normals[other], dtype=np.float64)
        along, across = (each[other].astype(np.float64) - each[one] for each in (points, normals))
        concave = np.einsum("ek,ek->e", along, across) < 0.0
        return np.where(concave, turn, CONVEX * turn)

    @cached_property
    def _used(self) -> NDArray[np.int64]:
        return np.flatnonzero(self._surface.used)

    @cached_property
    def _tree(self) -> scipy.spatial.cKDTree:
        points: Points = self._surface.points[self._used]
        return scipy.spatial.cKDTree(points)


def _compared(linear: Floats) -> Floats:
    """CIELAB values (N, 3) of linear colours (N, 3), D65, in which distances count."""
    x, y, z = (linear @ _XYZ.T / _XYZ.sum(axis=1)).T
    cube = [np.where(each > (6 / 29) ** 3, np.cbrt(each), each * (29 / 6) ** 2 / 3 + 4 / 29) for each in (x, y, z)]
    lightness = LIGHTNESS * (116.0 * cube[1] - 16.0)
    return np.stack([lightness, 500.0 * (cube[0] - cube[1]), 200.0 * (cube[1] - cube[2])], axis=1)
