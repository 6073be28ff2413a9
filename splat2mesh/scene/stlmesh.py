"""Triangle meshes in STL files, binary and ascii. Every facet has its own normal and corners; equal corners
are joined, in the order of first use. Source: 3D Systems, "StereoLithography Interface Specification" (1989)."""

import os
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from .surfaces import UncheckedMesh, centred, joined

_FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("spare", "<u2")])
_HEADER_BYTES, _COUNT_BYTES = 80, 4
_FACET_TEXT = re.compile(
    rb"facet\s+normal\s+(\S+)\s+(\S+)\s+(\S+)\s+outer\s+loop\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)\s+vertex\s+(\S+)\s+(\S+)\s+"
    rb"(\S+)\s+vertex\s+(\S+)\s+(\S+)\s+(\S+)\s+endloop\s+endfacet",
    re.IGNORECASE,
)


def read_stl(path: str | os.PathLike[str]) -> UncheckedMesh:
    """Read an STL, binary or ascii. Raises InputError for one that is cut short or damaged."""
    size = os.path.getsize(path)
    with open(path, "rb") as file:
        head = file.read(_HEADER_BYTES + _COUNT_BYTES)
    count = int.from_bytes(head[_HEADER_BYTES:], "little") if len(head) == _HEADER_BYTES + _COUNT_BYTES else -1
    if count >= 0 and size == len(head) + count * _FACET.itemsize:
        return _binary(path, count)
    if head.lstrip()[:5].lower() == b"solid":
        return _ascii(path)
    if count >= 0 and size > len(head) + count * _FACET.itemsize > len(head):
        return _binary(path, count)  # with bytes of its writer after the last facet
    room = max(0, size - _HEADER_BYTES - _COUNT_BYTES) // _FACET.itemsize
    raise InputError(f"{path}: broken or cut short: it announces {max(count, 0)} facets, there is room for {room}")


def _binary(path: str | os.PathLike[str], count: int) -> UncheckedMesh:
    facets = np.fromfile(path, _FACET, count, offset=_HEADER_BYTES + _COUNT_BYTES)
    return _joined(facets["corners"].reshape(-1, 3), np.repeat(facets["normal"], 3, axis=0))


def _ascii(path: str | os.PathLike[str]) -> UncheckedMesh:
    data = Path(path).read_bytes()
    found = _FACET_TEXT.findall(data)
    facets = len(re.findall(rb"(?i)\bfacet\s+normal\b", data))
    if len(found) != facets:
        raise InputError(
            f"{path}: broken or cut short: {len(found)} of its {facets} facets make sense; export it again"
        )
    try:
        numbers = np.array(found, "S32").astype(np.float64).reshape(-1, 4, 3)
    except ValueError as error:
        raise InputError(f"{path}: a facet holds a value that is not a number ({error}); export it again") from None
    return _joined(numbers[:, 1:].reshape(-1, 3), np.repeat(numbers[:, 0], 3, axis=0))


def _joined(points: NDArray[Any], normals: NDArray[Any]) -> UncheckedMesh:
    points, moved = centred(points.astype(np.float64))
    row, corner = joined(np.arange(len(points)), points, normals)
    return UncheckedMesh(points[row], corner.reshape(-1, 3), normals[row], moved=moved)
