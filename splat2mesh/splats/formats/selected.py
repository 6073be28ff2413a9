"""Some rows of a PLY, byte for byte, with its header and all other elements."""

import os
import re
from itertools import takewhile
from pathlib import Path
from typing import BinaryIO

import numpy as np

from ...base.arrays import Mask
from ...base.errors import InputError
from ...base.outputs import staged_file
from ...base.threads import ROWS_AT_ONCE
from .ply import Ply, blocks

_COUNT = re.compile(rb"^(\s*element\s+vertex\s+)\d+", re.MULTILINE)


def write_selected(path: str | os.PathLike[str], source: str | os.PathLike[str], keep: Mask) -> None:
    """Write the PLY `source` with some of its vertices; the file appears only once it is complete.

    source: a PLY, ascii or binary. Its header stays except for the number of vertices, and so do its other elements.
    keep: (N,) bool, which of its N vertices stay. Raises InputError when the source holds another number of vertices,
    or is cut short.
    """
    ply = Ply.open(source)
    count = ply.elements["vertex"].count if "vertex" in ply.elements else 0
    if count != len(keep):
        raise InputError(f"{source} holds {count} splats, expected {len(keep)}: give the file that they come from")
    with open(source, "rb") as file:
        header = _COUNT.sub(rb"\g<1>%d" % np.count_nonzero(keep), file.read(ply.body), count=1)
    with staged_file(path) as staging, open(staging, "wb") as target:
        target.write(header)
        (_copy_lines if ply.format == "ascii" else _copy_rows)(ply, keep, target)


def _copy_rows(ply: Ply, keep: Mask, target: BinaryIO) -> None:
    rows = ply.rows("vertex")
    first = int(rows.offset) if isinstance(rows, np.memmap) else ply.body
    with open(ply.path, "rb") as file:
        file.seek(ply.body)
        target.write(file.read(first - ply.body))
        for start, block in blocks(rows, ROWS_AT_ONCE):
            target.write(block[keep[start : start + len(block)]].tobytes())
        file.seek(first + len(rows) * rows.dtype.itemsize)
        while rest := file.read(1 << 20):
            target.write(rest)


def _copy_lines(ply: Ply, keep: Mask, target: BinaryIO) -> None:
    before = sum(ply.elements[name].count for name in takewhile(lambda name: name != "vertex", ply.elements))
    number = -before
    with open(Path(ply.path), "rb") as file:
        file.seek(ply.body)
        for line in file:
            inside = 0 <= number < len(keep)
            if not line.strip() or not inside or keep[number]:
                target.write(line)
            number += bool(line.strip())
