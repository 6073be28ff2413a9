"""Triangle meshes in files: any common format in, PLY out."""

import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .color import srgb_from_linear
from .errors import InputError

READABLE_SUFFIXES = (".ply", ".obj", ".glb", ".gltf", ".stl", ".off")


@dataclass(frozen=True)
class Mesh:
    """A triangle mesh with one normal and one colour per vertex.

    vertices: (V, 3) float32. normals: (V, 3) float32, unit, or zero where undefined.
    faces: (F, 3) int32, counter-clockwise seen from outside. colors_srgb: (V, 3) uint8.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    colors_srgb: np.ndarray


def read_mesh(path):
    """Read a mesh file; polygons become triangle fans, missing normals are computed, missing colours are white.

    The vertex order is the one in which open3d reads the file. Raises InputError for a file that is missing, of
    another kind, broken, or without triangles.
    """
    import open3d as o3d

    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such mesh file")
    if path.suffix.lower() not in READABLE_SUFFIXES:
        raise InputError(f"{path}: not a mesh file I can read; expected one of {' '.join(READABLE_SUFFIXES)}")
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error), _triangulated_obj(path) as readable:
        try:
            mesh = o3d.io.read_triangle_mesh(os.fspath(readable))
        except RuntimeError as error:
            raise InputError(f"{path}: cannot be read as a mesh ({error})") from error
    if len(mesh.triangles) == 0:
        raise InputError(f"{path}: holds no triangles; expected a triangle mesh")
    vertices = np.asarray(mesh.vertices)
    if not np.isfinite(vertices).all():
        bad = int((~np.isfinite(vertices)).any(axis=1).sum())
        raise InputError(f"{path}: {bad} of {len(vertices)} vertices are not finite; repair the mesh first")
    if not mesh.has_vertex_normals():
        mesh.compute_vertex_normals()
    colors = np.asarray(mesh.vertex_colors) if mesh.has_vertex_colors() else np.ones((len(vertices), 3))
    if path.suffix.lower() in (".glb", ".gltf"):
        colors = srgb_from_linear(colors)
    return Mesh(
        vertices.astype(np.float32),
        np.asarray(mesh.vertex_normals).astype(np.float32),
        np.asarray(mesh.triangles).astype(np.int32),
        np.round(np.clip(colors, 0.0, 1.0) * 255.0).astype(np.uint8),
    )


def write_mesh_ply(path, mesh):
    """Write a Mesh as binary PLY: float position, float normal, uchar sRGB colour."""
    vertex = np.zeros(len(mesh.vertices), [("position", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
    vertex["position"], vertex["normal"], vertex["color"] = mesh.vertices, mesh.normals, mesh.colors_srgb
    face = np.zeros(len(mesh.faces), [("count", "u1"), ("indices", "<i4", 3)])
    face["count"], face["indices"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", ""]
    with open(path, "wb") as file:
        file.write("\n".join(header).encode("ascii"))
        vertex.tofile(file)
        face.tofile(file)


class _triangulated_obj:
    """The file itself, or for an OBJ with larger polygons (which open3d skips) a temporary fan-triangulated copy."""

    def __init__(self, path):
        self._path, self._copy = path, None

    def __enter__(self):
        if self._path.suffix.lower() != ".obj":
            return self._path
        lines = self._path.read_text(encoding="utf-8", errors="replace").split("\n")
        if not any(line.startswith("f ") and len(line.split()) > 4 for line in lines):
            return self._path
        handle, self._copy = tempfile.mkstemp(suffix=".obj")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            for line in lines:
                corners = line.split()
                if corners[:1] == ["f"] and len(corners) > 4:
                    for second, third in zip(corners[2:], corners[3:], strict=False):
                        file.write(f"f {corners[1]} {second} {third}\n")
                elif not line.startswith(("mtllib", "usemtl")):
                    file.write(line + "\n")
        return self._copy

    def __exit__(self, *_):
        if self._copy is not None:
            os.unlink(self._copy)
