"""Whatever holds a scene: a Scene, a path, or a mesh of this package, of trimesh or of open3d, by its attributes."""

import os
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from .mesh import Mesh, vertex_normals
from .scene import Scene
from .surfaces import FAR, centred, check_corners, frame_from_own, too_far

if TYPE_CHECKING:
    import open3d
    import trimesh

AnyScene: TypeAlias = "Scene | Mesh | str | os.PathLike[str] | trimesh.Trimesh | open3d.geometry.TriangleMesh"
"""The types that `as_scene` takes."""


def as_scene(source: AnyScene) -> Scene:
    """Make a Scene of whatever holds one.

    source: Scene, path, Mesh, or a mesh with the `vertices`, the `faces` or `triangles`, and perhaps the
    `vertex_normals` and `vertex_colors` of trimesh or open3d; a Scene is returned as it is. A path is of a scene folder
    or mesh file. Returns Scene: a mesh becomes a scene of one chunk, its vertices in their own order; missing normals
    are computed, missing colours are white; colours are taken as sRGB, textures are not read. Raises InputError for
    anything else and for meshes that cannot be lit. Warns with a DataWarning about a mesh that was moved to the origin,
    where float32 would lose it, with what it has lost already.
    """
    if isinstance(source, Scene):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Scene.load(source)
    if isinstance(source, Mesh):
        return _near(np.asarray(source.vertices), source)
    faces = getattr(source, "faces", getattr(source, "triangles", None))
    if faces is None or not hasattr(source, "vertices"):
        kind = f"{type(source).__module__}.{type(source).__qualname__}"
        raise InputError(f"expected a Scene, a path, or a mesh with vertices and faces, found {kind}")
    visual = source if hasattr(source, "vertex_colors") else getattr(source, "visual", None)
    return _scene(
        source.vertices, faces, getattr(source, "vertex_normals", None), getattr(visual, "vertex_colors", None)
    )


def _scene(vertices: Any, faces: Any, normals: Any, colors: Any) -> Scene:
    """The Scene of (V, 3) vertices, (F, 3) faces, (V, 3) normals or None, (V, 3 or 4) colours, bytes or 0..1, or None.
    Raises InputError for arrays of another shape, values that are not finite and faces beyond the vertices."""
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise InputError(f"expected a triangle mesh, found vertices {vertices.shape} and faces {faces.shape}")
    bad = np.count_nonzero(~np.isfinite(vertices).all(axis=1))
    if bad:
        raise InputError(f"{bad} of {len(vertices)} vertices are not finite; repair the mesh first")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InputError(f"a face names a vertex beyond the {len(vertices)} there are")
    faces = faces.astype(np.int32)
    if normals is None or np.shape(normals) != vertices.shape:
        normals = vertex_normals(vertices, faces)
    colors_srgb = _color_bytes(colors, len(vertices))
    return _near(vertices, Mesh(vertices.astype(np.float32), np.asarray(normals, np.float32), faces, colors_srgb))


def _near(vertices: NDArray[Any], mesh: Mesh) -> Scene:
    """The Scene of a mesh with vertices (V, 3) as they came, at the origin where float32 would lose it."""
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        return Scene([mesh])  # which is refused where it is lit
    points, moved = centred(vertices.astype(np.float64))
    if moved is None:
        return Scene([mesh])
    check_corners(mesh.faces, len(points), "a mesh")
    stored = vertices if vertices.dtype.kind == "f" else points
    lost, rounding = "", float(np.spacing(np.nanmax(np.abs(stored))))
    edges = points[mesh.faces] - points[np.roll(mesh.faces, 1, axis=1)]
    edge = float(np.median(np.linalg.norm(edges, axis=2))) if len(edges) else 0.0
    if rounding > FAR * edge:
        part = f", {rounding / edge:.1%} of its median edge" if edge > 0.0 else ""
        lost = f". It came rounded to {rounding:.3g}{part}: make it of float64, or near the origin"
    warnings.warn(f"a mesh: {too_far(moved)}{lost}", DataWarning, stacklevel=4)
    return Scene([replace(mesh, vertices=points.astype(np.float32))], scene_from_splat=frame_from_own(moved))


def _color_bytes(colors: Any, count: int) -> NDArray[np.uint8]:
    """(V, 3) uint8 sRGB of colours as libraries keep them; white where there is not one for each vertex."""
    colors = None if colors is None else np.asarray(colors)
    if colors is None or colors.ndim != 2 or len(colors) != count or colors.shape[1] not in (3, 4):
        return np.full((count, 3), 255, np.uint8)
    if colors.dtype.kind == "f":
        return np.round(np.clip(colors[:, :3], 0.0, 1.0) * 255.0).astype(np.uint8)
    return colors[:, :3].astype(np.uint8)
