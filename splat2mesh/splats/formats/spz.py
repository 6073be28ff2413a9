"""Niantic's `.spz`, versions 2 and 3 (one gzip stream) and 4 (one zstd stream for each attribute).

After the header come six arrays: positions (24-bit fixed point), alphas, colours, log scales, rotations and the other
harmonics. The file is y-up (right, up, back), unless a record of its extensions says otherwise; the resulting Splats
are in the frame of a PLY (right, down, front). Records stand at the end of versions 2 and 3, after the header of 4.
Source: github.com/nianticlabs/spz, load-spz.cc, extensions/README.md.
"""

import itertools
import os
import struct
import sys
import warnings
import zlib
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DataWarning, InputError
from ...base.inputs import FREE, check_count, file_size
from ..facts import FileFacts
from ..placing import reframed
from ..splats import Splats
from .encoding import restore_largest, warn_beyond
from .inria import DEGREES

AnyPath: TypeAlias = str | os.PathLike[str]

MAGIC = b"NGSP"
HEADER = struct.Struct("<4sIIBBBB")
_V4_HEADER_BYTES = 32
_V4_STREAMS_AT = struct.Struct("<I")
_V4_STREAM = struct.Struct("<QQ")
# Turning about x by 180 degrees, (x, -y, -z), flips the harmonics that are odd in y and z together.
FLIPPED = np.array([1, -1, -1, 1, -1, 1, 1, -1, 1, -1, 1, -1, -1, 1, -1, 1], np.float32)
COLOR_SCALE = 0.15  # a coefficient of 1 moves a colour byte by this share of its range
ANTIALIASED, _HAS_RECORDS = 1, 2  # flags of the header
_RECORD = struct.Struct("<II")
_AXES_RECORD = 0xADBE0003  # SPZ_ADOBE_coordinate_system
_AXES = "RUB LDB RDB LUB RUB LDF RDF LUF RUF LFD RFD LFU RFU LBD RBD LBU RBU".split()  # by its value; 0 says nothing
_DIRECTIONS = {"R": (1, 0, 0), "L": (-1, 0, 0), "D": (0, 1, 0), "U": (0, -1, 0), "F": (0, 0, 1), "B": (0, 0, -1)}
_MOST_DEGREE = max(DEGREES.values())
GZIP = 31  # window bits of zlib that make its stream a gzip one, with no name and no date in its header


def read(path: AnyPath) -> Splats:
    """Read an `.spz` file. Returns Splats in the frame of a PLY. Raises InputError when it is no SPZ, too new, damaged
    or cut short."""
    file_size(path, "splat file")
    return read_bytes(path, Path(path).read_bytes())


def read_bytes(path: AnyPath, data: bytes) -> Splats:
    """Read an SPZ that lies in another file. path: of that file, for messages. Raises InputError as `read` does. Warns
    with a DataWarning about records of extensions that are left out, and harmonics beyond the third degree."""
    try:
        header, sections, records = (_open_v4 if data.startswith(MAGIC) else _open_gzip)(path, data)
    except (zlib.error, struct.error) as error:
        raise InputError(f"{path}: the SPZ stream is damaged ({error}): copy or export it again") from error
    axes = _axes(path, records)
    if header.k > len(FLIPPED):
        warn_beyond(path, header.count, header.degree)
    facts = FileFacts(True if header.flags & ANTIALIASED else None, frame=_frame(axes))
    splats = _decode(header, sections, facts)
    turn = np.transpose([_DIRECTIONS[letter] for letter in axes or "RUB"]) * np.array([1, -1, -1])
    return reframed(splats, turn)


