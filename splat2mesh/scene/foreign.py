"""Meshes of other libraries as scenes: trimesh, open3d and PyVista, distinguished without importing any of them."""

import os
import warnings
from dataclasses import replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from .color import srgb_from_linear
from .mesh import Mesh, vertex_normals
from .scene import Scene
from .surfaces import FAR, centred, check_corners, frame_from_own, too_far

if TYPE_CHECKING:
    import open3d
    import pyvista
    import trimesh

AnyScene: TypeAlias = (
    "Scene | Mesh | str | os.PathLike[str] | trimesh.Trimesh | trimesh.Scene"
    " | open3d.geometry.TriangleMesh | open3d.t.geometry.TriangleMesh | pyvista.DataSet"
)
"""The types that `as_scene` takes."""

COLOR_ARRAYS = ("colors", "Colors", "RGB", "RGBA", "rgb", "rgba")
"""Names under which PyVista's readers and users keep the colours of points."""


def as_scene(source: AnyScene) -> Scene:
    """Make a Scene of whatever holds one.

    source: Scene, path, Mesh, or a mesh of trimesh, open3d (legacy or tensor) or PyVista, a Scene is returned as it is.
    A path is of a scene folder or mesh file. Returns Scene: a mesh becomes a scene of one chunk, its vertices in their
    own order; polygons become triangles, missing normals are computed, missing colours are white; colours are taken as
    sRGB. Raises InputError for anything else and for meshes that cannot be lit. Warns with a DataWarning about a mesh
    that was moved to the origin, where float32 would lose it, with what it has lost already; about colours that are not
    read.
    """
    if isinstance(source, Scene):
        return source
    if isinstance(source, (str, os.PathLike)):
        return Scene.load(source)
    if isinstance(source, Mesh):
        return _near(np.asarray(source.vertices), source)
    library = type(source).__module__.partition(".")[0]
    if library == "trimesh":
        return _scene(*_of_trimesh(source))
    if library == "open3d":
        return _scene(*_of_open3d(source))
    if hasattr(source, "point_data") and hasattr(source, "extract_surface"):
        return _scene(*_of_pyvista(source))
    kind = f"{type(source).__module__}.{type(source).__qualname__}"
    raise InputError(f"expected a Scene, a path, or a mesh of trimesh, open3d or PyVista, found {kind}")


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


def _of_trimesh(mesh: Any) -> tuple[Any, Any, Any, Any]:
    if hasattr(mesh, "geometry"):  # a trimesh.Scene
        mesh = mesh.to_mesh() if hasattr(mesh, "to_mesh") else mesh.dump(concatenate=True)
    if not hasattr(mesh, "faces"):
        raise InputError(f"expected a triangle mesh, found a trimesh.{type(mesh).__name__} without faces")
    visual: Any = getattr(mesh, "visual", None)
    kind, colors = getattr(visual, "kind", None), None
    if kind == "texture":
        colors = _of_trimesh_material(visual, len(mesh.vertices))
    elif kind is not None:
        colors = visual.vertex_colors
    return mesh.vertices, mesh.faces, mesh.vertex_normals, colors


def _of_trimesh_material(visual: Any, count: int) -> Any:
    """(V, 3 or 4) sRGB of a trimesh TextureVisuals: its picture where it has one, else its factor, else None."""
    material = visual.material
    pictures = (getattr(material, name, None) for name in ("baseColorTexture", "image"))
    if visual.uv is not None and any(each is not None for each in pictures):
        return visual.to_color().vertex_colors
    factor = getattr(material, "baseColorFactor", None)
    if factor is not None:  # linear, as in glTF
        return np.tile(srgb_from_linear(np.asarray(factor, np.float64)[:3] / 255.0), (count, 1))
    plain = getattr(material, "diffuse", None)
    return None if plain is None else np.tile(np.asarray(plain)[:3], (count, 1))


def _of_open3d(mesh: Any) -> tuple[Any, Any, Any, Any]:
    if hasattr(mesh, "vertex"):  # of tensors
        mesh = mesh.to_legacy()
    if not hasattr(mesh, "triangles"):
        raise InputError(f"expected a triangle mesh, found an open3d {type(mesh).__name__}")
    if not mesh.has_vertex_colors() and mesh.has_textures():
        warnings.warn("an open3d mesh: its textures are not read; save it as .glb", DataWarning, stacklevel=3)
    normals = mesh.vertex_normals if mesh.has_vertex_normals() else None
    return mesh.vertices, mesh.triangles, normals, mesh.vertex_colors if mesh.has_vertex_colors() else None


def _of_pyvista(data: Any) -> tuple[Any, Any, Any, Any]:
    surface = data if hasattr(data, "faces") and hasattr(data, "triangulate") else data.extract_surface()
    surface = surface.triangulate()
    faces = np.asarray(surface.faces).reshape(-1, 4)[:, 1:]
    normals = surface.point_data["Normals"] if "Normals" in surface.point_data else None
    names = [name for name in COLOR_ARRAYS if name in surface.point_data]
    return surface.points, faces, normals, surface.point_data[names[0]] if names else None
