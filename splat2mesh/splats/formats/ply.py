"""The PLY container: a strict header, and the rows of its elements as NumPy arrays.

Any property order and scalar type, ascii and both byte orders. Sizes are checked before memory is taken.
Source: Turk, "The PLY Polygon File Format" (1994).
"""

import itertools
import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import DataWarning, InputError
from ...base.inputs import FREE, file_size

_BYTE_ORDERS = {"ascii": "=", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"},
}


@dataclass
class Element:
    """One element of a header. count: of its rows. properties: the NumPy type code of each property, or "list". lists:
    dict of str to (str, str), property to the type codes of its list's length and of its items."""

    count: int
    properties: dict[str, str]
    lists: dict[str, tuple[str, str]] = field(default_factory=dict)

    @property
    def has_lists(self) -> bool:
        return "list" in self.properties.values()

    @property
    def row_bytes(self) -> int:
        return sum(np.dtype(code).itemsize for code in self.properties.values())


class Ply:
    """A PLY file whose header has been read. format: "ascii", "binary_little_endian" or "binary_big_endian". elements:
    in file order. body: byte offset of the first row. comments: without the word that marks them."""

    def __init__(
        self, path: Path, format: str, elements: dict[str, Element], body: int, comments: list[str] | None = None
    ) -> None:
        self.path, self.format, self.elements, self.body = path, format, elements, body
        self.comments = comments or []

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> "Ply":
        """Read the header of a file. Raises InputError for a header that is malformed or cut short."""
        path = Path(path)
        format: str | None = None
        elements: dict[str, Element] = {}
        element: Element | None = None
        comments: list[str] = []
        file_size(path, "PLY file")
        with open(path, "rb") as file:
            if file.readline(16).strip() != b"ply":
                raise InputError(f"{path} is not a PLY file: its first line must be 'ply'")
            for number in itertools.count(2):
                raw = file.readline(FREE)
                if not raw.endswith(b"\n") or file.tell() > FREE:
                    raise InputError(f"{path}: the PLY header has no end_header line: the file is cut short or damaged")
                words = raw.decode("latin-1").split()
                match words:
                    case ["end_header"]:
                        break
                    case []:
                        pass
                    case ["comment" | "obj_info", *rest]:
                        comments.append(" ".join(rest))
                    case ["format", name, _] if name in _BYTE_ORDERS and format is None:
                        format = name
                    case ["element", name, count] if count.isdecimal() and name not in elements:
                        element = elements[name] = Element(int(count), {})
                    case ["property", "list", count_type, item_type, name] if (
                        element and name not in element.properties and {count_type, item_type} <= _TYPES.keys()
                    ):
                        element.properties[name] = "list"
                        element.lists[name] = _TYPES[count_type], _TYPES[item_type]
                    case ["property", kind, name] if element and name not in element.properties and kind in _TYPES:
                        element.properties[name] = _TYPES[kind]
                    case _:
                        line = " ".join(words)[:60].encode("ascii", "backslashreplace").decode()
                        raise InputError(f"{path}: line {number} of the PLY header makes no sense: '{line}'")
            if format is None:
                raise InputError(f"{path}: the PLY header has no format line: the file is damaged")
            return cls(path, format, elements, file.tell(), comments)

    @property
    def byte_order(self) -> str:
        """That of the rows, as NumPy writes it; "=" for ascii."""
        return _BYTE_ORDERS[self.format]

    def rows(self, name: str) -> NDArray[Any]:
        """Read the rows of an element.

        name: of the element. Returns (count,): memory-mapped when the file is binary. Raises InputError when the file
        is shorter than its header says. Warns with a DataWarning when bytes follow the last row.
        """
        element = self.elements[name]
        if element.has_lists:
            raise InputError(f"{self.path}: PLY element '{name}' holds list properties, expected numbers only")
        order = _BYTE_ORDERS[self.format]
        dtype = np.dtype([(key, order + code) for key, code in element.properties.items()])
        before = list(itertools.takewhile(lambda other: other != name, self.elements))
        if element.count == 0 or not element.properties:
            return np.zeros(0, dtype)
        if self.format == "ascii":
            return self._ascii_rows(name, sum(self.elements[other].count for other in before), dtype)
        return self._binary_rows(name, [self.elements[other] for other in before], dtype)

    def _binary_rows(self, name: str, before: list[Element], dtype: np.dtype) -> NDArray[Any]:
        if any(element.has_lists for element in before):
            raise InputError(f"{self.path}: a PLY element with lists stands before '{name}': write '{name}' first")
        start = self.body + sum(element.count * element.row_bytes for element in before)
        available, count = os.path.getsize(self.path) - start, self.elements[name].count
        self._check_count(name, max(0, available) // dtype.itemsize)
        extra = available - count * dtype.itemsize
        if extra and name == list(self.elements)[-1]:
            warnings.warn(f"{self.path}: ignored {extra} bytes after the last PLY row", DataWarning, stacklevel=2)
        return np.memmap(self.path, dtype, "r", start, (count,))

    def _ascii_rows(self, name: str, skip: int, dtype: np.dtype) -> NDArray[Any]:
        # A value takes a digit and a separator, so no header can announce more rows than could be there.
        most = (os.path.getsize(self.path) - self.body + 1) // (2 * len(dtype.names or ()))
        self._check_count(name, most)
        try:
            with open(self.path, encoding="latin-1") as file, warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # "no data", which the count of rows reports
                file.seek(self.body)
                lines = itertools.islice(file, min(skip, sys.maxsize // 2), None)
                rows = np.loadtxt(lines, dtype, comments=None, ndmin=1, max_rows=self.elements[name].count)
        except (ValueError, OverflowError) as error:
            reason = str(error).split(";")[0]
            raise InputError(f"{self.path}: a PLY row does not fit its header: {reason}") from error
        self._check_count(name, len(rows))
        return rows

    def _check_count(self, name: str, found: int) -> None:
        promised = self.elements[name].count
        if found < promised:
            raise InputError(
                f"{self.path} is cut short: its header promises {promised} rows of '{name}', "
                f"there is room for {found}: copy or export it again"
            )


def blocks(rows: NDArray[Any], size: int) -> Iterator[tuple[int, NDArray[Any]]]:
    """Go through the rows of a Ply, at most `size` at a time.

    rows: as `Ply.rows` gives them. Mapped rows are read from their file instead: a file of many gigabytes would count
    as memory once gone through. Yields first: index of the first row; block.
    """
    if not isinstance(rows, np.memmap):
        yield from ((start, rows[start : start + size]) for start in range(0, len(rows), size))
        return
    with open(str(rows.filename), "rb") as file:
        file.seek(rows.offset)
        for start in range(0, len(rows), size):
            yield start, np.fromfile(file, rows.dtype, min(size, len(rows) - start))
