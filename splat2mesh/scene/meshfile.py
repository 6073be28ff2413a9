"""Triangle meshes in files: any common format in, PLY out."""

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..base.errors import InputError
from .color import srgb_from_linear
from .mesh import Mesh
from .plymesh import check_whole

READABLE_SUFFIXES = (".ply", ".obj", ".glb", ".gltf", ".stl", ".off")


def read_mesh(path: str | os.PathLike[str]) -> Mesh:
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
    silent = o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error)
    if path.suffix.lower() == ".ply":
        check_whole(path)  # open3d hands over the part that it could read, and says so on stderr alone
    with silent, _triangulated_obj(path) as readable:
        try:
            mesh = o3d.io.read_triangle_mesh(Path(readable))
        except RuntimeError as error:
            raise InputError(f"{path}: cannot be read as a mesh ({error})") from error
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if len(faces) == 0:
        raise InputError(f"{path}: holds no triangles; expected a triangle mesh")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"{path}: a face names a vertex beyond the {len(vertices)} there are; export it again")
    bad = np.count_nonzero(~np.isfinite(vertices).all(axis=1))
    if bad:
        raise InputError(f"{path}: {bad} of {len(vertices)} vertices are not finite; repair the mesh first")
    if not mesh.has_vertex_normals():
        mesh.compute_vertex_normals()
    colors = np.asarray(mesh.vertex_colors) if mesh.has_vertex_colors() else np.ones((len(vertices), 3))
    if path.suffix.lower() in (".glb", ".gltf"):
        colors = srgb_from_linear(colors)
    return Mesh(
        vertices.astype(np.float32),
        np.asarray(mesh.vertex_normals).astype(np.float32),
        faces.astype(np.int32),
        np.round(np.clip(colors, 0.0, 1.0) * 255.0).astype(np.uint8),
    )


def write_mesh_ply(path: str | os.PathLike[str], mesh: Mesh) -> None:
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


@contextmanager
def _triangulated_obj(path: Path) -> Iterator[Path]:
    """The file itself, or for an OBJ with larger polygons (which open3d skips) a temporary fan-triangulated copy."""
    lines = []
    if path.suffix.lower() == ".obj":
        lines = path.read_text(encoding="utf-8", errors="replace").split("\n")
    if not any(_is_polygon(line.split()) for line in lines):
        yield path
        return
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "triangulated.obj")
        with open(copy, "w", encoding="utf-8") as file:
            for line in lines:
                corners = line.split()
                if _is_polygon(corners):
                    for second, third in pairwise(corners[2:]):
                        file.write(f"f {corners[1]} {second} {third}\n")
                elif corners[:1] not in (["mtllib"], ["usemtl"]):
                    file.write(line + "\n")
        yield copy


def _is_polygon(corners: list[str]) -> bool:
    return corners[:1] == ["f"] and len(corners) > 4
