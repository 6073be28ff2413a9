"""The mesh of an object: extracted from views of it, cleaned, decimated, faired, closed and coloured."""

import warnings
from collections import Counter
from collections.abc import Sequence

import numpy as np

from ..base.arrays import Points
from ..base.errors import DataWarning, InputError
from ..base.progress import Stages
from ..scene.mesh import Mesh, vertex_normals
from ..views.viewpoints import bounds_of
from .album import Album, filled_in
from .clean import drop_small_components, fill_holes, trim_borders
from .decimate import decimate
from .extract import Effort, Look, extract
from .fair import fair
from .openings import openings
from .refine import refine_by_color

BACKGROUND_SHARE = 0.15
"""Share of the vertices for a kept background, which is far from every viewer."""

LONGEST_HOLE = 0.5
"""Border of the largest hole that is closed, in units of the scene's diagonal."""


def reconstruct_object(
    looks: Sequence[Look], surface: str, effort: Effort, vertices: int, most: int, stages: Stages
) -> tuple[Mesh, dict[str, int]]:
    """The Mesh of an object, looks[0], and of its far background where that is looked at too; and counts of both.

    surface: one of SURFACE_CHOICES. vertices: wanted size. most: vertices up to which colours may ask for more, 0 for
    none. Raises InputError for an object without a surface.
    """
    shares = [vertices]
    if len(looks) > 1:
        shares = [round((1.0 - BACKGROUND_SHARE) * vertices), round(BACKGROUND_SHARE * vertices)]
    meshes, counts = [], Counter[str]()
    for look, share in zip(looks, shares, strict=True):
        try:
            mesh, found = _reconstruct(look, surface, effort, share, most, stages)
        except InputError:
            if look is looks[0]:
                raise
            warnings.warn("the far background shows no surface and was left out", DataWarning, stacklevel=3)
            continue
        meshes.append(mesh)
        counts.update(found)
    return _joined(meshes), dict(counts)


def _reconstruct(
    look: Look, surface: str, effort: Effort, vertices: int, most: int, stages: Stages
) -> tuple[Mesh, dict[str, int]]:
    """The Mesh of what a Look shows, in the splats' frame, and counts."""
    splats, pixel, *_ = look
    raw, pictures = extract(surface, look, effort, vertices, stages)
    with stages.stage("clean"):
        dropped = drop_small_components(raw)
    with stages.stage("decimate"):
        points: Points
        points, faces = decimate(np.asarray(raw.vertices), np.asarray(raw.triangles), vertices)
    with stages.stage("fair"):
        radius = float(np.linalg.norm(np.ptp(points, axis=0))) / 2 if len(points) else 0.0
        album = Album.of_object(pictures, radius)
        _, thickness, _ = album.look_up(points, vertex_normals(points, faces))
        used, renumbered = np.unique(trim_borders(faces, np.isfinite(thickness)), return_inverse=True)
        points, faces = points[used], renumbered.reshape(-1, 3).astype(np.int32)
        longest = LONGEST_HOLE * float(np.linalg.norm(np.ptp(bounds_of(splats), axis=0)))
        points, faces, filled = fill_holes(
            points, faces, longest, are_open=lambda borders: openings(borders, pictures, radius)
        )
        thickness = np.append(thickness[used], np.full(filled, np.inf))
        if len(faces):
            points = fair(points, faces, thickness / pixel, pixel)
        points, normals = points.astype(np.float32), vertex_normals(points, faces)
    with stages.stage("color"):
        if most and len(faces):
            points, faces = refine_by_color(points, faces, album, most)
            normals = vertex_normals(points, faces)
        colors, unseen = filled_in(album.look_up(points, normals)[0], points)
    counts = {"components_dropped": dropped, "holes_filled": filled, "vertices_unseen": unseen}
    return Mesh(points, normals, faces, colors), counts


def _joined(meshes: Sequence[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes[:-1])])
    return Mesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=True)]).astype(np.int32),
        np.concatenate([mesh.colors_srgb for mesh in meshes]),
    )
