"""A machine: hard-edged boxes, plates, shafts, a flywheel, pipes and bolts on a bed: many flat faces, few bends."""

# ruff: noqa: RUF005 - a list added to an array shifts it

import numpy as np

from . import albedo, shapes

BEVEL = 0.006
"""Rounding of the edges: sharp, but closed and welded."""

FLAWS = 0.12
"""Wavelength of dirt and worn paint."""


def machine(rng, edge):
    """Two housings on a bed, a motor with fins, shaft and flywheel, plates with bolts. The seed chooses all sizes."""
    colors, patchy = albedo.palette(rng, 12)
    bed = np.array([rng.uniform(1.1, 1.7), 0.14, rng.uniform(0.65, 0.95)])
    main = rng.uniform((0.34, 0.34, 0.34), (0.5, 0.7, 0.5))
    side = rng.uniform((0.26, 0.2, 0.26), (0.4, 0.4, 0.5))
    place = np.array([rng.uniform(-0.2, 0.05), 0.13 + main[1] / 2, rng.uniform(-0.08, 0.08)])
    beside = np.array([-0.5 * bed[0] + 0.52 * side[0] + 0.02, 0.13 + side[1] / 2, rng.uniform(-0.1, 0.1)])
    axle = place[1] + rng.uniform(-0.25, 0.15) * main[1]
    wheel, reach = min(rng.uniform(0.2, 0.34), axle - 0.15), place[0] + main[0] / 2
    groups = [
        [_box(bed, (0, 0.07, 0), edge)],
        [_box(main, place, edge), _box(main * [1.12, 0.05, 1.12], place + [0, 0.5 * main[1], 0], edge)],
        [_box(side, beside, edge)],
        [_rod((beside[0], axle, place[2]), (reach + 0.32, axle, place[2]), 0.035, edge)],
        _wheel((reach + 0.2, axle, place[2]), wheel, edge),
        _motor(place + [0, main[1] / 2 + 0.02, 0], rng.uniform(0.09, 0.14), 0.8 * main[0], edge),
        _bolted(place, main, edge),
        _feet(bed, edge),
        _pipe(place, main, beside, side, edge),
        [_box((0.16, 0.11, 0.02), beside + [0, 0.02, side[2] / 2 + 0.006], edge)],
    ]
    solids = []
    for number, group in enumerate(groups):
        points, faces = shapes.joined(group)
        solids.append((points, faces, _paint(points, colors[[number, 10 + number % 2]], patchy, rng)))
    return solids


def _box(size, middle, edge):
    size = np.asarray(size, float)
    return shapes.placed(shapes.rounded_box(size, min(BEVEL, 0.3 * size.min()), edge), middle)


def _rod(start, end, radius, edge, sides=None):
    """A sharp cylinder, or a prism of `sides` sides, between two points; its rims are chamfered."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    long = np.linalg.norm(end - start)
    sides = sides or max(12, round(2 * np.pi * radius / edge))
    rim = min(BEVEL, 0.2 * radius, 0.2 * long)
    inner = np.linspace(rim, long - rim, max(1, round(long / edge)) + 1)
    flat = np.linspace(0.0, radius - rim, max(1, round(radius / edge)) + 1)
    profile = [*((r, 0.0) for r in flat), *((radius, y) for y in inner), *((r, long) for r in flat[::-1])]
    points, faces = shapes.revolved(np.array(profile), sides)
    up = (end - start) / long
    first = np.cross(up, np.eye(3)[np.abs(up).argmin()])
    first /= np.linalg.norm(first)
    return points @ np.stack([first, up, np.cross(first, up)]) + start, faces


def _wheel(middle, radius, edge):
    """A flywheel about x: rim, hub and six spokes, as overlapping solids."""
    middle = np.asarray(middle)
    along = np.array([0.05, 0.0, 0.0])
    ring, faces = shapes.torus(radius, 0.035, edge)
    solids = [(ring[:, [1, 0, 2]] * [1, -1, 1] + middle, faces), _rod(middle - along, middle + along, 0.07, edge)]
    for turn in np.arange(6) * np.pi / 3:
        way = np.array([0.0, np.cos(turn), np.sin(turn)])
        solids.append(_rod(middle + 0.05 * way, middle + (radius - 0.01) * way, 0.018, edge))
    return solids


def _motor(foot, radius, long, edge):
    """A cylinder along x on a saddle, with cooling fins around it."""
    middle = foot + [0, radius + 0.03, 0]
    half = np.array([long / 2, 0, 0])
    solids = [
        _rod(middle - half, middle + half, radius, edge),
        _box((0.7 * long, 0.09, 1.2 * radius), foot + [0, 0.03, 0], edge),
    ]
    for share in np.linspace(-0.75, 0.75, 7):
        solids.append(
            _rod(middle + share * half - [0.008, 0, 0], middle + share * half + [0.008, 0, 0], 1.18 * radius, edge)
        )
    return solids


def _bolted(place, main, edge):
    """Plates on the two long sides of the main housing, with hexagonal bolts at their corners."""
    solids = []
    for way in (-1, 1):
        face = place + [0, 0, way * main[2] / 2]
        solids.append(_box((0.72 * main[0], 0.66 * main[1], 0.03), face + [0, 0, way * 0.008], edge))
        for x in (-0.28, 0.28):
            for y in (-0.26, 0.0, 0.26):
                at = face + [x * main[0], y * main[1], way * 0.02]
                solids.append(_rod(at, at + [0, 0, way * 0.025], 0.022, edge, 6))
    return solids


def _feet(bed, edge):
    """Bolts on the corners of the bed, and rails along it."""
    solids = [_box((bed[0] * 0.98, 0.03, 0.05), (0, 0.145, s * 0.42 * bed[2]), edge) for s in (-1, 1)]
    for x in (-0.45, 0.45):
        for z in (-0.32, 0.32):
            at = np.array([x * bed[0], 0.135, z * bed[2]])
            solids.append(_rod(at, at + [0, 0.04, 0], 0.03, edge, 6))
    return solids


def _pipe(place, main, beside, side, edge):
    """A pipe from the top of the side housing up and over into the main one, with a flange."""
    start = beside + [0, side[1] / 2 - 0.01, -0.2 * side[2]]
    top = place[1] + 0.3 * main[1]
    knee = np.array([start[0], max(top, start[1] + 0.12), start[2]])
    end = np.array([place[0], knee[1], start[2]])
    solids = [_rod(start, knee + [0, 0.03, 0], 0.03, edge), _rod(knee - [0.03, 0, 0], end, 0.03, edge)]
    return [*solids, _rod(start, start + [0, 0.03, 0], 0.055, edge)]


def _paint(points, colors, patchy, rng):
    """Enamel of one colour, worn down to a second in spots, with some dirt."""
    base = albedo.mottled(points, colors[0], rng, FLAWS, 0.1 + 0.9 * patchy)
    waves = rng.normal(0.0, 2 * np.pi / (2 * FLAWS), (3, 6))
    worn = np.sin(points @ waves + rng.uniform(0, 2 * np.pi, 6)).sum(axis=1) > 3.6 - 2.2 * patchy
    return np.where(worn[:, None], colors[1], base)
