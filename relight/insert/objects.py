"""Inserted objects as arrays: triangles fine enough to carry light, albedo, and the pictures of their files."""

import io
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Integers
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import GltfData, entry
from splat2mesh.base.inputs import quiet_numbers, reading
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.gltfmesh import Piece, placed_pieces
from splat2mesh.scene.mesh import Mesh, vertex_normals
from splat2mesh.scene.meshfile import read_mesh

from .asked import AskedInsert
from .refine import carried, refined, unit

if TYPE_CHECKING:
    from .splat_object import SplatObject

FINENESS = 48
"""Least number of edges along the diagonal of an object, since its vertices carry the light."""

MOST_FACES = 100_000
"""Number of vertices from which on an object is not refined."""

GREY = 0.5
"""Linear albedo of objects without colours."""

DARKEST, LIGHTEST = 0.02, 0.95
"""Range of albedo, as for captures: soot to fresh snow."""

MOST_TEXELS = 1 << 26
"""Most texels of all pictures of a file together."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of an object with one material.

    vertices, normals: (V, 3) float32, y up. faces: (F, 3) int32. color: (V, 4) float32 linear, factor on the texture.
    uv: (V, 2) float32 or None. albedo, emission: (V, 3) float32 linear, including the texture. material: its index in
    the document, or None. node: of the document, or None. rounds: the `refined` rounds since its file.
    """

    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    faces: Faces
    color: NDArray[np.float32]
    uv: NDArray[np.float32] | None
    albedo: NDArray[np.float32]
    emission: NDArray[np.float32]
    material: int | None = None
    node: int | None = None
    rounds: "list[Integers]" = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class InsertedObject:
    """An object in its own frame and unit, parts end to end. document: of its glTF file, None for others. splat: the
    SplatObject that it is, or None."""

    name: str
    parts: list[Part]
    document: GltfData | None = None
    splat: "SplatObject | None" = None

    def joined(self, name: str) -> NDArray:
        """An attribute of all parts: `vertices`, `normals`, `albedo` or `emission`."""
        return np.concatenate([getattr(part, name) for part in self.parts])

    @property
    def faces(self) -> Faces:
        """(F, 3) int32, rows of the joined vertices."""
        starts = np.cumsum([0, *(len(part.vertices) for part in self.parts)])
        return np.concatenate([part.faces + start for part, start in zip(self.parts, starts, strict=False)])


def read_object(asked: AskedInsert) -> InsertedObject:
    """Read the objects to insert. Raises InputError for a file that is missing, broken, or without triangles."""
    tint = np.ones(3) if asked.albedo is None else np.array(asked.albedo)
    source = asked.source
    if isinstance(source, Mesh):
        return InsertedObject(asked.name, [_fine(_of_mesh(source, asked), tint)])
    mesh = read_mesh(source)  # checks the file
    if Path(source).suffix.lower() not in (".glb", ".gltf"):
        return InsertedObject(asked.name, [_fine(_of_mesh(mesh, asked), tint)])
    data = GltfData(os.fspath(source))
    pictures: dict[Any, NDArray] = {}
    with reading(source), quiet_numbers():
        parts = [_fine(_of_piece(data, piece, pictures, asked), tint, mesh) for piece in placed_pieces(data)]
    return InsertedObject(asked.name, parts, data)


class _Raw:
    """A part before refinement. texture: (H, W, 3) linear, or None; glow: likewise, of its emission."""

    def __init__(self, points: NDArray, normals: NDArray, faces: Faces, color: NDArray) -> None:
        self.points, self.normals, self.faces, self.color = points, normals, faces, color
        self.uv: NDArray | None = None
        self.texture: NDArray | None = None
        self.emitted = np.zeros(3)
        self.glow: NDArray | None = None
        self.material: int | None = None
        self.node: int | None = None


def _of_mesh(mesh: Mesh, asked: AskedInsert) -> _Raw:
    color = np.ones((len(mesh.vertices), 4), np.float32)
    color[:, :3] = linear_from_srgb(mesh.colors_srgb.astype(np.float32) / np.float32(255.0))
    if (mesh.colors_srgb == 255).all() and asked.albedo is None:
        color[:, :3] = GREY
    return _Raw(mesh.vertices, mesh.normals, mesh.faces, color)


