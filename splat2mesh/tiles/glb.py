"""A mesh as binary glTF in memory: unlit, linear vertex colours of 16 bits, independent of time and machine."""

import json
import struct

import numpy as np
from numpy.typing import NDArray

from ..base.version import VERSION


def glb_bytes(
    points: NDArray,  # (V, 3)
    normals: NDArray,  # (V, 3) unit
    faces: NDArray,  # (F, 3)
    color_linear: NDArray,  # (V, 3) in [0, 1]
) -> bytes:
    """One mesh of at least one face. Positions are float32 about their middle, which a node carries as a translation:
    far from the origin of a city float32 alone would be coarse."""
    middle = np.round((points.min(axis=0) + points.max(axis=0)).astype(np.float64) / 2)
    local = (points.astype(np.float64) - middle).astype("<f4")
    safe = np.where((np.abs(normals) > 0).any(axis=1, keepdims=True), normals, [0.0, 1.0, 0.0])
    safe = (safe / np.linalg.norm(safe, axis=1, keepdims=True)).astype("<f4")
    color = np.full((len(points), 4), 65535, "<u2")
    color[:, :3] = np.round(65535 * np.clip(color_linear, 0, 1))
    arrays = [local, safe, color, faces.ravel().astype("<u4")]
    views, blob = [], b""
    for array, target in zip(arrays, (34962, 34962, 34962, 34963), strict=True):
        views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": array.nbytes, "target": target})
        blob += array.tobytes()
    count = len(points)
    accessors = [
        {
            "bufferView": 0,
            "componentType": 5126,
            "count": count,
            "type": "VEC3",
            "min": local.min(axis=0).tolist(),
            "max": local.max(axis=0).tolist(),
        },
        {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"},
        {"bufferView": 2, "componentType": 5123, "normalized": True, "count": count, "type": "VEC4"},
        {"bufferView": 3, "componentType": 5125, "count": faces.size, "type": "SCALAR"},
    ]
    surface = {"metallicFactor": 0.0, "roughnessFactor": 1.0}
    material = {"pbrMetallicRoughness": surface, "doubleSided": True, "extensions": {"KHR_materials_unlit": {}}}
    primitive = {"attributes": {"POSITION": 0, "NORMAL": 1, "COLOR_0": 2}, "indices": 3, "material": 0, "mode": 4}
    document = {
        "asset": {"version": "2.0", "generator": f"splat2mesh {VERSION}"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "translation": middle.tolist()}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [material],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": len(blob)}],
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    blob += b"\0" * (-len(blob) % 4)
    size = 12 + 8 + len(text) + 8 + len(blob)
    header = struct.pack("<4sII", b"glTF", 2, size)
    return header + struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
