"""The mesh of a tile as binary glTF: unlit, linear vertex colours of 16 bits, the same bytes on every machine."""

import numpy as np
from numpy.typing import NDArray

from ..scene.glb import UNLIT, Glb, matt


def glb_bytes(
    points: NDArray,  # (V, 3)
    normals: NDArray,  # (V, 3) unit
    faces: NDArray,  # (F, 3)
    color_linear: NDArray,  # (V, 3) in [0, 1]
) -> bytes:
    """One mesh of at least one face. Positions are float32 about their middle, which a node carries as a translation:
    far from the origin of a city float32 alone would be coarse."""
    middle = np.round((points.min(axis=0) + points.max(axis=0)).astype(np.float64) / 2)
    safe = np.where((np.abs(normals) > 0).any(axis=1, keepdims=True), normals, [0.0, 1.0, 0.0])
    file = Glb(extensionsUsed=[UNLIT], materials=[matt("tile")])
    attributes = {
        "POSITION": file.positions(points.astype(np.float64) - middle),
        "NORMAL": file.values((safe / np.linalg.norm(safe, axis=1, keepdims=True)).astype(np.float32)),
        "COLOR_0": file.colors(color_linear),
    }
    file.mesh("tile", attributes, indices=file.triangles(faces), material=0)
    file.document.nodes[0].translation = middle.tolist()
    return file.content()
