"""The textures of a glTF file: which picture each shows, where on it a vertex lies, and the light of its texels.

Source: Khronos, "glTF 2.0 Specification", KHR_texture_transform, EXT_texture_webp, KHR_texture_basisu,
KHR_materials_pbrSpecularGlossiness.
"""

import io
import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pygltflib as codes
from numpy.typing import NDArray
from PIL import Image

from ..base.errors import DataWarning, InputError
from ..base.gltf import GltfData, entry
from .color import linear_from_srgb

MOST_TEXELS = 1 << 26
"""Most texels of a picture, and of those of a file that are kept at a time: four of 4,096 x 4,096."""

READABLE = "PNG", "JPEG", "WEBP", "BMP", "GIF"
"""Kinds of pictures that are decoded; a library that opens any would run other programs for some."""

GREY = 0.5
"""Linear colour of a texture that cannot be decoded."""

SPECULAR_GLOSSINESS, TRANSFORM = "KHR_materials_pbrSpecularGlossiness", "KHR_texture_transform"

_CLAMPED, _MIRRORED = codes.CLAMP_TO_EDGE, codes.MIRRORED_REPEAT  # of a sampler; others repeat


def base_color(material: Any) -> tuple[list[float], Any]:
    """The colour of a material: its factor, linear RGBA, and its textureInfo or None.

    Of KHR_materials_pbrSpecularGlossiness it is the diffuse colour, and the specular one of metals, whose diffuse
    colour is black.
    """
    other = (material.extensions or {}).get(SPECULAR_GLOSSINESS)
    if other is None:
        surface = material.pbrMetallicRoughness or {}
        return list(surface.get("baseColorFactor") or [1.0] * 4), surface.get("baseColorTexture")
    diffuse = list(other.get("diffuseFactor") or [1.0] * 4)
    if any(value > 0.0 for value in diffuse[:3]):
        return diffuse, other.get("diffuseTexture")
    return [*(other.get("specularFactor") or [1.0] * 3), diffuse[3]], other.get("specularGlossinessTexture")


