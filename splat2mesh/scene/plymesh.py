"""Whether a mesh's PLY is all there: every row that its header promises, lists included, before a reader sees it."""

import os
import warnings
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InputError
from ..splats.formats.ply import Element, Ply


def check_whole(path: str | os.PathLike[str]) -> None:
    """Raise InputError for a PLY whose header makes no sense, that is cut short, or whose numbers are none."""
    ply = Ply.open(path)
    body = np.memmap(path, np.uint8, "r", ply.body) if os.path.getsize(path) > ply.body else np.zeros(0, np.uint8)
    start = 0
    if ply.format == "ascii":
        numbers = _numbers(body)
        for name, element in ply.elements.items():
            start = _words_end(ply.path, name, element, numbers, start)
    else:
        for name, element in ply.elements.items():
            start = _rows_end(ply, name, element, body, start)


def _numbers(body: NDArray[np.uint8]) -> NDArray[np.float64]:
    """The numbers of an ascii body, up to the first word that is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of text that ends early: then there are too few
        try:
            return np.fromstring(body.tobytes().decode("latin-1"), np.float64, sep=" ")
        except ValueError:
            return np.zeros(0)


def _words_end(path: Path, name: str, element: Element, numbers: NDArray[np.float64], start: int) -> int:
    """Where the words of an element end, which start at `start`."""
    width = len(element.properties)
    if not element.has_lists:
        end = start + element.count * width
        return end if end <= len(numbers) else _cut_short(path, name, element, max(0, len(numbers) - start) // width)
    for row in range(element.count):
        for kind in element.properties.values():
            if kind == "list" and start < len(numbers):
                start += int(max(numbers[start], 0.0))
            start += 1
        if start > len(numbers):
            return _cut_short(path, name, element, row)
    return start


def _rows_end(ply: Ply, name: str, element: Element, body: NDArray[np.uint8], start: int) -> int:
    """Where the bytes of an element's rows end, which start at `start`."""
    if not element.has_lists:
        end = start + element.count * element.row_bytes
        if end > len(body):
            return _cut_short(ply.path, name, element, max(0, len(body) - start) // element.row_bytes)
        return end
    kinds = [element.lists.get(key, (None, kind)) for key, kind in element.properties.items()]
    lists = [(length and np.dtype(ply.byte_order + length), np.dtype(item).itemsize) for length, item in kinds]
    if len(lists) == 1:  # as faces are, and nearly all have as many corners as the first
        length, size = lists[0]
        if start + length.itemsize <= len(body):
            corners = max(int(body[start : start + length.itemsize].view(length)[0]), 0)
            row = length.itemsize + corners * size
            end = start + element.count * row
            if end <= len(body):
                counts = body[start:end].reshape(element.count, row)[:, : length.itemsize]
                if (counts == counts[0]).all():
                    return end
    for row in range(element.count):
        for length, size in lists:
            items = 1
            if length is not None and start + length.itemsize <= len(body):
                items = max(int(body[start : start + length.itemsize].view(length)[0]), 0)
            start += items * size + (0 if length is None else length.itemsize)
        if start > len(body):
            return _cut_short(ply.path, name, element, row)
    return start


def _cut_short(path: Path, name: str, element: Element, found: int) -> int:
    raise InputError(
        f"{path}: broken or cut short: its header promises {element.count} rows of '{name}', {found} can be read; "
        "export the mesh again"
    )
