"""Triangle meshes in files: any common format in, PLY out.

The content of a file is checked here, in Python, before a library in another language sees it.
"""

import os
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from ..base.inputs import file_size, quiet_numbers, reading
from ..splats.splats import ABSURD_LENGTH
from .gltfmesh import read_gltf
from .mesh import Mesh, vertex_normals, without_direction
from .objmesh import read_obj
from .plymesh import read_ply
from .stlmesh import read_stl
from .surfaces import UncheckedMesh, centred, check_corners, too_far

READERS: dict[str, Callable[..., UncheckedMesh]] = {
    ".ply": read_ply,
    ".obj": read_obj,
    ".glb": read_gltf,
    ".gltf": read_gltf,
    ".stl": read_stl,
}
READABLE_SUFFIXES = tuple(READERS)

WITH_MATERIALS = (".obj", ".glb", ".gltf")
"""Kinds whose materials have colours and pictures."""

LOOKED_AT, INVERTED = 4096, 0.9
"""Faces in the sample, and the share of reversed normals above which a warning follows."""


def read_mesh(path: str | os.PathLike[str], in_place: bool = False, painted: bool = True) -> Mesh:
    """Read a mesh file; polygons become triangle fans, missing normals are computed, missing colours are white.

    path: ends in one of `READABLE_SUFFIXES`. in_place: whether it is a part of something and must not be moved, however
    small and far from the origin it is. painted: whether vertices take the colours of materials: their factor times
    their picture at the vertex. Returns Mesh: vertices stand in the order of a PLY; of other files in that of their
    first use by faces, those with the same place, normal and colour joined. Raises InputError for a file that is
    missing, of another kind, broken, or without triangles. Warns with a DataWarning about what is left out, pictures
    that cannot be read, and about a mesh that was moved to the origin because float32 would lose it where it is.
    """
    return read_placed(path, in_place, painted)[0]


def read_placed(
    path: str | os.PathLike[str], in_place: bool = False, painted: bool = True
) -> tuple[Mesh, NDArray[np.float64] | None]:
    """Read a mesh file as `read_mesh` does; also what was taken off its points to bring them to the origin. path,
    in_place, painted: as of `read_mesh`. Returns mesh; moved: (3,) float64, or None."""
    path = Path(path)
    if not os.path.lexists(path) or path.is_dir():
        raise InputError(f"{path}: no such mesh file")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(f"{path}: not a readable mesh file; expected one of {' '.join(READABLE_SUFFIXES)}")
    file_size(path, "mesh file")
    with reading(path), quiet_numbers():
        found = reader(path, painted) if path.suffix.lower() in WITH_MATERIALS else reader(path)
        if found.moved is None and not in_place:
            points, moved = centred(found.points)
            found = found._replace(points=points, moved=moved)
        return checked_mesh(found, path), found.moved


def checked_mesh(surface: UncheckedMesh, path: str | os.PathLike[str]) -> Mesh:
    """Check all of a mesh. path: of its file, for messages. Raises InputError for what cannot be lit. Warns with a
    DataWarning as `read_mesh` does."""
    points, corners, normals, colors, moved = surface
    if len(corners) == 0:
        raise InputError(f"{path}: holds no triangles; expected a triangle mesh")
    check_corners(corners, len(points), path)
    bad = np.count_nonzero(~np.isfinite(points).all(axis=1))
    if bad:
        raise InputError(f"{path}: {bad} of {len(points)} vertices are not finite; repair the mesh first")
    if moved is not None:
        warnings.warn(f"{path}: {too_far(moved)}", DataWarning, stacklevel=5)
    far = np.count_nonzero((np.abs(points) > ABSURD_LENGTH).any(axis=1))
    if far:
        most = f"{ABSURD_LENGTH:g}"
        raise InputError(f"{path}: {far} of {len(points)} vertices lie beyond +-{most}; repair the mesh first")
    vertices = points.astype(np.float32)
    faces = corners.astype(np.int32)
    return Mesh(vertices, _normals(normals, vertices, faces, path), faces, _color_bytes(colors, len(vertices)))


def _normals(given: NDArray | None, vertices: NDArray, faces: NDArray, path: str | os.PathLike[str]) -> NDArray:
    """Normals of the file, or those of the faces if it has none."""
    if given is None:
        return vertex_normals(vertices, faces)
    normals = np.asarray(given, np.float32)
    some = faces[:: 1 + len(faces) // LOOKED_AT]
    corners = vertices[some].astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    against = float(np.mean(np.einsum("ij,ij->i", across, np.nan_to_num(normals[some].sum(axis=1))) < 0.0))
    if against > INVERTED:
        message = f"{path}: {against:.0%} of the normals point into the surface: flip them"
        warnings.warn(message, DataWarning, stacklevel=5)
    missing = without_direction(normals)
    if missing.any():
        normals = np.where(missing[:, None], vertex_normals(vertices, faces), normals)
    return normals


def _color_bytes(colors: NDArray | None, count: int) -> NDArray[np.uint8]:
    if colors is None:
        return np.full((count, 3), 255, np.uint8)
    return np.round(np.clip(np.nan_to_num(colors), 0.0, 1.0) * 255.0).astype(np.uint8)


def write_mesh_ply(path: str | os.PathLike[str], mesh: Mesh) -> None:
    """Write a Mesh as binary PLY: float position, float normal, uchar sRGB colour."""
    with open(path, "wb") as file:
        file.write(mesh_ply_bytes(mesh))


_VERTEX = [("position", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)]
_FACE = [("count", "u1"), ("indices", "<i4", 3)]


def mesh_from_ply_bytes(data: bytes) -> Mesh:
    """Return the Mesh of the bytes that `mesh_ply_bytes` made, bit by bit. Raises InputError for others."""
    header, mark, body = data.partition(b"end_header\n")
    words = header.split()
    try:
        count, faces = (int(words[words.index(name) + 1]) for name in (b"vertex", b"face"))
        vertex = np.frombuffer(body, np.dtype(_VERTEX), count)
        face = np.frombuffer(body, np.dtype(_FACE), faces, vertex.nbytes)
    except (ValueError, IndexError) as error:
        raise InputError(f"a mesh of a tile is damaged ({error}): make the city again") from None
    if not mark or len(body) != vertex.nbytes + face.nbytes:
        raise InputError("a mesh of a tile is damaged (its size is not what its header says): make the city again")
    return Mesh(*(np.array(a) for a in (vertex["position"], vertex["normal"], face["indices"], vertex["color"])))


def mesh_ply_bytes(mesh: Mesh) -> bytes:
    """Return the PLY that `write_mesh_ply` writes."""
    vertex = np.zeros(len(mesh.vertices), _VERTEX)
    vertex["position"], vertex["normal"], vertex["color"] = mesh.vertices, mesh.normals, mesh.colors_srgb
    face = np.zeros(len(mesh.faces), _FACE)
    face["count"], face["indices"] = 3, mesh.faces
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertex)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header += [f"element face {len(face)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(header).encode("ascii") + vertex.tobytes() + face.tobytes()
