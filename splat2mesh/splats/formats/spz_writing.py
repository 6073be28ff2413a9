"""Niantic's `.spz` out, version 3.

Source: github.com/nianticlabs/spz, load-spz.cc.
"""

import os
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.outputs import staged_file
from ..splats import Splats
from .encoding import hide_unusable, levels, smallest_three, warn_clipped
from .spz import ANTIALIASED, COLOR_SCALE, FLIPPED, GZIP, HEADER, MAGIC

_WRITTEN_VERSION = 3  # the latest that comes as gzip, which every reader knows
_LARGEST_INT24 = (1 << 23) - 1
_MOST_FRACTION_BITS = 24
_USUAL_FRACTION_BITS = 12  # of Niantic's own writer
_FAR_SHARE = 0.001  # of the splats, which may be clipped rather than coarsen all others below the usual


def write(path: str | os.PathLike[str], splats: Splats) -> None:
    """Write an SPZ of version 3, row i being splat i; the file appears only once it is complete.

    splats: in the frame of a PLY. Warns with a DataWarning about splats, positions and harmonics that the format cannot
    hold.

    Positions get as many fraction bits as their reach leaves, so those of an SPZ come back exactly.
    """
    splats, usable = hide_unusable(splats, path)
    bits = _fraction_bits(np.abs(splats.means).max(axis=1))
    fixed = np.rint(splats.means.astype(np.float64) * [1, -1, -1] * (1 << bits))
    warn_clipped(np.abs(fixed) > _LARGEST_INT24, path, "positions")
    fixed = np.clip(fixed, -_LARGEST_INT24, _LARGEST_INT24).astype("<i4")
    scale_log = np.log(np.maximum(splats.scales, np.finfo(np.float32).tiny))
    # Half a step beyond the last level still rounds to it.
    beyond = (np.abs(scale_log + 10 - 255 / 32) > 255 / 32 + 1 / 32) & usable[:, None]
    warn_clipped(beyond, path, "scales below e^-10 or above e^5.9")
    sh = splats.sh * FLIPPED[: splats.sh.shape[1], None]
    color, rest = sh[:, 0] * COLOR_SCALE + 0.5, np.rint(sh[:, 1:] * 128 + 128)
    warn_clipped(np.abs(color - 0.5) > 0.5 + 0.5 / 255, path, "colours")
    warn_clipped((rest < 0) | (rest > 256), path, "harmonics beyond +-1")  # 256, which is 1, is off by a single step
    sections = (
        fixed.view(np.uint8).reshape(len(splats), 3, 4)[..., :3],
        levels(splats.opacities, 8),
        levels(color, 8),
        np.clip(np.rint((scale_log + 10) * 16), 0, 255),
        _packed_rotations(splats.quats_wxyz[:, [1, 2, 3, 0]] * np.array([1, -1, -1, 1], np.float32)),
        np.clip(rest, 0, 255),
    )
    flags = ANTIALIASED if splats.facts.antialiased else 0
    header = HEADER.pack(MAGIC, _WRITTEN_VERSION, len(splats), splats.degree, bits, flags, 0)
    deflate = zlib.compressobj(9, zlib.DEFLATED, GZIP)
    with staged_file(path) as staging, open(staging, "wb") as file:
        file.write(deflate.compress(header))
        for section in sections:
            file.write(deflate.compress(section.astype(np.uint8).tobytes()))
        file.write(deflate.flush())


def _fraction_bits(reach: NDArray[np.float32]) -> int:
    """Bits after the point of positions whose largest coordinates are `reach`: (N,) -> int."""
    bits = _bits_for(reach.max())
    if bits < _USUAL_FRACTION_BITS:
        most = np.quantile(reach, 1 - _FAR_SHARE, method="higher")
        bits = min(_bits_for(most), _USUAL_FRACTION_BITS)
    return bits


def _bits_for(largest: np.floating[Any]) -> int:
    with np.errstate(divide="ignore"):
        return int(np.clip(np.floor(np.log2(_LARGEST_INT24 / np.float64(largest))), 0, _MOST_FRACTION_BITS))


def _packed_rotations(quats_xyzw: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Version 3, as `_quats_xyzw` reads it: (N, 4) -> (N, 4) uint8."""
    small, largest = smallest_three(quats_xyzw)
    packed = largest.astype("<u4")
    for part in small.T:
        packed = packed << 10 | (part < 0).astype("<u4") << 9 | levels(np.abs(part) * np.sqrt(2), 9)
    return np.ascontiguousarray(packed, "<u4")[:, None].view(np.uint8)
