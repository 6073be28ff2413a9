"""Closed rooms: floor, ceiling and four walls seen from within, with windows."""

import numpy as np

from .solids import panel, slab

REVEAL, SHELL = 0.14, 0.05
"""Depth of a window's opening, and how far behind the walls a second, overlapping skin stops what leaks, in metres."""


def walls(half, tall, edge, windows=()):
    """Inner faces of a box room about the y axis: a dict of solids, and the openings (W, 3, 3).

    half: (x, z) half the floor in metres. windows: (wall, from, to) with wall one of -x +x -z +z and from, to
    (along, up): metres along the wall from its left end as seen from inside, and above the floor.
    Solids: floor, ceiling, the walls by name; lists: shell, behind all of them, and reveals and frames of the windows.
    """
    x, z = half
    corners = {  # lower left corner as seen from inside, way along
        "-z": ((-x, 0, -z), (2 * x, 0, 0)),
        "+x": ((x, 0, -z), (0, 0, 2 * z)),
        "+z": ((x, 0, z), (-2 * x, 0, 0)),
        "-x": ((-x, 0, z), (0, 0, -2 * z)),
    }
    solids = {
        "floor": panel(np.array([-x, 0, z]), (2 * x, 0, 0), (0, 0, -2 * z), edge),
        "ceiling": panel(np.array([-x, tall, -z]), (2 * x, 0, 0), (0, 0, 2 * z), 1.6 * edge),
        "shell": [],
        "reveals": [],
        "frames": [],
    }
    openings = []
    for y, up in ((-SHELL, (0, 0, -2 * z)), (tall + SHELL, (0, 0, 2 * z))):
        solids["shell"].append(panel(np.array([-x, y, -np.sign(up[2]) * z]), (2 * x, 0, 0), up, 9.0, (), 3 * SHELL))
    for name, (corner, along) in corners.items():
        holes = [(low, high) for wall, low, high in windows if wall == name]
        corner, along = np.array(corner, float), np.array(along, float)
        solids[name] = panel(corner, along, (0, tall, 0), edge, holes)
        behind = SHELL * np.cross((0, 1, 0), along / np.linalg.norm(along))
        solids["shell"].append(panel(corner + behind, along, (0, tall, 0), 9.0, holes, 3 * SHELL))
        way = along / np.linalg.norm(along)
        out = np.cross((0, 1, 0), way)  # cross(along, up) looks inward
        for (u0, v0), (u1, v1) in holes:
            openings.append([corner + u0 * way + [0, v0, 0], (u1 - u0) * way, (0, v1 - v0, 0)])

            def box(u_low, u_high, v_low, v_high, near, far, corner=corner, way=way, out=out):
                ends = corner + np.outer((u_low, u_high), way) + np.outer((near, far), out)
                ends[:, 1] += v_low, v_high
                return slab(ends.min(axis=0), ends.max(axis=0), 0.7 * edge)

            deep = 0.004, REVEAL
            solids["reveals"] += [
                box(u0 - 0.06, u0, v0 - 0.06, v1 + 0.06, *deep),
                box(u1, u1 + 0.06, v0 - 0.06, v1 + 0.06, *deep),
            ]
            solids["reveals"] += [
                box(u0, u1, v1, v1 + 0.06, *deep),
                box(u0 - 0.05, u1 + 0.05, v0 - 0.05, v0, -0.1, REVEAL),
            ]
            middle, bars = (u0 + u1) / 2, (0.06, 0.11)
            solids["frames"] += [box(u - 0.025, u + 0.025, v0, v1, *bars) for u in (u0 + 0.025, middle, u1 - 0.025)]
            solids["frames"] += [box(u0, u1, v - 0.025, v + 0.025, *bars) for v in (v0 + 0.025, v1 - 0.025)]
    return solids, np.array(openings).reshape(-1, 3, 3)