def _of_piece(data: GltfData, piece: Piece, pictures: dict[Any, NDArray], asked: AskedInsert) -> _Raw:
    faces = piece.faces[:, ::-1] if piece.mirrored else piece.faces
    points = np.asarray(piece.points, np.float32)
    normals = piece.held.get("NORMAL")
    if normals is None or not normals.any(axis=1).all():
        normals = vertex_normals(points, faces)
    color = np.ones((len(points), 4), np.float32)
    raw = _Raw(points, unit(normals), faces, color)
    raw.node = piece.node
    painted = piece.held.get("COLOR_0")
    if painted is not None:
        color[:, : painted.shape[1]] = np.clip(np.nan_to_num(painted), 0.0, 1.0)
    if piece.material is None:
        if painted is None and asked.albedo is None:
            color[:, :3] = GREY
        return raw
    raw.material = piece.material
    material = entry(data.document.materials, piece.material)
    surface = material.pbrMetallicRoughness
    factor = (surface and surface.baseColorFactor) or [1.0] * 4
    color *= np.clip(np.asarray(factor, np.float32), 0.0, 1.0)
    if surface and surface.baseColorTexture:
        raw.uv = piece.held.get(f"TEXCOORD_{surface.baseColorTexture.texCoord or 0}")
        if raw.uv is not None:
            raw.texture = _texture(data, surface.baseColorTexture.index, pictures)
    strength = ((material.extensions or {}).get("KHR_materials_emissive_strength") or {}).get("emissiveStrength", 1.0)
    raw.emitted = np.asarray(material.emissiveFactor or [0.0] * 3, np.float64) * float(strength)
    if material.emissiveTexture and raw.emitted.any() and raw.uv is not None:
        raw.glow = _texture(data, material.emissiveTexture.index, pictures)
    return raw


def _fine(raw: _Raw, tint: NDArray, whole: Mesh | None = None) -> Part:
    """The Part, refined until its edges are short beside the whole mesh."""
    extent = raw.points if whole is None else whole.vertices
    diagonal = float(np.linalg.norm(np.ptp(extent.astype(np.float64), axis=0)))
    faces, rounds = refined(raw.points, raw.faces, diagonal / FINENESS, MOST_FACES)
    points, color = carried(np.asarray(raw.points, np.float32), rounds), carried(raw.color, rounds)
    uv = None if raw.uv is None else carried(np.asarray(raw.uv, np.float32), rounds)
    color[:, :3] *= tint.astype(np.float32)
    albedo = color[:, :3] * (1.0 if uv is None or raw.texture is None else _looked_up(raw.texture, uv))
    emission = np.broadcast_to(raw.emitted, albedo.shape)
    if uv is not None and raw.glow is not None:
        emission = emission * _looked_up(raw.glow, uv)
    normals = unit(carried(np.asarray(raw.normals, np.float32), rounds))
    reflected = np.asarray(np.clip(albedo, DARKEST, LIGHTEST), np.float32)
    uv = uv if raw.texture is not None else None
    sent = emission.astype(np.float32)
    return Part(points, normals, faces, color, uv, reflected, sent, raw.material, raw.node, rounds)


def _texture(data: GltfData, index: Any, pictures: dict[Any, NDArray]) -> NDArray | None:
    """(H, W, 3) float32 linear of a texture; None of one without a picture."""
    from PIL import Image

    source = entry(data.document.textures, index).source
    if source is None:
        return None
    if source not in pictures:
        room = MOST_TEXELS - sum(each.shape[0] * each.shape[1] for each in pictures.values())
        with Image.open(io.BytesIO(data.encoded(entry(data.document.images, source)))) as opened:
            if opened.width * opened.height > room:
                raise InputError(f"{data.path}: its pictures have over {MOST_TEXELS:,} pixels; make them smaller")
            pixels = np.asarray(opened.convert("RGB"), np.float32) / np.float32(255.0)
        pictures[source] = linear_from_srgb(pixels).astype(np.float32)
    return pictures[source]


def _looked_up(texture: NDArray, uv: NDArray) -> NDArray[np.float32]:
    """(V, 3) of the nearest texels, as textures repeat."""
    height, width = texture.shape[:2]
    place = np.nan_to_num(uv.astype(np.float64)) % 1.0
    column = np.minimum((place[:, 0] * width).astype(np.int64), width - 1)
    row = np.minimum((place[:, 1] * height).astype(np.int64), height - 1)
    return np.asarray(texture[row, column], np.float32)
