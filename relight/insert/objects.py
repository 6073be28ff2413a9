"""Inserted objects as arrays: triangles fine enough to carry light, albedo, and the pictures of their files.

Splats lose their captured light, and their mesh takes that of the place they are inserted into.
"""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Integers
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import GltfData, entry
from splat2mesh.base.inputs import quiet_numbers, reading
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.gltfmesh import Piece, placed_pieces
from splat2mesh.scene.gltftextures import MappedTexture, Textures, base_color
from splat2mesh.scene.mesh import Mesh, unit, vertex_normals
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import Splats

from ..albedo.division import DARKEST, LIGHTEST
from ..splats import Binding
from .asked import AskedInsert
from .refine import Cut, Masked, carried_through, cut_out, refined

if TYPE_CHECKING:
    from ..engine.appearance import Appearance

FINENESS = 48
"""Least number of edges along the diagonal of an object, since its vertices carry the light."""

MOST_FACES = 100_000
"""Number of vertices above which an object is not refined."""

GREY = 0.5
"""Linear albedo of objects without colours."""

CUTOFF = 0.5
"""Alpha from which a mask leaves the surface, where the file gives none. Source: glTF 2.0, alphaCutoff."""


@dataclass(frozen=True, eq=False)
class Part:
    """A part of an object with one material.

    vertices, normals: (V, 3) float32, y up. faces: (F, 3) int32. color: (V, 4) float32 linear, factor on the texture.
    uv: (V, 2) float32 or None, as its texture is looked up. albedo, emission: (V, 3) float32 linear, including the
    texture. material: its index in the document, or None. node: of the document, or None. rounds: the `refined` rounds
    since its file. cut: of an alpha mask after these, or None.
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
    cut: Cut | None = None

    def carried(self, values: NDArray) -> NDArray:
        """Values of the vertices in the file, (N, ...), at those of the part."""
        return carried_through(values, self.rounds, self.cut)


@dataclass(frozen=True, eq=False)
class SplatObject:
    """N inserted Gaussians and the mesh that lights them.

    binding: of the splats to their own scene. irradiance: (V, 3) captured irradiance of their mesh. rows:
    (M,) of the inserted splats; far background is not among them. object_from_splat: (4, 4).
    """

    binding: Binding
    irradiance: NDArray[np.float32]
    rows: NDArray[np.int64]
    object_from_splat: NDArray[np.float64]

    def relit(
        self,
        light: NDArray[np.float32],  # (V, 3) irradiance over pi, in units of the picture
        splat_from_object: NDArray[np.float64],  # (4, 4), the splat of the place
    ) -> Splats:
        """Return them under the light of the place, in the frame of its splat."""
        splats = self.binding.relit(self.irradiance, light).take(self.rows)
        return placed(splats, splat_from_object @ self.object_from_splat)


@dataclass(frozen=True, eq=False)
class InsertedObject:
    """An object in its own frame and unit, parts end to end. document: of its glTF file, None for others. splat: the
    SplatObject that it is, or None."""

    name: str
    parts: list[Part]
    document: GltfData | None = None
    splat: SplatObject | None = None

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
    packed = Path(source).suffix.lower() in (".glb", ".gltf")
    mesh = read_mesh(source, painted=not packed)  # checks the file
    if not packed:
        return InsertedObject(asked.name, [_fine(_of_mesh(mesh, asked), tint)])
    data = GltfData(os.fspath(source))
    textures = Textures(data)
    with reading(source), quiet_numbers():
        parts = [_fine(_of_piece(data, piece, textures, asked), tint, mesh) for piece in placed_pieces(data)]
    textures.warn_lost()
    if not any(len(part.faces) for part in parts):
        raise InputError(f"{source}: its alpha masks leave nothing of it; export it opaque")
    return InsertedObject(asked.name, parts, data)


def splat_object(name: str, scene: Scene, binding: Binding, count: int, look: "Appearance") -> InsertedObject:
    """Return an object of `count` splats and their own Scene. Its frame is upright and has their origin."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) or 1.0
    vertices = ((scene.vertices.astype(np.float64) - matrix[:3, 3]) / scale).astype(np.float32)
    albedo = np.ones_like(look.captured) if look.albedo is None else look.albedo
    albedo = np.maximum(albedo, np.float32(DARKEST))
    color = np.concatenate([albedo, np.ones((len(albedo), 1), np.float32)], axis=1)
    part = Part(vertices, scene.normals, scene.faces, color, None, albedo, np.zeros_like(albedo))
    object_from_splat = np.eye(4)
    object_from_splat[:3, :3] = matrix[:3, :3] / scale
    rows = np.delete(np.arange(count), scene.background_splats)
    return InsertedObject(name, [part], splat=SplatObject(binding, look.irradiance, rows, object_from_splat))