class _Header:
    def __init__(self, path: AnyPath, data: bytes, versions: tuple[int, ...]) -> None:
        magic, self.version, self.count, degree, self.fraction_bits, self.flags, self.last = HEADER.unpack_from(data)
        if magic != MAGIC:
            raise InputError(f"{path} is compressed, but holds no SPZ data: expected the mark {MAGIC!r}")
        if self.version not in versions:
            raise InputError(f"{path}: SPZ version {self.version} is not supported: expected 2, 3 or 4")
        if degree > _MOST_DEGREE or self.fraction_bits > 24:
            raise InputError(
                f"{path}: expected SH degree 0 to {_MOST_DEGREE} and at most 24 fraction bits, "
                f"found {degree} and {self.fraction_bits}"
            )
        if self.count == 0:
            raise InputError(f"{path} holds no splats: its header counts 0")
        self.degree, self.k = degree, (degree + 1) ** 2
        # Bytes a splat takes in each section.
        self.widths = [9, 1, 3, 3, 3 if self.version == 2 else 4, 3 * (self.k - 1)]


def _open_gzip(path: AnyPath, data: bytes) -> tuple[_Header, list[bytes], bytes]:
    inflate = zlib.decompressobj(wbits=GZIP)
    header = _Header(path, inflate.decompress(data, HEADER.size), (2, 3))
    check_count(path, header.count, len(data))
    expected = header.count * sum(header.widths)
    # Bounded by what the header announces, so a damaged stream cannot fill the memory.
    body = inflate.decompress(inflate.unconsumed_tail, expected)
    _check_size(path, "data", len(body), expected)
    records = b""
    if header.flags & _HAS_RECORDS:
        records = inflate.decompress(inflate.unconsumed_tail, FREE)
    surplus = inflate.decompress(inflate.unconsumed_tail, 1)  # reaches the checksum: raises when it disagrees
    if surplus or not inflate.eof or inflate.unused_data:
        what = "lacks the end of its stream" if not (surplus or inflate.eof) else "holds more than its header announces"
        raise InputError(f"{path} is damaged: it {what}: copy or export it again")
    ends = np.cumsum([0, *header.widths]) * header.count
    return header, [body[a:b] for a, b in itertools.pairwise(ends)], records