@dataclass(frozen=True, eq=False)
class MappedTexture:
    """A picture on vertices. pixels: (H, W, 4) uint8 or uint16, sRGB and alpha. uv: (V, 2) float64, transformed. wraps:
    those of its sampler, across and down. decoded: whether it is that of the file, not a grey texel in its place."""

    pixels: NDArray[Any]
    uv: NDArray[np.float64]
    wraps: tuple[int, int]
    decoded: bool = True

    def color(self, uv: NDArray, least_alpha: float = 0.0) -> NDArray[np.float32]:
        """(N, 3) float32 linear of the nearest texels at (N, 2); where one has less alpha, of those around it that have
        not."""
        row, column = self._texel(uv)
        found = self.pixels[row, column]
        bare = np.flatnonzero(self._unit(found[:, 3]) < least_alpha)
        if len(bare):
            summed, weight = np.zeros((len(bare), 4)), np.zeros((len(bare), 1))
            height, width = self.pixels.shape[:2]
            for down, right in np.ndindex(3, 3):
                around = row[bare] + down - 1, column[bare] + right - 1
                texel = self.pixels[np.clip(around[0], 0, height - 1), np.clip(around[1], 0, width - 1)]
                covers = (self._unit(texel[:, 3]) >= least_alpha)[:, None]
                summed, weight = summed + covers * texel.astype(np.float64), weight + covers
            found[bare] = np.where(weight > 0.0, np.rint(summed / np.maximum(weight, 1.0)), found[bare])
        return linear_from_srgb(self._unit(found[:, :3])).astype(np.float32)

    def alpha(self, uv: NDArray) -> NDArray[np.float32]:
        """(N,) float32 at (N, 2), linear between the middles of texels."""
        height, width = self.pixels.shape[:2]
        place = np.nan_to_num(np.asarray(uv, np.float64)) * [width, height] - 0.5
        first = np.floor(place)
        across, down = (place - first).T
        found = np.zeros(len(place))
        for x, y, weight in (
            (0, 0, (1 - across) * (1 - down)),
            (1, 0, across * (1 - down)),
            (0, 1, (1 - across) * down),
            (1, 1, across * down),
        ):
            row, column = self._texel((first + np.array([x + 0.5, y + 0.5])) / [width, height])
            found += weight * self._unit(self.pixels[row, column, 3])
        return found.astype(np.float32)

    def _unit(self, values: NDArray) -> NDArray[np.float32]:
        return values.astype(np.float32) / np.float32(np.iinfo(self.pixels.dtype).max)

    def _texel(self, uv: NDArray) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Row and column, (N,) each, of the texel that holds a place."""
        place = np.nan_to_num(np.asarray(uv, np.float64))
        found = []
        for axis, count in ((1, self.pixels.shape[0]), (0, self.pixels.shape[1])):
            along = place[:, axis]
            if self.wraps[axis] == _CLAMPED:
                along = np.clip(along, 0.0, 1.0)
            elif self.wraps[axis] == _MIRRORED:
                along = 1.0 - np.abs(along % 2.0 - 1.0)
            else:
                along = along % 1.0
            found.append(np.minimum((along * count).astype(np.int64), count - 1))
        return found[0], found[1]


class Textures:
    """The textures of a file, each picture decoded once."""

    def __init__(self, data: GltfData) -> None:
        self._data = data
        self._pictures: dict[int, NDArray[Any] | None] = {}
        self._lost: dict[int, str] = {}

    def on(self, info: Any, held: dict[str, NDArray]) -> MappedTexture | None:
        """The MappedTexture of a textureInfo on vertices that hold attributes; None without coordinates, or where it
        shows no picture. Raises InputError for pictures that are too large."""
        moved = (info.get("extensions") or {}).get(TRANSFORM) or {}
        number = moved.get("texCoord", info.get("texCoord"))
        uv = held.get(f"TEXCOORD_{number or 0}")
        if uv is None or uv.shape[1] != 2:
            return None
        texture = entry(self._data.document.textures, info.get("index"))
        sampler = {} if texture.sampler is None else entry(self._data.document.samplers, texture.sampler)
        for source in _sources(texture):
            pixels = self._picture(source)
            if pixels is not None:
                return MappedTexture(pixels, _moved(uv, moved), (sampler.get("wrapS") or 0, sampler.get("wrapT") or 0))
        if _sources(texture):
            self._lost[info["index"]] = ", ".join(texture.extensions or {}) or "another kind of picture"
            pixels = np.full((1, 1, 4), 255, np.uint8)
            pixels[..., :3] = round(255 * (1.055 * GREY ** (1 / 2.4) - 0.055))
            return MappedTexture(pixels, np.zeros((len(uv), 2)), (0, 0), False)
        return None

    def base_colors(self, number: int | None, held: dict[str, NDArray]) -> NDArray[np.float32]:
        """(V, 3) or (3,) float32 linear base colour of a material, by its number or None, on vertices that hold
        attributes: its factor times its texture at each."""
        if number is None:
            return np.ones(3, np.float32)
        factor, info = base_color(entry(self._data.document.materials, number))
        plain = np.clip(np.asarray(factor[:3], np.float32), 0.0, 1.0)
        on = info and self.on(info, held)
        return plain * on.color(on.uv) if on else plain

    def encoded(self, index: int) -> bytes:
        """The picture of a texture as PNG or JPEG, which every program reads. Raises InputError for none."""
        for source in _sources(entry(self._data.document.textures, index)):
            content = self._data.encoded(entry(self._data.document.images, source))
            if content.startswith((b"\x89PNG", b"\xff\xd8")):
                return content
            pixels = self._picture(source)
            if pixels is not None:
                packed = io.BytesIO()
                Image.fromarray(pixels.astype(np.uint8)).save(packed, "PNG")
                return packed.getvalue()
        raise InputError(f"{self._data.path}: texture {index} has no picture that can be decoded")

    def warn_lost(self) -> None:
        """Give one DataWarning about textures that could not be decoded."""
        if self._lost:
            kinds = ", ".join(sorted(set(self._lost.values())))
            message = f"{self._data.path}: {len(self._lost)} textures cannot be decoded ({kinds}), and are grey"
            warnings.warn(f"{message}: export them as PNG, JPEG or WebP", DataWarning, stacklevel=3)

    def _picture(self, source: int) -> NDArray[Any] | None:
        """(H, W, 4) uint8 or uint16 of an image, or None where it is of another kind."""
        if source not in self._pictures:
            try:
                content = self._data.encoded(entry(self._data.document.images, source))
            except InputError:  # its file is not there
                content = b""
            found = decoded(content, MOST_TEXELS, self._data.path)
            texels = 0 if found is None else found.shape[0] * found.shape[1]
            for name, old in reversed(list(self._pictures.items())):  # what is dropped is decoded again if need be
                texels += 0 if old is None else old.shape[0] * old.shape[1]
                if texels > MOST_TEXELS:
                    del self._pictures[name]
            self._pictures[source] = found
        return self._pictures[source]


def decoded(content: bytes, room: int, path: Any) -> NDArray[Any] | None:
    """(H, W, 4) uint8 or uint16 of a picture, None where it cannot be decoded. Raises InputError for more texels than
    there is room for. path: of the file that it is of, for the message."""
    try:
        with Image.open(io.BytesIO(content), formats=READABLE) as opened:
            if opened.width * opened.height > room:
                raise InputError(f"{path}: its pictures have over {MOST_TEXELS:,} pixels; make them smaller")
            if not opened.mode.startswith("I"):
                return np.asarray(opened.convert("RGBA"))
            grey = np.asarray(opened)[..., None].clip(0, 65535).astype(np.uint16)  # 16 bits: a conversion would clip
    except (InputError, MemoryError):
        raise
    except Exception:  # a dozen types, over what is damaged or of another kind
        return None
    return np.concatenate([grey, grey, grey, np.full_like(grey, 65535)], axis=2)


def _sources(texture: Any) -> list[int]:
    """Images of a texture, those of its extensions first, which the plain one stands in for."""
    other = [each.get("source") for _, each in sorted((texture.extensions or {}).items())]
    return [each for each in (*other, texture.source) if each is not None]


def _moved(uv: NDArray, transform: dict[str, Any]) -> NDArray[np.float64]:
    """Coordinates scaled, turned and moved by KHR_texture_transform."""
    turn = float(transform.get("rotation", 0.0))
    cosine, sine = math.cos(turn), math.sin(turn)
    scaled = uv.astype(np.float64) * np.array(transform.get("scale", (1.0, 1.0)), np.float64)
    turned = scaled @ np.array([[cosine, -sine], [sine, cosine]])
    return turned + np.array(transform.get("offset", (0.0, 0.0)), np.float64)
