"""Fronts of houses: a wall with rows of windows and doors set into it, shutters, sills, balconies, a cornice, a roof.

Windows are holes with glass and doors behind. Glazing bars and surrounds are paint: finer than the mesh.
"""

from dataclasses import dataclass

import numpy as np

from .masonry import STONES, plaster_color
from .solids import block, joined, moved, panel
from .textures import bounded, mixed, noise, plain, planks, rings

DEPTH_M, SURROUND_M, BAR_M = 0.16, 0.13, 0.05
"""How deep windows lie in the wall, and how wide their surrounds and the bars of their frames are."""

GLASS = np.array([0.045, 0.055, 0.065])
"""What panes show: a dark room."""


@dataclass(frozen=True)
class Front:
    """Where a wall stands: its lower left corner as its viewer sees it (3,), the way it looks, its width and height.

    turn_deg: 0 looks along +z, 90 along +x. In its own frame x runs along the wall, y up, z towards the viewer.
    """

    corner: tuple
    turn_deg: float
    wide: float
    tall: float

    def placed(self, solids):
        """A solid or a list of them, from the wall's frame to the scene's, as one."""
        solid = joined(solids) if isinstance(solids, list) else solids
        return moved(solid, self.corner, self.turn_deg)

    def local(self, points):
        """Points (N, 3) of the scene in the wall's frame."""
        return moved((points - np.asarray(self.corner), None), (0, 0, 0), -self.turn_deg)[0]


def facade(made, front, paint, rng, storey=None):
    """Furnish a wall with openings of one random look. paint: of the wall. storey: its floors' height in metres.

    Returns the openings, ((u0, v0), (u1, v1)) in the wall's frame.
    """
    edge = made.edge
    storey = storey or rng.uniform(2.5, 3.1)
    windows, doors = _openings(front, storey, rng)
    holes = windows + doors
    trim = np.array([plaster_color(rng), 0.75 * STONES[2], (0.66, 0.64, 0.6)])[rng.integers(3)]
    edged = rng.random() < 0.75
    sheet = panel(np.zeros(3), (front.wide, 0, 0), (0, front.tall, 0), edge, holes)
    made.add(front.placed(sheet), _surrounded(paint, front, holes, trim) if edged else paint)
    if not holes:
        return holes
    made.add([front.placed(side) for hole in holes for side in _reveals(*hole, edge)], plain(trim, 0.1, 0.7))
    if windows:
        panes = [front.placed(_back(*hole, edge)) for hole in windows]
        frame = np.array([(0.70, 0.69, 0.66), (0.08, 0.13, 0.09), (0.16, 0.085, 0.045)])[rng.integers(3)]
        made.add(panes, _glazed(front, windows, frame))
        sills = [block((u0 - 0.1, v0 - 0.08, 0), (u1 + 0.1, v0, 0.09), edge, "xXyYZ") for (u0, v0), (u1, _) in windows]
        made.add(front.placed(sills), plain(trim, 0.1, 0.5))
        _shutters(made, front, windows, rng)
        _balconies(made, front, windows, storey, rng)
    if doors:
        wood = plaster_color(rng) * 0.6
        upright = (0, 1, 0), front.local(np.eye(3) + front.corner)[:, 0]
        made.add(
            [front.placed(_back(*hole, edge)) for hole in doors],
            planks(wood, *upright, 0.16, 4.0, int(rng.integers(1000)), 0.008),
        )
        steps = [block((u0 - 0.15, 0, 0), (u1 + 0.15, 0.12, 0.35), edge, "xXYZ") for (u0, _), (u1, _) in doors]
        made.add(front.placed(steps), plain(STONES[rng.integers(1, 4)], 0.2, 0.4))
    return holes


def crowned(made, front, rng, paint, deep=5.0):
    """What is above and behind a front: its cornice, its sides and a flat or a tiled roof. deep: of the house."""
    edge, wide, tall = made.edge, front.wide, front.tall
    ends = [block((0, 0, -deep), (wide, tall, 0), 1.5 * edge, "xX")]
    out = rng.uniform(0.1, 0.35)
    cornice = [block((0, tall - 0.22, -0.3), (wide, tall, out), edge, "xXyYZ")]
    cornice.append(block((0, tall - 0.36, 0), (wide, tall - 0.22, 0.5 * out), edge, "xXyZ"))
    made.add(front.placed(cornice), plain(STONES[rng.integers(1, 4)], 0.12, 0.6))
    rise = rng.uniform(1.2, 2.4) if rng.random() < 0.6 else 0.0
    ridge = -deep / 2 if rise else -deep
    slopes = [panel(np.array([0, tall, out]), (wide, 0, 0), (0, rise, ridge - out), 1.5 * edge)]
    if rise:
        slopes.append(panel(np.array([wide, tall, -deep]), (-wide, 0, 0), (0, rise, deep / 2), 3.0 * edge))
    tiles = np.array([(0.40, 0.17, 0.09), (0.12, 0.12, 0.13), (0.30, 0.22, 0.15)])[rng.integers(3)]
    made.add(
        front.placed(slopes), rings([tiles, 0.6 * tiles, 1.15 * tiles], 0.09, 1) if rise else plain(tiles, 0.3, 0.8)
    )
    for x, order in ((0.0, [0, 2, 1]), (wide, [0, 1, 2])) if rise else ():
        ends.append((np.array([(x, tall, out), (x, tall, -deep), (x, tall + rise, ridge)]), np.array([order])))
    made.add(front.placed(ends), paint)


