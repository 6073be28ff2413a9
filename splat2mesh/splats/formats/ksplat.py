"""mkkellogg's `.ksplat`: sections of splats in buckets, whose centres their positions are relative to.

A header of 4096 bytes, one of 1024 for each section, then for each section the sizes of its unfilled buckets, the
centres of all, and the splats. At level 0 all is float32; at level 1 positions are 16 bits within the bucket, the rest
half floats; at level 2 the harmonics are bytes. The frame is that of the PLY that it was made from.
Source: github.com/mkkellogg/GaussianSplats3D, src/loaders/SplatBuffer.js.
"""

import os
import struct
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ...base.inputs import FREE, file_size
from ..joining import joined
from ..splats import DEGREE_OF_COEFFICIENTS, Splats
from .encoding import sh_from_color

_HEADER_BYTES, _SECTION_BYTES = 4096, 1024
_HEADER = struct.Struct("<BBxxIIIIH14xff")  # version, sections, used ones, splats at most, splats, level, SH bounds
_SECTION = struct.Struct("<IIIIfHxxIIIIH")
_USUAL_SH = 1.5  # bounds of the harmonics where the header has 0
_TYPES = ("<f4", "<f4", "<f4"), ("<u2", "<f2", "<f2"), ("<u2", "<f2", "u1")
"""Of the positions, of scales and rotations, and of the harmonics, by level."""
_USUAL_RANGE = 1, *[np.iinfo(code).max // 2 for code, *_ in _TYPES[1:]]
_COMPONENTS = [3 * (coefficients - 1) for coefficients in DEGREE_OF_COEFFICIENTS]


def looks_like(head: bytes) -> bool:
    """Return whether the first bytes of a file can be those of a `.ksplat`, which has no mark of its own. head: at
    least `_HEADER.size` of them."""
    if len(head) < _HEADER.size:
        return False
    major, minor, sections, used, _, splats, level, _, _ = _HEADER.unpack_from(head)
    return major == 0 and 1 <= minor < 32 and 0 < sections <= FREE and level < 3 and splats > 0 < used


def read(path: str | os.PathLike[str]) -> Splats:
    """Read a `.ksplat` file. Raises InputError when it is of another version, damaged or cut short."""
    size = file_size(path, "splat file")
    with open(path, "rb") as file:
        head = file.read(_HEADER_BYTES)
    if len(head) < _HEADER_BYTES:
        raise InputError(f"{path} is cut short: a .ksplat begins with {_HEADER_BYTES} bytes, found {len(head)}")
    if not looks_like(head):
        raise InputError(f"{path} is not a .ksplat of version 0.1: export it again, as .ply or .spz")
    _, _, count, _, _, splats, level, low, high = _HEADER.unpack_from(head)
    if not np.isfinite([low, high]).all():
        raise InputError(f"{path} is damaged: the bounds of its harmonics are not finite")
    bounds = low or -_USUAL_SH, high or _USUAL_SH
    start = _HEADER_BYTES + count * _SECTION_BYTES
    if start > size:
        raise InputError(f"{path} is cut short: {count} headers of sections end at byte {start:,} of {size:,}")
    data = np.memmap(path, np.uint8, "r")
    parts = []
    for number in range(count):
        section = _Section.of(bytes(data[_HEADER_BYTES + number * _SECTION_BYTES :][:_SECTION_BYTES]), level)
        if section.splats:
            parts.append(_section(path, data, start, section, level, bounds))
        start += section.bytes
    found = sum(map(len, parts))
    if found != splats:
        raise InputError(f"{path} is damaged: its header counts {splats:,} splats, its sections hold {found:,}")
    return joined(parts)


@dataclass(frozen=True)
class _Section:
    """Numbers in the header of a section. scale: of the integers of positions. zero: of them, the middle."""

    splats: int
    most: int
    bucket_size: int
    buckets: int
    bucket_bytes: int
    full: int
    partial: int
    degree: int
    zero: int
    scale: float
    splat_bytes: int

    @classmethod
    def of(cls, header: bytes, level: int) -> "_Section":
        splats, most, size, buckets, block, stored, reach, _, full, partial, degree = _SECTION.unpack_from(header)
        zero = reach or _USUAL_RANGE[level]
        place, shape, harmonics = (np.dtype(code).itemsize for code in _TYPES[level])
        if degree >= len(_COMPONENTS):
            raise ValueError(f"a section has harmonics of degree {degree}")
        width = 3 * place + 7 * shape + 4 + _COMPONENTS[degree] * harmonics
        return cls(splats, most, size, buckets, stored, full, partial, degree, zero, block / 2 / zero, width)

    @property
    def before(self) -> int:
        """Bytes of the buckets, which stand before the splats."""
        return 4 * self.partial + self.bucket_bytes * self.buckets

    @property
    def bytes(self) -> int:
        return self.before + self.most * self.splat_bytes


def _section(
    path: str | os.PathLike[str],
    data: NDArray[np.uint8],  # the file
    start: int,  # byte of the section's first
    section: _Section,
    level: int,
    bounds: tuple[float, float],  # of the harmonics in bytes
) -> Splats:
    if section.splats > section.most or start + section.bytes > len(data):
        raise InputError(f"{path} is cut short: a section ends at byte {start + section.bytes:,} of {len(data):,}")
    place, shape, harmonics = _TYPES[level]
    fields: list[Any] = [("mean", place, 3), ("scale", shape, 3), ("quat_wxyz", shape, 4), ("rgba", "u1", 4)]
    fields.append(("sh", harmonics, _COMPONENTS[section.degree]))
    first = start + section.before
    rows = data[first : first + section.splats * section.splat_bytes].view(np.dtype(fields))
    means = rows["mean"].astype(np.float32)
    if level:
        means = (means - section.zero) * np.float32(section.scale) + _centers(path, data, start, section)
    rgba = rows["rgba"] / np.float32(255)
    sh = np.zeros((len(rows), (section.degree + 1) ** 2, 3), np.float32)
    sh[:, 0] = sh_from_color(rgba[:, :3])
    values = rows["sh"].astype(np.float32)
    if level == 2:
        values = np.float32(bounds[0]) + values * np.float32((bounds[1] - bounds[0]) / 255)
    column = 0
    for degree in range(1, section.degree + 1):  # degree by degree, each channel after channel
        wide = 2 * degree + 1
        band = values[:, column : column + 3 * wide].reshape(-1, 3, wide)
        sh[:, degree * degree : (degree + 1) ** 2] = band.swapaxes(1, 2)
        column += 3 * wide
    quats = rows["quat_wxyz"].astype(np.float32)
    return Splats(means, rows["scale"].astype(np.float32), quats, rgba[:, 3], sh)


def _centers(
    path: str | os.PathLike[str], data: NDArray[np.uint8], start: int, section: _Section
) -> NDArray[np.float32]:
    """The centre of the bucket of every splat: (N, 3)."""
    if section.bucket_bytes != 12 or section.full + section.partial > section.buckets:
        raise InputError(f"{path} is damaged: its buckets do not fit a section")
    after = start + 4 * section.partial
    sizes = np.full(section.full, section.bucket_size, np.int64)
    sizes = np.append(sizes, data[start:after].view("<u4").astype(np.int64))
    ends = np.cumsum(sizes)
    if not len(ends) or ends[-1] < section.splats:
        raise InputError(f"{path} is damaged: its buckets hold fewer splats than their section")
    centers = data[after : after + 12 * section.buckets].view("<f4").reshape(-1, 3)
    return centers[np.searchsorted(ends, np.arange(section.splats), side="right")]
