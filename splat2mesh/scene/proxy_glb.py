"""Bodies for collisions as binary glTF: positions and triangles only, one node a body."""

import json
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..base.version import VERSION


def proxy_glb(
    bodies: Sequence[tuple[NDArray, NDArray]],  # vertices (V, 3) in the scene frame, faces (F, 3)
    suffix: str,
) -> bytes:
    """Make the file of bodies for collisions.

    bodies: sequence of (ndarray, ndarray), vertices (V, 3) in the scene frame, faces (F, 3). suffix: suffix of the
    nodes' names, proxy_000 and so on, from which Godot infers their purpose.
    """
    views: list[dict] = []
    accessors: list[dict] = []
    blob = b""
    for vertices, faces in bodies:
        points, corners = np.ascontiguousarray(vertices, "<f4"), np.ascontiguousarray(faces, "<u4")
        for array, target in ((points, 34962), (corners, 34963)):
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes, "target": target})
            blob += array.tobytes()
        box = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        at = len(accessors)
        accessors.append({"bufferView": at, "componentType": 5126, "count": len(points), "type": "VEC3", **box})
        accessors.append({"bufferView": at + 1, "componentType": 5125, "count": corners.size, "type": "SCALAR"})
    count = range(len(bodies))
    document = {
        "asset": {"version": "2.0", "generator": f"splat2mesh {VERSION}"},
        "scene": 0,
        "scenes": [{"nodes": list(count)}],
        "nodes": [{"mesh": i, "name": f"proxy_{i:03d}{suffix}"} for i in count],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 2 * i}, "indices": 2 * i + 1}]} for i in count],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    header = struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + len(blob))
    return header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