def _openings(front, storey, rng):
    """Holes of windows and doors in rows: two lists of ((u0, v0), (u1, v1))."""
    bays, floors = max(1, int(front.wide / rng.uniform(1.6, 2.4))), max(1, int(front.tall / storey))
    pitch, width, tall = front.wide / bays, rng.uniform(0.75, 1.05), rng.uniform(1.05, 1.55)
    door, blank = rng.integers(bays), rng.uniform(0.0, 0.3)
    windows, doors = [], []
    for floor in range(floors):
        for bay in range(bays):
            middle, low = (bay + 0.5) * pitch, floor * storey + 0.85
            skipped = rng.random() < blank
            if floor == 0 and bay == door:
                doors.append(((middle - 0.5, 0.0), (middle + 0.5, min(2.15, front.tall - 0.3))))
            elif not skipped and low + tall < front.tall - 0.4:
                windows.append(((middle - width / 2, low), (middle + width / 2, low + tall)))
    return windows, doors


def _back(low, high, edge):
    (u0, v0), (u1, v1) = low, high
    return panel(np.array([u0, v0, -DEPTH_M]), (u1 - u0, 0, 0), (0, v1 - v0, 0), edge)


def _reveals(low, high, edge):
    (u0, v0), (u1, v1) = low, high
    wide, tall, deep = u1 - u0, v1 - v0, DEPTH_M
    return [
        panel(np.array([u0, v0, 0]), (0, 0, -deep), (0, tall, 0), edge),
        panel(np.array([u1, v0, -deep]), (0, 0, deep), (0, tall, 0), edge),
        panel(np.array([u0, v0, 0]), (wide, 0, 0), (0, 0, -deep), edge),
        panel(np.array([u0, v1, -deep]), (wide, 0, 0), (0, 0, deep), edge),
    ]


def _shutters(made, front, windows, rng):
    """Open shutters beside the windows, on two walls of three."""
    color, louvres = 0.7 * plaster_color(rng), rng.random() < 0.6
    if rng.random() > 0.66:
        return
    solids = []
    for (u0, v0), (u1, v1) in windows:
        half = (u1 - u0) / 2
        spans = [(u0 - half - 0.02, u0 - 0.02), (u1 + 0.02, u1 + half + 0.02)]
        solids += [block((a, v0, 0.0), (b, v1, 0.05), made.edge, "xXyYZ") for a, b in spans]
    made.add(front.placed(solids), rings([color, 0.65 * color], 0.05, 1) if louvres else plain(color, 0.1, 0.3))


def _balconies(made, front, windows, storey, rng):
    """Slabs with railings under some windows above the ground floor."""
    high = [hole for hole in windows if hole[0][1] > storey]
    chosen = [hole for hole in high if rng.random() < 0.3]
    if not chosen:
        return
    plates, rails = [], []
    for (u0, v0), (u1, _) in chosen:
        a, b, floor, deep = u0 - 0.25, u1 + 0.25, v0 - 0.25, 0.7
        plates.append(block((a, floor - 0.14, 0), (b, floor, deep), made.edge, "xXyYZ"))
        for y in (0.3, 0.6, 0.9):
            rails.append(
                block((a, floor + y - 0.02, deep - 0.05), (b, floor + y + 0.02, deep - 0.01), made.edge, "yYzZ")
            )
        for x in np.linspace(a, b - 0.04, 5):
            rails.append(block((x, floor, deep - 0.05), (x + 0.04, floor + 0.92, deep - 0.01), made.edge, "xXzZ"))
    made.add(front.placed(plates), plain(STONES[2], 0.15, 0.4))
    made.add(front.placed(rails), (0.06, 0.065, 0.07))


def _surrounded(paint, front, holes, trim):
    """A wall's paint with a border of `trim` around its holes."""

    def surrounded(points, normals):
        color, at = paint(points, normals), front.local(points)[:, :2]
        for low, high in holes:
            away = np.maximum(np.maximum(np.subtract(low, at), np.subtract(at, high)), 0).max(axis=1)
            color = mixed(color, trim, away < SURROUND_M)
        return bounded(color)

    return surrounded


def _glazed(front, holes, frame):
    """Dark panes, some lighter with a curtain, between glazing bars."""

    def glazed(points, _):
        at = front.local(points)[:, :2]
        color = GLASS * np.exp(0.4 * noise(points, 0.7))
        for number, (low, high) in enumerate(holes):
            inside = ((at >= low) & (at <= high)).all(axis=1)
            share = (at - low) / np.subtract(high, low)
            if number % 3 == 1:
                color = mixed(color, [0.42, 0.39, 0.33], inside & (np.abs(share[:, 0] - 0.5) > 0.27))
            inset = np.minimum(at - low, np.subtract(high, at)).min(axis=1)
            middle = (np.abs(share - [0.5, 0.62]) * np.subtract(high, low)).min(axis=1)
            color = mixed(color, frame, inside & ((inset < BAR_M) | (middle < 0.6 * BAR_M)))
        return bounded(color)

    return glazed
