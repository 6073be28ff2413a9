"""Lamps that a person points at: lamps not found by colour alone, grown from the place pointed at."""

from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError

from ..transfer.neighbors import ranked_nodes
from ..transfer.occluder import Occluder
from .lamps import GLOWS, SMOOTH, Lamp

FAR = 0.05
"""Largest distance from a surface, in diagonals, at which a position points at it."""

NEAR = 0.015
"""The same, about the nearest surface: the brightest vertex there is meant. 11 cm in a room of 7.5 m across; a place
that is read off a viewer lies that far beside a small lamp."""

REACH = 0.1
"""The same, about that vertex: how far the lamp goes at most, or a white wall beside it would be part of it."""

LEAST_PEAK = 0.3
"""Least linear value of the brightest channel of a possible lamp, over white."""

AS_BRIGHT, AS_GLOW = 0.75, 0.5
"""Of the brightest vertex: least peak of what belongs to its lamp, and of the glow around it, which has its colour."""


def lamps_at(
    occluder: Occluder,
    captured: NDArray[np.float32],
    areas: NDArray[np.float64],
    bounce: NDArray[np.float32],
    places: NDArray[np.floating],
    names: Sequence[str],
    found: Sequence[Lamp],
) -> tuple[list[Lamp], list[int]]:
    """Find the lamps that places point at.

    Parameters
    ----------
    occluder : Occluder
        The scene, V vertices.
    captured : ndarray of float32, (V, 3)
        Linear, clipped at 1.
    areas : ndarray of float64, (V,)
        Around each vertex, in squared diagonals.
    bounce : ndarray of float32, (V, 3)
        What white would send on of the captured colours around it.
    places : ndarray, (P, 3)
        Unit frame of the occluder.
    names : sequence of str
        Name of each position in messages.
    found : sequence of Lamp
        The known lamps; a place on one of them means it.

    Returns
    -------
    more : list of Lamp
        Further ones, in the order of the places.
    numbers : list of int
        Which lamp each place means, of `found` and `more` in a row.

    Raises
    ------
    InputError
        For a place with no surface near it, or with nothing bright on that.
    """
    more: list[Lamp] = []
    numbers = []
    for place, name in zip(np.asarray(places, np.float64), names, strict=True):
        away = np.linalg.norm(occluder.origins - place, axis=1)
        nearest = float(away.min())
        if not nearest <= FAR:
            problem = f"the nearest surface is {nearest:.0%} of the scene's diagonal away"
            raise InputError(f"`lamps` {name}: {problem}; expected a place on a lamp, in the frame of the splat")
        around = np.flatnonzero(away <= nearest + NEAR)
        known = [*found, *more]
        meant = [number for number, lamp in enumerate(known) if np.isin(around, lamp.rows).any()]
        if not meant:
            seed = around[np.lexsort((away[around], -captured[around].max(axis=1)))[0]]
            peak = float(captured[seed].max())
            if peak < LEAST_PEAK:
                problem = f"what is there was captured at {peak:.2f} of white; a lamp is at {LEAST_PEAK:g} or more"
                raise InputError(f"`lamps` {name}: {problem}")
            more.append(_grown(occluder, captured, areas, bounce, int(seed), known))
            meant = [len(known)]
        numbers.append(min(meant, key=lambda number: away[[*found, *more][number].rows].min()))
    return more, numbers


def _grown(
    occluder: Occluder,
    captured: NDArray[np.float32],
    areas: NDArray[np.float64],
    bounce: NDArray[np.float32],
    seed: int,
    known: Sequence[Lamp],
) -> Lamp:
    """The lamp around a vertex: the connected vertices about as bright as it, glowing if it glows."""
    peak = captured.max(axis=1)
    near: Mask = np.linalg.norm(occluder.origins - occluder.origins[seed], axis=1) < REACH
    for lamp in known:
        near[lamp.rows] = False
    glows = peak > GLOWS * bounce.max(axis=1)
    if glows[seed]:
        near &= glows
    rows = _joined(occluder, near & (peak >= AS_BRIGHT * peak[seed]), seed)
    around = _joined(occluder, near & (peak >= AS_GLOW * peak[seed]), seed)

    def mean(of: NDArray[np.int64], values: NDArray[np.floating]) -> NDArray[np.float64]:
        weight = np.maximum(areas[of], 1e-12)
        return np.asarray(weight / weight.sum() @ values[of].astype(np.float64), np.float64)

    area = float(np.maximum(areas[rows], 1e-12).sum())
    return Lamp(rows, area, mean(rows, occluder.origins), mean(rows, occluder.normals), mean(around, captured))


def _joined(occluder: Occluder, chosen: Mask, seed: int) -> NDArray[np.int64]:
    """The chosen vertices (V,) connected to one of them, sorted."""
    order, new_node, _ = ranked_nodes(occluder.origins, occluder.normals)
    node = np.zeros(len(chosen), np.int64)
    node[order] = np.cumsum(new_node) - 1
    count = int(node.max()) + 1
    edges = np.concatenate([occluder.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])])
    smooth = np.einsum("ij,ij->i", *(occluder.normals[end] for end in edges.T)) > SMOOTH
    taken = np.bincount(node, chosen, count) > 0
    joined = node[edges[smooth & taken[node[edges]].all(axis=1)]]
    _, label = scipy.sparse.csgraph.connected_components(
        scipy.sparse.coo_array((np.ones(len(joined)), joined.T), (count, count)), directed=False
    )
    return np.flatnonzero(taken[node] & (label[node] == label[node[seed]]))
