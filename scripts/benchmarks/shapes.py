"""The scenes of the benchmarks: your files and folders, and generated shapes by name."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from relight import Environment
from relight.transfer.occluder import Occluder
from scenes import KINDS, build
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

MADE_VERTICES = 40_000  # of a generated scene, where a subject names no other number
SHAPES = ("bumps", "tori", "ball", "ball-on-plane", *KINDS)
"""Names of the generated shapes."""


@dataclass(frozen=True)
class Shape:
    """Arrays of a mesh: (V, 3) float32 vertices and unit normals, (F, 3) int32 faces, (V, 3) float32 linear albedo."""

    name: str
    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    albedo: np.ndarray | None = None

    @property
    def occluder(self) -> Occluder:
        """A new one, whose tree is not yet built."""
        return Occluder(self.vertices, self.normals, self.faces)

    @property
    def scene(self) -> Scene:
        """A Scene in the colours of the albedo, white without one; one chunk, so that arrays fit it row by row."""
        if self.albedo is None:
            colors = np.full(self.vertices.shape, 255, np.uint8)
        else:
            colors = bytes_from_unit(srgb_from_linear(self.albedo))
        return Scene([Mesh(self.vertices, self.normals, self.faces, colors)])


def shape(name: str | Path, vertices: int = MADE_VERTICES) -> Shape:
    """The shape of this name: a generated one with about `vertices` vertices, or a scene folder or mesh file.

    White meshes have no albedo.
    """
    if name in KINDS:
        truth = build(str(name), 1, vertices)
        return Shape(str(name), truth.vertices, truth.normals, truth.faces, truth.albedo_linear)
    if name in SHAPES:
        return _of_open3d(str(name), vertices) if name in ("bumps", "tori") else _ball(str(name))
    scene = Scene.load(name)
    white = (scene.colors_srgb == 255).all()
    albedo = None if white else linear_from_srgb(scene.colors_srgb / np.float32(255)).astype(np.float32)
    return Shape(Path(name).stem, scene.vertices, scene.normals, scene.faces, albedo)


def _of_open3d(name, vertices):
    """bumps: a sphere with dents deep enough to shadow themselves; tori: a tangle of four."""
    import open3d as o3d

    mesh = o3d.geometry.TriangleMesh()
    if name == "bumps":
        mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, round(np.sqrt(vertices / 2)))
        points = np.asarray(mesh.vertices)
        dents = np.sin(9 * points).prod(axis=1, keepdims=True)
        mesh.vertices = o3d.utility.Vector3dVector(points * (1 + 0.3 * dents))
    else:
        across = max(8, round(np.sqrt(vertices / 10)))
        for k in range(4):
            torus = o3d.geometry.TriangleMesh.create_torus(1.0, 0.25, round(2.5 * across), across)
            turn = o3d.geometry.get_rotation_matrix_from_xyz((0.7 * k, 1.1 * k, 0.3 * k))
            mesh += torus.rotate(turn, (0, 0, 0)).translate((0.2 * k, 0, 0.1 * k))
    mesh.compute_vertex_normals()
    arrays = np.float32(mesh.vertices), np.float32(mesh.vertex_normals), np.int32(mesh.triangles)
    return Shape(name, *arrays)


def _ball(name):
    """A ball of 8,000 vertices, over a plane of twice its width or alone."""
    import open3d as o3d

    sphere = o3d.geometry.TriangleMesh.create_sphere(1.0, 64)
    vertices, faces = np.asarray(sphere.vertices), np.asarray(sphere.triangles)
    normals = vertices.copy()
    if name != "ball":
        side = np.linspace(-2.0, 2.0, 61)
        x, z = np.meshgrid(side, side, indexing="ij")
        first = (np.arange(60)[:, None] * 61 + np.arange(60)).reshape(-1, 1) + len(vertices)
        faces = np.concatenate([faces, (first + np.array([0, 62, 61, 0, 1, 62])).reshape(-1, 3)])
        vertices = np.concatenate([vertices, np.stack([x, np.full_like(x, -1.01), z], axis=-1).reshape(-1, 3)])
        normals = np.concatenate([normals, np.tile([0.0, 1.0, 0.0], (x.size, 1))])
    return Shape(name, np.float32(vertices), np.float32(normals), np.int32(faces))


def light_of(folder: Path, name: str) -> Environment:
    """The Environment NAME.exr of a folder, or turned by D degrees where the name ends in _rotD."""
    base, _, turn = name.partition("_rot")
    return Environment.load(folder / f"{base}.exr").rotated(float(turn or 0))


def ply_vertices(path: Path) -> np.ndarray:
    """Vertices of a binary little-endian PLY with all their properties, as a structured array."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    kinds = {"float": "<f4", "double": "<f8", "uchar": "u1", "int": "<i4"}
    fields, count, element = [], 0, ""
    for words in (line.split() for line in header.decode("latin1").splitlines()):
        if words[:1] == ["element"]:
            element = words[1]
            count = int(words[2]) if element == "vertex" else count
        elif words[:1] == ["property"] and element == "vertex":
            fields.append((words[2], kinds[words[1]]))
    return np.frombuffer(body, np.dtype(fields), count)
