"""3D Tiles 1.1: a tileset.json over GLB tiles, each with its coarse twin that it replaces when near.

Source: OGC 22-025r4, "3D Tiles Specification 1.1". 3D Tiles are z up, glTF is y up: (x, y, z) becomes (x, -z, y).
"""

from typing import Any

import numpy as np

from ..base.arrays import Bounds

FAR_ERROR = 0.02
"""Geometric error of a coarse twin, in units of its tile's diagonal."""


def tileset(
    tiles: list[dict[str, Any]],  # `name`, `bounds` (2, 3) y up, of tiles that have faces
    fine: str,  # file of a tile
    coarse: str | None,  # file of its coarse twin
    error: float,  # of the fine tiles, scene units
) -> dict[str, Any]:
    """The tileset.json of tiles, as a dict."""
    children = []
    for tile in tiles:
        bounds = np.array(tile["bounds"], np.float64)
        diagonal = float(np.linalg.norm(bounds[1] - bounds[0]))
        leaf = {"boundingVolume": {"box": _box(bounds)}, "geometricError": 0.0, "content": _content(tile, fine)}
        if coarse is None:
            children.append(leaf)
            continue
        children.append(
            {
                "boundingVolume": {"box": _box(bounds)},
                "geometricError": max(FAR_ERROR * diagonal, 2 * error),
                "refine": "REPLACE",
                "content": _content(tile, coarse),
                "children": [leaf],
            }
        )
    corners = np.array([tile["bounds"] for tile in tiles], np.float64)
    whole = np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
    size = float(np.linalg.norm(whole[1] - whole[0]))
    root = {"boundingVolume": {"box": _box(whole)}, "geometricError": size, "refine": "ADD", "children": children}
    return {"asset": {"version": "1.1"}, "geometricError": 2.0 * size, "root": root}


def _content(tile: dict[str, Any], file: str) -> dict[str, str]:
    return {"uri": f"{tile['name']}/{file}"}


def _box(bounds: Bounds) -> list[float]:
    """Centre and half axes of a box, z up: 12 numbers. A flat one gets some height, as boxes need."""
    low, high = bounds
    half = np.maximum((high - low) / 2, 1e-3)
    x, y, z = (low + high) / 2
    return [x, -z, y, half[0], 0.0, 0.0, 0.0, half[2], 0.0, 0.0, 0.0, half[1]]
