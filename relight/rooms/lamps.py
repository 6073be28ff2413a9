"""Lamps of a room: connected parts of its surface that were captured white, and the emission of each.

A photograph shows a lamp as white, however bright it is. Its position and size are visible; its brightness is not, and
is solved for from the surfaces that it lights (`strengths`).
"""

from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Integers, Mask
from splat2mesh.render.raycaster import FREE

from ..transfer.neighbors import ranked_nodes
from ..transfer.occluder import Occluder
from .interior import MOST_CLOSED

WHITE, PALE = 0.85, 0.75
"""Least linear value of the brightest channel: somewhere on a lamp, and everywhere on it. A clipped pixel is 1, but a
vertex takes the mean of what lies around it, and around a small lamp it is dark."""

LEAST_PALE = 0.6
"""Least linear value of a lamp's dimmest channel: a channel that was not clipped shows the radiance as it is. A wall
that a lamp lights is as bright in red, and has the lamp's colour."""

GLOWS = 1.2
"""A vertex that is this many times brighter than white would be in the light of the surfaces around it glows, or is lit
by something that was clipped."""

LEAST_AREA = 2.5e-4
"""In squared diagonals of the scene: 1.4 dm^2 in a room of 7.5 m across. Two pendants of an office have .014, the lamp
of a lounge .006; what glints in such rooms stays below 2e-4."""

MOST_LAMPS = 12
"""Only the largest count: a room has few, and each costs rays from every vertex."""

SMOOTH = 0.7
"""Least cosine between the normals of neighbours on one lamp: the wall that it hangs on is as white beside it."""

UPWARD = 0.5
"""Height of the mean normal above which something white is no lamp, but a floor or a table top in the sun."""

FLAT = 0.85
"""Length of the mean normal from which something white is a flat patch: on a ceiling a lamp, on a wall more likely a
spot of sun, a window or a screen."""

SPOTS = 24
"""Points on each lamp that light comes from: the hard edges of so many shadows lie closer together than vertices."""

LIFT = 2e-3
"""Distance, in diagonals, of these points from the lamp's own, uneven surface."""


class Lamp(NamedTuple):
    """rows: vertices, sorted. area: of the squared diagonal. place: (3,) float64, mean position, unit frame.

    normal: (3,) the mean direction that it faces, of any length. color: (3,) captured, linear, of it and of what
    glows about it: where it was clipped it is white.
    """

    rows: NDArray[np.int64]
    area: float
    place: NDArray[np.float64]
    normal: NDArray[np.float64]
    color: NDArray[np.float64]


class Pieces:
    """Connected parts of the surface of V vertices, across edges that are smooth; vertices that agree in place and
    normal count as one."""

    def __init__(self, occluder: Occluder) -> None:
        order, new_node, _ = ranked_nodes(occluder.origins, occluder.normals)
        self._node = np.zeros(len(order), np.int64)
        self._node[order] = np.cumsum(new_node) - 1
        self.count = int(self._node.max()) + 1
        edges = np.concatenate([occluder.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
        smooth = np.einsum("ij,ij->i", *(occluder.normals[end] for end in edges.T)) > SMOOTH
        self._edges = self._node[edges[smooth]]

    def of(self, chosen: Mask) -> Integers:
        """Number of the connected piece of each vertex, (V,), below `count`; -1 for those that are not chosen."""
        taken = np.bincount(self._node, chosen, self.count) > 0
        joined = self._edges[taken[self._edges].all(axis=1)]
        _, label = scipy.sparse.csgraph.connected_components(
            scipy.sparse.coo_array((np.ones(len(joined)), joined.T), (self.count, self.count)), directed=False
        )
        return np.where(taken[self._node], label[self._node], -1)


def find(
    occluder: Occluder,
    captured: NDArray[np.float32],  # (V, 3) linear, clipped at 1
    areas: NDArray[np.float64],  # (V,) around each vertex, in squared diagonals
    visible: NDArray[np.floating],  # (V,) visible fraction of the sky
    bounce: NDArray[np.float32],  # (V, 3) radiance of white under the captured colours around it
) -> list[Lamp]:
    """Find the lamps of a room by their captured colours, the largest first. They depend neither on the order of
    vertices nor on the division into chunks."""
    peak, pieces = captured.max(axis=1), Pieces(occluder)
    pale = (peak > PALE) & (peak > GLOWS * bounce.max(axis=1))
    clipped = pale & (captured.min(axis=1) > LEAST_PALE)
    of_vertex, glow = pieces.of(clipped), pieces.of(pale)
    kept = of_vertex >= 0
    size = np.bincount(of_vertex[kept], areas[kept], pieces.count)
    core = np.bincount(of_vertex[kept], peak[kept] > WHITE, pieces.count) > 0
    found = []
    for chosen in np.flatnonzero((size > LEAST_AREA) & core):
        rows = np.flatnonzero(of_vertex == chosen)
        weight = areas[rows] / areas[rows].sum()
        normal = weight @ occluder.normals[rows].astype(np.float64)
        upright = np.linalg.norm(normal) > FLAT and normal[1] > -UPWARD
        if upright or normal[1] > UPWARD or weight @ visible[rows] > MOST_CLOSED:  # the sky, meshed behind a pane
            continue
        around = np.flatnonzero(glow == glow[rows[0]])
        color = areas[around] / areas[around].sum() @ captured[around].astype(np.float64)
        place = weight @ occluder.origins[rows].astype(np.float64)
        found.append(Lamp(rows, float(size[chosen]), place, normal, color))
    found.sort(key=lambda lamp: (-lamp.area, *lamp.place))
    return found[:MOST_LAMPS]


def light_of(
    lamp: Lamp,
    occluder: Occluder,
    areas: NDArray[np.float64],  # (V,) around each vertex, in squared diagonals
    normals: NDArray[np.float32],  # (V, 3) of the vertices that are lit
) -> NDArray[np.float32]:
    """Radiance (V,) of white vertices under a lamp whose own is 1 all over: the sum over spots on it of cosine times
    cosine over pi times the squared distance, where the way is free."""
    order, _, _ = ranked_nodes(occluder.origins[lamp.rows], occluder.normals[lamp.rows])
    rows = lamp.rows[order]
    reached = np.cumsum(areas[rows])
    at = np.searchsorted(reached, (np.arange(SPOTS) + 0.5) / SPOTS * reached[-1])
    share, light = lamp.area / SPOTS, np.zeros(len(occluder.origins))
    for row in rows[np.minimum(at, len(rows) - 1)]:
        outward = occluder.normals[row].astype(np.float64)
        spot = occluder.origins[row] + LIFT * outward
        toward = spot - occluder.origins
        square = np.einsum("ij,ij->i", toward, toward)
        cosine = np.maximum(np.einsum("ij,ij->i", normals, toward), 0.0) * np.maximum(-(toward @ outward), 0.0)
        lit = np.flatnonzero(cosine > 0.0)
        rays = np.hstack([occluder.origins[lit], toward[lit]]).astype(np.float32)
        lit = lit[~occluder.occluded(rays, FREE)]
        light[lit] += cosine[lit] / np.maximum(square[lit], share) ** 2 * (share / np.pi)
    return light.astype(np.float32)
