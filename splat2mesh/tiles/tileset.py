"""3D Tiles 1.1: a tileset.json over GLB tiles, each with its coarse twin that it replaces when near. The tiles are
unlit, with linear vertex colours of 16 bits, the same bytes on every machine.

Source: OGC 22-025r4, "3D Tiles Specification 1.1". 3D Tiles are z up, glTF is y up: (x, y, z) becomes (x, -z, y).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Bounds
from ..scene.glb import UNLIT, Glb, matt
from ..scene.mesh import Mesh

FAR_ERROR = 0.02
"""Geometric error of a coarse twin, in units of its tile's diagonal."""


def tileset(
    tiles: list[dict[str, Any]],  # `name`, `bounds` (2, 3) y up, of tiles that have faces
    error: float,  # of the tiles, scene units
    twins: bool,  # whether each has a coarse twin, far.glb beside its mesh.glb
) -> dict[str, Any]:
    """The tileset.json of tiles, as a dict."""
    children = []
    for tile in tiles:
        bounds = np.array(tile["bounds"], np.float64)
        about = {"boundingVolume": {"box": _box(bounds)}}
        child = {**about, "geometricError": 0.0, "content": {"uri": f"{tile['name']}/mesh.glb"}}
        if twins:
            coarse = max(FAR_ERROR * float(np.linalg.norm(bounds[1] - bounds[0])), 2 * error)
            twin = {"refine": "REPLACE", "content": {"uri": f"{tile['name']}/far.glb"}, "children": [child]}
            child = {**about, "geometricError": coarse, **twin}
        children.append(child)
    corners = np.array([tile["bounds"] for tile in tiles], np.float64)
    whole = np.stack([corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)])
    size = float(np.linalg.norm(whole[1] - whole[0]))
    root = {"boundingVolume": {"box": _box(whole)}, "geometricError": size, "refine": "ADD", "children": children}
    return {"asset": {"version": "1.1"}, "geometricError": 2.0 * size, "root": root}


def _box(bounds: Bounds) -> list[float]:
    """Centre and half axes of a box, z up: 12 numbers. A flat one gets some height, as boxes need."""
    low, high = bounds
    half = np.maximum((high - low) / 2, 1e-3)
    x, y, z = (low + high) / 2
    return [x, -z, y, half[0], 0.0, 0.0, 0.0, half[2], 0.0, 0.0, 0.0, half[1]]


def glb_bytes(mesh: Mesh, color_linear: NDArray) -> bytes:
    """A Mesh of at least one face in other colours, (V, 3) in [0, 1]. Positions are float32 about their middle, which a
    node carries as a translation: far from the origin of a city float32 alone would be coarse."""
    points, normals = mesh.vertices, mesh.normals
    middle = np.round((points.min(axis=0) + points.max(axis=0)).astype(np.float64) / 2)
    safe = np.where((np.abs(normals) > 0).any(axis=1, keepdims=True), normals, [0.0, 1.0, 0.0])
    file = Glb(extensionsUsed=[UNLIT], materials=[matt("tile")])
    attributes = {
        "POSITION": file.positions(points.astype(np.float64) - middle),
        "NORMAL": file.values((safe / np.linalg.norm(safe, axis=1, keepdims=True)).astype(np.float32)),
        "COLOR_0": file.colors(color_linear),
    }
    file.mesh("tile", attributes, indices=file.triangles(mesh.faces), material=0)
    file.document.nodes[0].translation = middle.tolist()
    return file.content()
