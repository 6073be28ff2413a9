"""PlayCanvas compressed PLY: 16 bytes a splat, quantised inside the bounds of chunks of 256.

Position and scale take 11-10-11 bits, the rotation 2 + 3 x 10 (smallest three), the colour 4 x 8. An
optional `sh` element holds the other harmonics as bytes over [-4, 4]. Early files have no colour bounds,
which then are 0 and 1.
Source: PlayCanvas engine, gsplat-compressed-data.
"""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ...base.outputs import staged_file
from ..facts import comments_of, facts_of_comments
from ..splats import Splats
from .encoding import (
    color_from_sh,
    hide_unusable,
    levels,
    restore_largest,
    sh_from_color,
    smallest_three,
    warn_beyond,
    warn_clipped,
)
from .inria import DEGREES, coefficients, gather, rest_columns
from .ply import Ply

CHUNK_SPLATS = 256
_PACKED = ("packed_position", "packed_rotation", "packed_scale", "packed_color")
_POSITION, _SCALE, _COLOR = ("x", "y", "z"), ("scale_x", "scale_y", "scale_z"), ("r", "g", "b")
_LARGEST_SH = 4.0  # the harmonics' bytes are 256 cells over [-4, 4]
_LARGEST_SCALE_LOG = 20.0  # PlayCanvas clips there, lest one flat splat coarsen the scales of its whole chunk


def read(ply: Ply) -> Splats:
    """Read the splats of an opened PLY with a `chunk` element. Raises InputError when parts are missing or short."""
    chunk, vertex = ply.elements["chunk"], ply.elements.get("vertex")
    color_bounded = "min_r" in chunk.properties
    bounded = [f"{end}_{a}" for end in ("min", "max") for a in _POSITION + _SCALE + _COLOR * color_bounded]
    missing = [name for name in bounded if name not in chunk.properties]
    missing += [name for name in _PACKED if vertex is None or vertex.properties.get(name) != "u4"]
    if vertex is None or missing:
        raise InputError(f"{ply.path} is not a compressed splat PLY: it lacks {', '.join(missing)}")
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
        facts=facts_of_comments(ply.comments),
    )


def write(path: str | os.PathLike[str], splats: Splats) -> None:
    """Write a compressed PLY (little-endian), row i being splat i; the file appears only once it is complete.

    Warns with a DataWarning about splats, and about harmonics beyond +-4, that the format cannot hold.

    A chunk takes 256 successive rows, so steps are as fine as these are close together: a file that was one keeps its
    values, one in the order of training gets steps of a thousandth of the scene (`Splats.in_spatial_order` helps).
    """
    splats, usable = hide_unusable(splats, path)
    scale_log = np.log(np.maximum(splats.scales.astype(np.float64), np.exp(-_LARGEST_SCALE_LOG)))
    groups = [
        (_POSITION, splats.means, (11, 10, 11)),
        (_SCALE, np.minimum(scale_log, _LARGEST_SCALE_LOG), (11, 10, 11)),
        (_COLOR, color_from_sh(splats.sh[:, 0]), (8, 8, 8)),
    ]
    bounds: dict[str, NDArray[np.float32]] = {}
    fields = []
    for names, values, bits in groups:
        low, high = _chunk_bounds(values, usable)
        for end, corner in (("min", low), ("max", high)):
            bounds |= {f"{end}_{name}": corner[:, i] for i, name in enumerate(names)}
        fields.append([levels(share, width) for share, width in zip(_shares(values, low, high).T, bits, strict=True)])
    position, scale, color = fields
    small, largest = smallest_three(splats.quats_wxyz)
    rotation = [largest.astype(np.uint32), *levels(small / np.sqrt(2) + 0.5, 10).T]
    packed = (
        _packed(position, (11, 10, 11)),
        _packed(rotation, (2, 10, 10, 10)),
        _packed(scale, (11, 10, 11)),
        _packed([*color, levels(splats.opacities, 8)], (8, 8, 8, 8)),
    )
    parts: list[tuple[str, str, Sequence[str], NDArray[Any]]] = [
        ("chunk", "float", list(bounds), np.stack(list(bounds.values()), axis=1).astype("<f4")),
        ("vertex", "uint", _PACKED, np.stack(packed, axis=1).astype("<u4")),
    ]
    if splats.degree:
        rest = splats.sh[:, 1:].swapaxes(1, 2).reshape(len(splats), -1)
        warn_clipped(np.abs(rest) > _LARGEST_SH, path, f"harmonics beyond +-{_LARGEST_SH:g}")
        cells = np.clip(np.floor((rest + _LARGEST_SH) * (128 / _LARGEST_SH)), 0, 255).astype("u1")
        parts.append(("sh", "uchar", [f"f_rest_{i}" for i in range(cells.shape[1])], cells))
    header = ["ply", "format binary_little_endian 1.0", *(f"comment {each}" for each in comments_of(splats.facts))]
    for element, kind, properties, rows in parts:
        header += [f"element {element} {len(rows)}", *(f"property {kind} {name}" for name in properties)]
    with staged_file(path) as staging, open(staging, "wb") as file:
        file.write("\n".join([*header, "end_header\n"]).encode())
        for _, _, _, rows in parts:
            file.write(rows.tobytes())


