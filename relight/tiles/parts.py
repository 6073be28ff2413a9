"""Tiles in parts: the memory limit of a process decides how many vertices are lit at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.tiles.memory import BASE_GB, check_memory
from splat2mesh.tiles.plan import grown, within_box

GB_PER_LIT, GB_PER_NEAR, GB_PER_SPLAT = 2.8e-6, 1.2e-6, 1.0e-6
"""Bytes of a process's peak memory per vertex whose own light is computed, per vertex around them, and per splat of the
tile."""

USUAL_GB = 4.0
"""Default GiB of a process."""

LEAST_VERTICES = 64
"""Least vertices of a part: a smaller one is mostly surroundings."""

LEAST_SHARE = 1 / 64
"""Least share of the distance within which a part sees its surroundings unsimplified, before it is cut further."""


class TilePart(NamedTuple):
    """A rectangle of a tile that is lit separately.

    core: (2, 2) lowest and highest x and z of the tile. box: (2, 2) of the part. distance: around it, within which
    everything is unsimplified.
    """

    core: NDArray[np.float64]
    box: NDArray[np.float64]
    distance: float

    def holds(self, places: NDArray) -> NDArray[np.bool_]:
        """(N,) bool of positions of the tile, (N, 2) x and z. Those beyond its core belong to the part beside them, so
        each is in exactly one part."""
        low, high = self.core
        return within_box(np.clip(places, low, np.nextafter(high, low)), self.box)

    @property
    def grown(self) -> NDArray[np.float64]:
        """(2, 2) the box with its unsimplified surroundings."""
        return grown(self.box, self.distance)


def room_for(memory_gb: float | None, splats: int, coarse: int) -> float:
    """Vertices whose light a process can compute at once, beside the splats of a tile and the coarse city. Raises
    InputError for a memory that those alone fill."""
    memory_gb = USUAL_GB if memory_gb is None else memory_gb
    taken = BASE_GB + splats * GB_PER_SPLAT + coarse * GB_PER_NEAR
    check_memory(memory_gb, taken + LEAST_VERTICES * GB_PER_LIT)
    return (memory_gb - taken) / GB_PER_LIT


def parts_of(
    own: NDArray,  # (V, 2) x and z of a tile's vertices
    around: NDArray,  # (W, 2) of the vertices of neighbours near it
    core: NDArray,  # (2, 2) lowest and highest x and z
    distance: float,  # around it, within which everything is unsimplified
    most: float,  # vertices, of `room_for`
) -> list[TilePart]:
    """The parts of a tile. Cuts go across the longer side, at half of the vertices.

    If a part is no wider than its surroundings and still exceeds the limit, the distance is halved.
    """
    core = np.asarray(core, np.float64)
    whole = TilePart(core, core, distance)
    places, lit = np.concatenate([own, around]), np.arange(len(own) + len(around)) < len(own)
    lit_share = GB_PER_NEAR / GB_PER_LIT
    pending, done = [(whole, np.arange(len(places)))], []
    while pending:
        part, rows = pending.pop()
        near = rows[within_box(places[rows], part.grown) | (lit[rows] & part.holds(places[rows]))]
        inside = near[lit[near] & part.holds(places[near])]
        cost = len(inside) + lit_share * (len(near) - len(inside))
        sides = part.box[1] - part.box[0]
        can_shrink = part.distance > LEAST_SHARE * distance
        can_cut = len(inside) >= 2 * LEAST_VERTICES and sides.max() > LEAST_SHARE * distance
        if cost <= most or not (can_shrink or can_cut):
            done.append(part)
        elif can_shrink and (sides.max() < 2 * part.distance or not can_cut):
            pending.append((part._replace(distance=part.distance / 2), rows))
        else:
            axis = int(sides.argmax())
            middle = float(np.median(places[inside, axis]))
            if not part.box[0, axis] < middle < part.box[1, axis]:
                middle = float(part.box[:, axis].mean())
            low, high = part.box.copy(), part.box.copy()
            low[1, axis] = high[0, axis] = middle
            pending += [(part._replace(box=high), near), (part._replace(box=low), near)]
    return done
