"""PlayCanvas SOG out, version 2: the images of quantised attributes and their meta.json, without harmonics.

Source: developer.playcanvas.com, "The SOG format".
"""

import io
import json
import math
import os
import warnings
import zipfile
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ...base.errors import DataWarning
from ...base.outputs import staged_file
from ...base.version import VERSION
from ..splats import Splats
from .encoding import hide_unusable, levels, smallest_three
from .sog import ANTIALIASED

ENTRIES, BINS = 256, 1 << 16
"""Entries of a codebook, and bins of the histogram behind it."""

LEAST_SCALE_LOG = -30.0
"""A scale of 0 counts as this: a tenth of a million-millionth."""

SHAPE = "shape.json"
"""Beside the images that no colour changes: the entries of meta.json that belong to them."""

Shapes: TypeAlias = Callable[[Splats, Callable[[], dict[str, bytes]]], dict[str, bytes]]
"""Takes splats, and what makes their images that no colour changes, with SHAPE; returns the same, made now or before.
They take two thirds of the time."""


def write(path: str | os.PathLike[str], splats: Splats, shapes: Shapes = lambda splats, make: make()) -> None:
    """Write a SOG in one file, a zip, row i being splat i; the file appears only once it is complete.

    splats: their neighbours in space are best neighbours in the file, too, which makes it smaller:
    `Splats.spatial_order`. Warns with a DataWarning as `sog_files`.
    """
    files = sog_files(splats, os.fspath(path), shapes)
    with staged_file(path) as staging, zipfile.ZipFile(staging, "w") as archive:  # images are compressed already
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name), data)


def sog_files(splats: Splats, path: str = "splats", shapes: Shapes = lambda splats, make: make()) -> dict[str, bytes]:
    """Make the files of an unbundled SOG, row i being splat i.

    path: what warnings call it. Returns a dict of str to bytes by file name; the same splats give the same bytes. Warns
    with a DataWarning of splats that hold no finite values, which go out as transparent ones, and of harmonics, which
    are left out: each splat keeps its colour without a direction.
    """
    if splats.degree:
        warnings.warn(f"{path}: the harmonics of {len(splats)} splats were left out", DataWarning, stacklevel=2)
    splats, _ = hide_unusable(splats, path)
    files = dict(shapes(splats, lambda: _shape_files(splats)))
    color_book, colors = _coded(splats.sh[:, 0].astype(np.float64))
    meta = {
        "version": 2,
        "asset": {"generator": f"splat2mesh {VERSION}"},
        "count": len(splats),
        **({"model": ANTIALIASED} if splats.facts.antialiased else {}),
        **json.loads(files.pop(SHAPE)),
        "sh0": {"codebook": color_book, "files": ["sh0.webp"]},
    }
    files["sh0.webp"] = _webp(np.column_stack([colors, levels(splats.opacities, 8)]))
    return files | {"meta.json": json.dumps(meta).encode()}


def _shape_files(splats: Splats) -> dict[str, bytes]:
    """The images that no colour changes, and SHAPE."""
    mean_log = np.copysign(np.log1p(np.abs(splats.means.astype(np.float64))), splats.means)
    low, high = mean_log.min(axis=0), mean_log.max(axis=0)
    fixed = levels((mean_log - low) / np.maximum(high - low, 1e-12), 16)
    with np.errstate(divide="ignore"):
        scale_log = np.maximum(np.log(splats.scales.astype(np.float64)), LEAST_SCALE_LOG)
    quats = splats.quats_wxyz.astype(np.float64)
    small, largest = smallest_three(quats / np.linalg.norm(quats, axis=1, keepdims=True))
    turned = levels((small * math.sqrt(2) + 1) / 2, 8)
    scale_book, scales = _coded(scale_log)
    means = {"mins": low.tolist(), "maxs": high.tolist(), "files": ["means_l.webp", "means_u.webp"]}
    meta = {
        "means": means,
        "scales": {"codebook": scale_book, "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
    }
    images = {
        "means_l.webp": fixed & 255,
        "means_u.webp": fixed >> 8,
        "quats.webp": np.column_stack([turned, 252 + largest]),
        "scales.webp": scales,
    }
    return {name: _webp(values) for name, values in images.items()} | {SHAPE: json.dumps(meta).encode()}


def _coded(values: NDArray[np.float64]) -> tuple[list[float], NDArray[np.uint8]]:
    """A codebook of ENTRIES ascending numbers, and the entry nearest to each value: list, uint8 of the same shape."""
    low, high = float(values.min()), float(values.max())
    step = max(high - low, 1e-9) / BINS
    counts = np.bincount(np.minimum(((values - low) / step).astype(np.int64), BINS - 1).ravel(), minlength=BINS)
    centers = low + (np.arange(BINS) + 0.5) * step
    # Where much lies entries are dense, and none is far from any value: half by number, half by distance.
    rising = np.cumsum(counts) / counts.sum() + (np.arange(BINS) + 1) / BINS
    book = np.interp((np.arange(ENTRIES) + 0.5) / ENTRIES * 2.0, rising, centers).astype(np.float32)
    return book.tolist(), np.searchsorted((book[1:] + book[:-1]) / 2, values).astype(np.uint8)


def _webp(values: NDArray[Any]) -> bytes:
    """(N, 3 or 4) integers to 255 as an image without loss, a row of pixels after the other; the rest is black."""
    width = 4 * math.ceil(math.sqrt(len(values)) / 4)
    image = np.zeros((4 * math.ceil(len(values) / width / 4) * width, 4), np.uint8)
    image[:, 3] = 255
    image[: len(values), : values.shape[1]] = values
    file = io.BytesIO()
    Image.fromarray(image.reshape(-1, width, 4)).save(file, "WEBP", lossless=True, exact=True)
    return file.getvalue()