def _unpacked(packed: bytes, most: int) -> bytes:
    """The content of zstd frames, at most this many bytes. Raises ValueError for damage and for more."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd

    content = bytearray()
    while packed:
        frame = zstd.ZstdDecompressor()
        try:
            content += frame.decompress(packed, most + 1 - len(content))
        except zstd.ZstdError as error:
            raise ValueError(str(error)) from error
        if len(content) > most:
            raise ValueError("it holds more than its header announces")
        if not frame.eof:
            raise ValueError("it lacks its end")
        packed = frame.unused_data
    return bytes(content)


def _table_v4(path: AnyPath, data: bytes) -> tuple[_Header, int, list[tuple[int, int]]]:
    """The header, the byte at which the table of streams begins, and their sizes, packed and unpacked."""
    header = _Header(path, data, (4,))
    check_count(path, header.count, len(data))
    count = sum(width > 0 for width in header.widths)
    if header.last != count:
        raise InputError(f"{path}: expected {count} SPZ streams, found {header.last}")
    (table,) = _V4_STREAMS_AT.unpack_from(data, HEADER.size)
    return header, table, [_V4_STREAM.unpack_from(data, table + i * _V4_STREAM.size) for i in range(count)]


def _open_v4(path: AnyPath, data: bytes) -> tuple[_Header, list[bytes], bytes]:
    header, table, sizes = _table_v4(path, data)
    start = table + len(sizes) * _V4_STREAM.size
    sections: list[bytes] = []
    for i, (packed_size, size) in enumerate(sizes):
        width = header.widths[i]
        _check_size(path, f"stream {i}", size, header.count * width)
        packed = data[start : start + packed_size]
        _check_size(path, f"stream {i}", len(packed), packed_size)
        try:
            sections.append(_unpacked(packed, size))
        except ValueError as error:
            raise InputError(f"{path}: an SPZ stream is damaged ({error}): copy or export it again") from error
        _check_size(path, f"stream {i}", len(sections[-1]), size)
        start += packed_size
    if start != len(data):
        raise InputError(
            f"{path} is damaged: {len(data) - start} bytes follow its last stream: copy or export it again"
        )
    records = data[_V4_HEADER_BYTES:table] if header.flags & _HAS_RECORDS else b""
    return header, sections + [b""] * (6 - len(sections)), records


def _axes(path: AnyPath, records: bytes) -> str | None:
    """The axes that the records of extensions state: three letters of _DIRECTIONS, or None."""
    axes, left, start = None, [], 0
    while start + _RECORD.size <= len(records):
        kind, size = _RECORD.unpack_from(records, start)
        content = records[start + _RECORD.size : start + _RECORD.size + size]
        start += _RECORD.size + size
        if kind == _AXES_RECORD and size == len(content) == 4 and int.from_bytes(content, "little") < len(_AXES):
            axes = _AXES[int.from_bytes(content, "little")]
        else:
            left.append(f"{kind:#010x}")
    if start != len(records):
        raise InputError(f"{path} is damaged: a record of its SPZ extensions goes beyond their end: export it again")
    if left:
        warnings.warn(
            f"{path}: left out {len(left)} records of SPZ extensions, which are not read: {', '.join(left[:4])}",
            DataWarning,
            stacklevel=3,
        )
    return axes


def _frame(axes: str | None) -> str:
    words = {"R": "right", "L": "left", "U": "up", "D": "down", "F": "front", "B": "back"}
    if axes is None:
        return ""
    return f"{', '.join(words[letter] for letter in axes)}, by its record SPZ_ADOBE_coordinate_system"


def _check_size(path: AnyPath, what: str, found: int, expected: int) -> None:
    if found != expected:
        raise InputError(f"{path} is damaged: its SPZ {what} should take {expected} bytes, found {found}")


def _decode(header: _Header, sections: list[bytes], facts: FileFacts) -> Splats:
    n = header.count
    positions, alphas, colors, scales, rotations, rest = (
        np.frombuffer(section, np.uint8).reshape(n, width)
        for section, width in zip(sections, header.widths, strict=True)
    )
    k = min(header.k, len(FLIPPED))
    sh = np.zeros((n, k, 3), np.float32)
    sh[:, 0] = (colors / np.float32(255) - 0.5) / COLOR_SCALE
    sh[:, 1:] = (rest.reshape(n, -1, 3)[:, : k - 1] - np.float32(128)) / 128
    sh *= FLIPPED[:k, None]
    means = _int24(positions) / np.float32(1 << header.fraction_bits) * np.array([1, -1, -1], np.float32)
    quats_wxyz = _quats_xyzw(rotations)[:, [3, 0, 1, 2]] * np.array([1, 1, -1, -1], np.float32)
    opacities = alphas[:, 0] / np.float32(255)
    return Splats(means, np.exp(scales / np.float32(16) - 10), quats_wxyz, opacities, sh, facts=facts)


def _int24(data: NDArray[np.uint8]) -> NDArray[np.int32]:
    """Signed little-endian 24-bit integers: (N, 9) bytes -> (N, 3) int32."""
    low, middle, high = (data[:, i::3].astype(np.int32) for i in range(3))
    return (low << 8 | middle << 16 | high << 24) >> 8  # the last shift carries the sign down


def _quats_xyzw(data: NDArray[np.uint8]) -> NDArray[np.float32]:
    if data.shape[1] == 3:  # version 2: x, y, z as bytes, w >= 0 follows from unit length
        return restore_largest(data / np.float32(127.5) - 1, np.full(len(data), 3))
    packed = np.ascontiguousarray(data).view("<u4")[:, 0]
    # Version 3: 2 bits for the largest, then three times sign and 9 bits over [0, 1/sqrt(2)].
    part = np.stack([packed >> 20, packed >> 10, packed], axis=1) & 0x3FF
    size = (part & 0x1FF) / np.float32(511 * np.sqrt(2))
    return restore_largest(np.where(part >> 9, -size, size), packed >> 30)
