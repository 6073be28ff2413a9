"""PlayCanvas SOG: WebP images of quantised attributes beside a meta.json, loose in a folder or in one zip.

Version 2 looks values up in codebooks of 256; version 1 (no `version` field) spreads bytes between `mins` and
`maxs`.
Source: developer.playcanvas.com, "The SOG format".
"""

import io
import lzma
import os
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.WebPImagePlugin import WebPImageFile

from ...base.errors import InputError
from ...base.inputs import FREE, GIB, LARGEST_TEXT, check_count, file_size, inside, loads
from ...base.threads import ROWS_AT_ONCE
from ..facts import FileFacts
from ..splats import DEGREE_OF_COEFFICIENTS, Splats
from .encoding import restore_largest, sigmoid

AnyPath: TypeAlias = str | os.PathLike[str]

META = "meta.json"
ZIP = b"PK\x03\x04"
ANTIALIASED = "antialiased"
"""Value of `model` in it, of splats for an anti-aliasing rasteriser. Source: playcanvas/splat-transform 3.2."""
PALETTE_PIXELS = 1 << 24
"""Most pixels of the palette of harmonics: 65536 entries of 15 are a million."""
_PALETTE_WIDTH = 64  # palette entries in one row of the centroid image
_FIRST_QUAT_TAG = 252  # alpha of the quaternion image: this plus the index of the largest component, wxyz


def read_folder(folder: Path, meta_name: str = META) -> Splats:
    """Read an unbundled SOG. folder: holds the images. meta_name: of the JSON that names them. Raises InputError when a
    part is missing or unusable."""
    if not (folder / meta_name).is_file():
        raise InputError(f"{folder} is a folder without {META}: expected a splat file or an unbundled SOG folder")

    def load(name: object) -> bytes:
        file = inside(folder, name, folder / meta_name)
        if not file.exists():
            raise InputError(f"{file} is missing: {META} names it, copy the whole SOG folder")
        if file_size(file) > GIB:
            raise InputError(f"{file} takes {file_size(file) >> 20} MB, expected at most {GIB >> 20}")
        return file.read_bytes()

    return _read(folder / meta_name, load, meta_name)


def read_bundle(path: AnyPath) -> Splats:
    """Read a `.sog` zip. Raises InputError when it is damaged or lacks a part."""
    size = file_size(path, "splat file")
    try:
        with zipfile.ZipFile(path) as bundle:
            metas = [name for name in bundle.namelist() if Path(name).name == META]
            if not metas:
                raise InputError(f"{path} is a zip without {META}: expected a .sog bundle")
            prefix = min(metas, key=len).removesuffix(META)

            def load(name: object) -> bytes:
                if not isinstance(name, str) or prefix + name not in bundle.namelist():
                    raise InputError(f"{path} lacks {name}, which its {META} names: export it again")
                announced = bundle.getinfo(prefix + name).file_size
                # WebP does not shrink, so an entry that does is made to fill the memory.
                if announced > max(LARGEST_TEXT if name == META else 4 * size, FREE):
                    raise InputError(f"{path}: {name} announces {announced:,} bytes in a file of {size:,}: damaged")
                return bundle.read(prefix + name)

            return _read(path, load, META)
    except (zipfile.BadZipFile, zlib.error, lzma.LZMAError, EOFError, NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path} is a damaged zip ({error}): copy or export it again") from error


