"""PlayCanvas compressed PLY: 16 bytes a splat, quantised inside the bounds of chunks of 256.

Position and scale take 11-10-11 bits, the rotation 2 + 3 x 10 (smallest three), the colour 4 x 8. An
optional `sh` element holds the other harmonics as bytes over [-4, 4]. Early files have no colour bounds,
which then are 0 and 1.
Source: PlayCanvas engine, gsplat-compressed-data.
"""

import numpy as np

from ..errors import InputError
from ..splats import Splats
from .encoding import restore_largest, sh_from_color
from .inria import coefficients, gather, rest_columns

CHUNK_SPLATS = 256
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_POSITION, _SCALE, _COLOR = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")


def read(ply):
    """Splats of an opened Ply with a `chunk` element. Raises InputError when parts are missing or short."""
    chunk, vertex = ply.elements["chunk"], ply.elements.get("vertex")
    color_bounded = "min_r" in chunk.properties
    bounded = [f"{end}_{a}" for end in ("min", "max") for a in _POSITION + _SCALE + _COLOR * color_bounded]
    missing = [name for name in bounded if name not in chunk.properties]
    missing += [name for name in _PACKED if vertex is None or vertex.properties.get(name) != "u4"]
    if missing:
        raise InputError(f"{ply.path} is no compressed splat PLY: it lacks {', '.join(missing)}")
    if vertex.count == 0:
        raise InputError(f"{ply.path} holds no splats: its vertex element has 0 rows")
    chunks = -(-vertex.count // CHUNK_SPLATS)
    if chunk.count != chunks:
        raise InputError(
            f"{ply.path} is damaged: {vertex.count} splats take {chunks} chunks of {CHUNK_SPLATS}, found {chunk.count}"
        )
    bounds, rows = ply.rows("chunk"), ply.rows("vertex")
    color = _fractions(rows["packed_color"], (8, 8, 8, 8))
    color_srgb = color[:, :3]
    if color_bounded:
        _stretch(color_srgb, bounds, _COLOR)
    return Splats(
        _stretch(_fractions(rows["packed_position"], (11, 10, 11)), bounds, _POSITION),
        np.exp(_stretch(_fractions(rows["packed_scale"], (11, 10, 11)), bounds, _SCALE)),
        _quats_wxyz(rows["packed_rotation"]),
        color[:, 3],
        _with_rest(ply, sh_from_color(color_srgb)),
    )


def _stretch(fractions, bounds, names):
    """Turn (N, 3) fractions, in place, into values between the bounds of the chunk of each row."""
    chunk = np.arange(len(fractions)) // CHUNK_SPLATS
    for column, name in zip(fractions.T, names, strict=True):
        low, high = (bounds[f"{end}_{name}"].astype(np.float32) for end in ("min", "max"))
        column *= (high - low)[chunk]
        column += low[chunk]
    return fractions


def _fractions(packed, bits):
    """Bit fields, highest first, as shares of their maxima: (N,) uint32 -> (N, fields) float32."""
    fractions, shift = np.zeros((len(packed), len(bits)), np.float32), 32
    for i, width in enumerate(bits):
        shift -= width
        limit = (1 << width) - 1
        fractions[:, i] = ((packed >> shift) & limit) / np.float32(limit)
    return fractions


def _quats_wxyz(packed):
    small = (_fractions(packed, (2, 10, 10, 10))[:, 1:] - 0.5) * np.float32(np.sqrt(2))
    return restore_largest(small, packed >> 30)


def _with_rest(ply, dc):
    """Join the constant coefficients and those of the `sh` element: (N, 3) -> (N, K, 3)."""
    if "sh" not in ply.elements:
        return dc[:, None]
    element = ply.elements["sh"]
    if element.count != len(dc) or set(element.properties.values()) - {"u1"}:
        raise InputError(f"{ply.path}: expected {len(dc)} rows of bytes in the sh element, found {element.count} rows")
    sh = np.zeros((len(dc), coefficients(ply.path, element.properties), 3), np.float32)
    gather(ply.rows("sh"), rest_columns(sh))
    # 256 cells over [-4, 4], each read at its centre; the two outermost mean the ends themselves.
    centers = (np.arange(256, dtype=np.float32) + 0.5) / 32 - 4
    centers[[0, 255]] = -4, 4
    sh[:, 1:] = centers[sh[:, 1:].astype(np.uint8)]
    sh[:, 0] = dc
    return sh