def _chunk_bounds(values: NDArray[Any], usable: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Lowest and highest corners of the usable rows of each chunk: (N, 3) -> two (chunks, 3) float32, 0 where none."""
    values = np.where(usable[:, None], values, np.nan).astype(np.float32)
    starts = np.arange(0, len(values), CHUNK_SPLATS)
    low, high = (np.nan_to_num(pick.reduceat(values, starts), nan=0.0) for pick in (np.fmin, np.fmax))
    return low, high


def _shares(values: NDArray[Any], low: NDArray[np.float32], high: NDArray[np.float32]) -> NDArray[np.float64]:
    """Positions of rows between the corners of their chunks: (N, 3) float64, 0 for a chunk without extent."""
    chunk = np.arange(len(values)) // CHUNK_SPLATS
    low, high = low.astype(np.float64), high.astype(np.float64)
    extent = np.where(high > low, high - low, np.inf)
    return (values - low[chunk]) / extent[chunk]


def _packed(fields: Sequence[NDArray[np.uint32]], bits: Sequence[int]) -> NDArray[np.uint32]:
    """Bit fields, highest first, in one number a row: the inverse of `_fractions`, (N,) uint32."""
    packed = np.zeros_like(fields[0])
    for field, width in zip(fields, bits, strict=True):
        packed = packed << np.uint32(width) | field
    return packed


def _stretch(fractions: NDArray[np.float32], bounds: NDArray[Any], names: Sequence[str]) -> NDArray[np.float32]:
    """Turn (N, 3) fractions, in place, into values between the bounds of the chunk of each row."""
    chunk = np.arange(len(fractions)) // CHUNK_SPLATS
    for column, name in zip(fractions.T, names, strict=True):
        low, high = (bounds[f"{end}_{name}"].astype(np.float32) for end in ("min", "max"))
        column *= (high - low)[chunk]
        column += low[chunk]
    return fractions


def _fractions(packed: NDArray[np.uint32], bits: Sequence[int]) -> NDArray[np.float32]:
    """Bit fields, highest first, as shares of their maxima: (N,) uint32 -> (N, fields) float32."""
    fractions, shift = np.zeros((len(packed), len(bits)), np.float32), 32
    for i, width in enumerate(bits):
        shift -= width
        limit = (1 << width) - 1
        fractions[:, i] = ((packed >> shift) & limit) / np.float32(limit)
    return fractions


def _quats_wxyz(packed: NDArray[np.uint32]) -> NDArray[np.float32]:
    small = (_fractions(packed, (2, 10, 10, 10))[:, 1:] - 0.5) * np.float32(np.sqrt(2))
    return restore_largest(small, packed >> 30)


def _with_rest(ply: Ply, dc: NDArray[np.float32]) -> NDArray[np.float32]:
    """Join the constant coefficients and those of the `sh` element: (N, 3) -> (N, K, 3)."""
    if "sh" not in ply.elements:
        return dc[:, None]
    element = ply.elements["sh"]
    if element.count != len(dc) or set(element.properties.values()) - {"u1"}:
        raise InputError(f"{ply.path}: expected {len(dc)} rows of bytes in the sh element, found {element.count} rows")
    k, found = coefficients(ply.path, element.properties)
    if found > k:
        warn_beyond(ply.path, len(dc), DEGREES[found])
    sh = np.zeros((len(dc), k, 3), np.float32)
    gather(ply.rows("sh"), rest_columns(sh, found))
    # Each cell is read at its centre; the two outermost mean the ends themselves.
    centers = (np.arange(256, dtype=np.float32) + 0.5) / (128 / _LARGEST_SH) - _LARGEST_SH
    centers[[0, 255]] = -_LARGEST_SH, _LARGEST_SH
    sh[:, 1:] = centers[sh[:, 1:].astype(np.uint8)]
    sh[:, 0] = dc
    return sh