def _read(path: AnyPath, load: Callable[[object], bytes], meta_name: str) -> Splats:
    try:
        meta = loads(load(meta_name))
        version = meta.get("version", 1)
        if version not in (1, 2):
            raise InputError(f"{path}: SOG version {version} is not supported: expected 1 or 2")
        return _decode(_Images(path, load, meta), meta, version)
    except InputError:
        raise
    except (ArithmeticError, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise InputError(f"{path}: {META} does not describe a SOG ({type(error).__name__}: {error})") from error


class _Images:
    """The images that a meta.json names, decoded and checked: RGBA rows of the first `count` pixels."""

    def __init__(self, path: AnyPath, load: Callable[[object], bytes], meta: dict[str, Any]) -> None:
        self.path, self.load, self.meta = path, load, meta
        self.count = int(meta["count"] if "count" in meta else meta["means"]["shape"][0])
        if self.count <= 0:
            raise InputError(f"{path} holds no splats: its count is {self.count}")
        names = {str(name) for part in ("means", "sh0", "scales", "quats") for name in meta[part]["files"]}
        self._loaded = {name: load(name) for name in sorted(names)}
        check_count(path, self.count, sum(map(len, self._loaded.values())))

    def image(self, part: str, index: int = 0) -> NDArray[np.uint8]:
        """(H, W, 4) uint8."""
        name = self.meta[part]["files"][index]
        data = self._loaded.get(name) or self.load(name)
        most = PALETTE_PIXELS if part == "shN" and index == 0 else max(2 * self.count, FREE)
        try:
            return _pixels(data, most)
        except (OSError, EOFError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
            raise InputError(f"{self.path}: {name} is not a readable WebP image ({error})") from error

    def texels(self, part: str, index: int = 0) -> NDArray[np.uint8]:
        """(count, 4) uint8, one row a splat."""
        pixels = self.image(part, index).reshape(-1, 4)
        if len(pixels) < self.count:
            name = self.meta[part]["files"][index]
            raise InputError(
                f"{self.path}: {name} has {len(pixels)} pixels, expected one for each of {self.count} splats"
            )
        return pixels[: self.count]


def _pixels(data: bytes, most: int = PALETTE_PIXELS) -> NDArray[np.uint8]:
    """(H, W, 4) uint8 of a WebP image of so many pixels at most, unchanged where alpha is 0. Raises the errors that
    Pillow does."""
    # The class, not Image.open, which warns of images that are large but expected here.
    with WebPImageFile(io.BytesIO(data)) as image:
        if image.width * image.height > most:  # known before its pixels are made
            raise ValueError(f"{image.width} x {image.height} pixels, at most {most:,} are expected")
        if getattr(image, "n_frames", 1) != 1:
            raise ValueError("an animation")
        return np.array(image.convert("RGBA"))


def _decode(images: _Images, meta: dict[str, Any], version: int) -> Splats:
    low, high = images.texels("means", 0)[:, :3], images.texels("means", 1)[:, :3]
    mean_log = _between(meta["means"], (low | high.astype(np.uint16) << 8) / np.float32(65535))
    color = images.texels("sh0")
    if version == 2:
        dc, opacities = _values(meta["sh0"], color[:, :3]), color[:, 3] / np.float32(255)
    else:  # the fourth channel has bounds of its own, in logits
        values = _values(meta["sh0"], color)
        dc, opacities = values[:, :3], sigmoid(values[:, 3])
    return Splats(
        np.copysign(np.expm1(np.abs(mean_log)), mean_log),
        np.exp(_values(meta["scales"], images.texels("scales")[:, :3])),
        _quats_wxyz(images),
        opacities,
        _with_rest(images, meta, dc),
        facts=FileFacts(True if meta.get("model") == ANTIALIASED else None),
    )


def _between(part: dict[str, Any], unit: NDArray[Any]) -> NDArray[Any]:
    low, high = (np.asarray(part[key], np.float32) for key in ("mins", "maxs"))
    return low + unit * (high - low)


def _values(part: dict[str, Any], texels: NDArray[np.uint8]) -> NDArray[Any]:
    """Numbers that bytes stand for: (..., C) uint8 -> float32 of the same shape."""
    if "codebook" not in part:
        return _between(part, texels / np.float32(255))
    codebook = np.array(part["codebook"], np.float32)
    if codebook.shape != (256,):
        raise ValueError(f"a codebook has 256 entries, found {codebook.shape}")
    if part["codebook"][0] is None:  # early writers lost the first entry; PlayCanvas extends the line of the others
        codebook[0] = codebook[1] + (codebook[1] - codebook[-1]) / 255
    return codebook[texels]


def _quats_wxyz(images: _Images) -> NDArray[np.float32]:
    texels = images.texels("quats")
    tags = texels[:, 3]
    if tags.min() < _FIRST_QUAT_TAG:
        raise InputError(f"{images.path}: {np.sum(tags < _FIRST_QUAT_TAG)} quaternions carry no valid mark: damaged")
    return restore_largest((texels[:, :3] / np.float32(127.5) - 1) / np.float32(np.sqrt(2)), tags - _FIRST_QUAT_TAG)


def _with_rest(images: _Images, meta: dict[str, Any], dc: NDArray[np.float32]) -> NDArray[np.float32]:
    """Join the constant coefficients and those of the palette: (N, 3) -> (N, K, 3)."""
    if "shN" not in meta:
        return dc[:, None]
    centroids = images.image("shN", 0)
    rest, ragged = divmod(centroids.shape[1], _PALETTE_WIDTH)
    if ragged or rest + 1 not in DEGREE_OF_COEFFICIENTS:
        raise InputError(
            f"{images.path}: the shN palette is {centroids.shape[1]} pixels wide, expected 192, 512 or 960"
        )
    palette = _values(meta["shN"], centroids[..., :3]).reshape(-1, rest, 3)
    labels = images.texels("shN", 1).astype(np.int32)
    labels = labels[:, 0] | labels[:, 1] << 8
    if labels.max() >= len(palette):
        raise InputError(f"{images.path}: a splat uses entry {labels.max()} of the shN palette of {len(palette)}")
    sh = np.empty((len(dc), rest + 1, 3), np.float32)
    sh[:, 0] = dc
    for start in range(0, len(sh), ROWS_AT_ONCE):
        rows = slice(start, start + ROWS_AT_ONCE)
        sh[rows, 1:] = palette[labels[rows]]
    return sh