class _Raw:
    """A part before refinement. texture, glow: of its colour and its emission. cutoff: of its alpha mask, or None."""

    def __init__(self, points: NDArray, normals: NDArray, faces: Faces, color: NDArray) -> None:
        self.points, self.normals, self.faces, self.color = points, normals, faces, color
        self.texture: MappedTexture | None = None
        self.cutoff: float | None = None
        self.emitted = np.zeros(3)
        self.glow: MappedTexture | None = None
        self.material: int | None = None
        self.node: int | None = None


def _of_mesh(mesh: Mesh, asked: AskedInsert) -> _Raw:
    color = np.ones((len(mesh.vertices), 4), np.float32)
    color[:, :3] = linear_from_srgb(mesh.colors_srgb.astype(np.float32) / np.float32(255.0))
    if (mesh.colors_srgb == 255).all() and asked.albedo is None:
        color[:, :3] = GREY
    return _Raw(mesh.vertices, mesh.normals, mesh.faces, color)


def _of_piece(data: GltfData, piece: Piece, textures: Textures, asked: AskedInsert) -> _Raw:
    faces = piece.faces[:, ::-1] if piece.mirrored else piece.faces
    points = np.asarray(piece.points, np.float32)
    normals = piece.held.get("NORMAL")
    if normals is None or not normals.any(axis=1).all():
        normals = vertex_normals(points, faces)
    color = np.ones((len(points), 4), np.float32)
    raw = _Raw(points, unit(normals).astype(np.float32), faces, color)
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
    factor, texture = base_color(material)
    color *= np.clip(np.asarray(factor, np.float32), 0.0, 1.0)
    raw.texture = texture and textures.on(texture, piece.held)
    if material.alphaMode == "MASK":
        raw.cutoff = float(CUTOFF if material.alphaCutoff is None else material.alphaCutoff)
    strength = ((material.extensions or {}).get("KHR_materials_emissive_strength") or {}).get("emissiveStrength", 1.0)
    raw.emitted = np.asarray(material.emissiveFactor or [0.0] * 3, np.float64) * float(strength)
    if material.emissiveTexture and raw.emitted.any():
        raw.glow = textures.on(material.emissiveTexture, piece.held)
    return raw


def _fine(raw: _Raw, tint: NDArray, whole: Mesh | None = None) -> Part:
    """The Part, refined until its edges are short beside the whole mesh, and cut along its alpha mask."""
    extent = raw.points if whole is None else whole.vertices
    diagonal = float(np.linalg.norm(np.ptp(extent.astype(np.float64), axis=0)))
    faces, rounds = refined(raw.points, raw.faces, diagonal / FINENESS, MOST_FACES)
    cut = None
    if raw.cutoff is not None:
        uv = np.zeros((len(raw.points), 2)) if raw.texture is None else raw.texture.uv
        masked = Masked(np.asarray(raw.points, np.float64), uv, raw.color[:, 3], raw.texture, raw.cutoff)
        faces, more, cut = cut_out(masked.refined(rounds), faces, MOST_FACES)
        rounds = rounds + more

    def at_vertices(values: NDArray) -> NDArray[np.float32]:
        return carried_through(np.asarray(values, np.float32), rounds, cut)

    color = at_vertices(raw.color)
    color[:, :3] *= tint.astype(np.float32)
    albedo, shown = color[:, :3], None
    if raw.texture is not None:
        place = at_vertices(raw.texture.uv)
        albedo = albedo * raw.texture.color(place, raw.cutoff or 0.0)
        shown = place if raw.texture.decoded else None
    emission = np.broadcast_to(raw.emitted, albedo.shape)
    if raw.glow is not None:
        emission = emission * raw.glow.color(at_vertices(raw.glow.uv))
    points, normals = at_vertices(raw.points), unit(at_vertices(raw.normals)).astype(np.float32)
    reflected = np.asarray(np.clip(albedo, DARKEST, LIGHTEST), np.float32)
    sent = emission.astype(np.float32)
    return Part(points, normals, faces, color, shown, reflected, sent, raw.material, raw.node, rounds, cut)
