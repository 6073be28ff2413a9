"""Whatever holds a scene: a Scene, a path, or a mesh of this package, of trimesh or of open3d, by its attributes."""

import os
import warnings
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from .mesh import Mesh
from .meshfile import checked_mesh
from .scene import Scene
from .surfaces import FAR, UncheckedMesh, centred, frame_from_own, too_far

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
        return _scene(source.vertices, source.faces, source.normals, source.colors_srgb, source)
    faces = getattr(source, "faces", getattr(source, "triangles", None))
    if faces is None or not hasattr(source, "vertices"):
        kind = f"{type(source).__module__}.{type(source).__qualname__}"
        raise InputError(f"expected a Scene, a path, or a mesh with vertices and faces, found {kind}")
    visual = source if hasattr(source, "vertex_colors") else getattr(source, "visual", None)
    return _scene(
        source.vertices, faces, getattr(source, "vertex_normals", None), getattr(visual, "vertex_colors", None)
    )


def _scene(vertices: Any, faces: Any, normals: Any, colors: Any, mesh: Mesh | None = None) -> Scene:
    """The Scene of (V, 3) vertices, (F, 3) faces, (V, 3) normals or None, (V, 3 or 4) colours, bytes or 0..1, or None;
    at the origin where float32 would lose it. mesh: that they are of, which stays as it is where nothing is moved, and
    is refused where it is lit. Raises InputError for arrays of another shape and for what `checked_mesh` refuses."""
    vertices, faces = np.asarray(vertices), np.asarray(faces)
    shaped = vertices.ndim == faces.ndim == 2 and vertices.shape[1] == faces.shape[1] == 3 and len(faces)
    points, moved = centred(vertices.astype(np.float64)) if shaped else (vertices, None)
    if mesh is not None and moved is None:
        return Scene([mesh])
    if not shaped:
        raise InputError(f"expected a triangle mesh, found vertices {vertices.shape} and faces {faces.shape}")
    normals = normals if np.shape(normals) == vertices.shape else None
    found = checked_mesh(UncheckedMesh(points, faces, normals, _colors(colors, len(vertices))), "a mesh")
    if moved is not None:
        warnings.warn(f"a mesh: {too_far(moved)}{_lost(vertices, points, found.faces)}", DataWarning, stacklevel=4)
    return Scene([found], scene_from_splat=frame_from_own(moved))


def _lost(vertices: NDArray[Any], points: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    """What a warning says of vertices (V, 3) that came too coarse for their edges; points: the same at the origin."""
    rounding = float(np.spacing(np.abs(vertices if vertices.dtype.kind == "f" else points).max()))
    edge = float(np.median(np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)))
    if rounding <= FAR * edge:
        return ""
    part = f", {rounding / edge:.1%} of its median edge" if edge > 0.0 else ""
    return f". It came rounded to {rounding:.3g}{part}: make it of float64, or near the origin"


def _colors(colors: Any, count: int) -> NDArray[Any] | None:
    """(V, 3) sRGB in 0..1 of colours as libraries keep them; None where there is not one for each vertex."""
    colors = None if colors is None else np.asarray(colors)
    if colors is None or colors.ndim != 2 or len(colors) != count or colors.shape[1] not in (3, 4):
        return None
    return colors[:, :3] / (1.0 if colors.dtype.kind == "f" else 255.0)
