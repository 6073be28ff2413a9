"""The surface of a place as its standpoints see it: depth maps, adaptive fusion, and a mesh with the size field of the
capture, fine where cameras came near.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..base.arrays import Faces, Floats, Indices, Points, Vector
from ..base.choices import DEFAULT_VERTICES
from ..base.errors import InputError
from ..base.progress import Stages
from ..render.view import View
from ..scene.mesh import Mesh, vertex_normals
from ..splats.splats import Splats
from ..views.overhead import MOST_LEAK, Overhead
from .adaptive import SLABS, fuse_adaptively
from .album import Album, filled_in
from .behind_fog import behind_fog
from .clean import fill_holes, without_floaters
from .decimate import decimate
from .extract import FINEST_CELL, LEAST_POINTS, PROBE_PIXELS, PROBES, Look, dilated, training_pixel
from .fair import fair
from .patches import SeenPatches
from .planes import PATCH, evened
from .refine import refine_by_color
from .sight import FusionSight, Sighting
from .simplify import simplify

LEVEL, DILATION = 0.6, 0.35
"""Opacity at which the surfaces of a place lie, and share of the training pixel by which its splats are dilated:
cameras among its surfaces see them frontally, where the dilation on screen moves nothing. Chosen on a trained garden
with a true mesh; a level of .45 in fog was worse in an office, on which nothing was chosen."""

SPARE, MOST_VERTICES, SHAPE = 2.5, 400_000, 0.75
"""Where the number of vertices is left to the capture: vertices found for one that is kept, vertices at most, and the
part of the most that the shape may take, before colours ask for theirs."""

LEAST_BAND = 2.0
"""Most distance between a plane and what lies on it, in training pixels, where there is no fog. The most
thickness that vertices are moved by, too, chosen on a foggy office: with more they leave what is seen there."""

HOLE_CELLS = 40.0
"""Border of the largest hole that is closed, in cells of its surroundings."""


def place_look(splats: Splats, views: Sequence[View], near: Floats) -> Look:
    """A Look at the splats of a place, as the file has them, from views with near planes (M,)."""
    pixel = training_pixel(splats)
    return Look(dilated(splats, DILATION * pixel), pixel, views, near)


def reconstruct_place(
    look: Look, vertices: int | None, stages: Stages, overhead: Overhead | None = None
) -> tuple[Mesh, Look, dict[str, Any]]:
    """The mesh of a place in the splats' frame, as a Look of `place_look` sees it: a Mesh, what was looked at for it,
    and counts.

    vertices: wanted, or None for as many as the capture asks for. overhead: of a room whose views may have missed its
    ceiling: where that is open, views that look up join them. Raises InputError when hardly any surface is found.
    """
    splats, pixel, views, near = look
    fog = _fog(splats, views, near)
    shots = _shots(splats, views, near, stages)
    depths = np.concatenate([shot.seen.depth[np.isfinite(shot.seen.depth)] for shot in shots])
    if len(depths) < LEAST_POINTS:
        raise InputError(f"only {len(depths)} surface points were found: is this a splat of a place?")
    distance, centers = float(np.median(depths)), _near_centers(shots)
    middle = np.median(centers, axis=0)

    def developed(shots: Sequence[Sighting]) -> tuple[list[FusionSight], Album]:
        return [FusionSight.of(shot, distance, FINEST_CELL * pixel, fog) for shot in shots], Album.of(shots)

    sights, album = developed(shots)
    band = max(fog * distance, LEAST_BAND * pixel)
    patches = SeenPatches.seen(shots, distance, PATCH * band)
    del shots
    points, faces, cells = _fused(sights, middle, stages)
    if overhead is not None and overhead.leak(points, faces) > MOST_LEAK:
        more, planes = overhead.views(max(views[0].width, views[0].height))
        added, pictures = developed(_shots(splats, more, planes, stages))
        views, near = [*views, *more], np.append(near, planes)
        album = Album.joined([album, pictures])
        points, faces, cells = _fused(sights + added, middle, stages)
        del added, pictures
    del sights
    if len(faces) == 0:
        raise InputError("no surface is left after fusion: is this a splat of a place?")
    with stages.stage("clean"):
        faces, dropped = without_floaters(faces, np.zeros(len(points), bool))
        used, corners = np.unique(faces, return_inverse=True)
        points, faces, cells = points[used], corners.reshape(-1, 3).astype(np.int32), cells[used]
    found = len(points)
    wanted = int(np.clip(found / SPARE, DEFAULT_VERTICES, MOST_VERTICES * SHAPE)) if vertices is None else vertices
    with stages.stage("decimate"):
        longest = HOLE_CELLS * float(np.median(cells))
        points, faces, *_ = simplify(points, faces, cells, wanted)
        points, faces = decimate(points, faces, len(points))  # only cleans: there is nothing left to remove
    with stages.stage("fair"):
        points, faces, filled = fill_holes(points, faces, longest)
        _, thickness, seen_by = album.look_up(points, vertex_normals(points, faces))
        local = np.where(np.isfinite(seen_by), np.maximum(seen_by, pixel), pixel)
        placed = fair(points, faces, thickness / local, float(np.median(local))).astype(np.float32)
    with stages.stage("color"):
        if vertices is None:
            placed, faces = refine_by_color(placed, faces, album, MOST_VERTICES)
        normals = vertex_normals(placed, faces)
        shown, thickness, _ = album.look_up(placed, normals)
        colors, unseen = filled_in(shown, placed)
    with stages.stage("planes"):
        on = evened(placed, normals, faces, thickness, patches)
        placed = behind_fog(placed, on.normals, faces, thickness, LEAST_BAND * pixel, band)
    counts: dict[str, float] = {"components_dropped": dropped, "holes_filled": filled, "vertices_unseen": unseen}
    counts |= {"fog": round(fog, 4), "vertices_found": found, "planes": len(on.planes), "on_planes": round(on.area, 3)}
    return Mesh(placed, on.normals, faces, colors), Look(splats, pixel, list(views), near), counts


def _shots(splats: Splats, views: Sequence[View], near: Floats, stages: Stages) -> list[Sighting]:
    """What views show of splats."""
    shots = []
    with stages.stage("depth maps", total=len(views)) as advance:
        for view, plane in zip(views, near, strict=True):
            shots.append(Sighting.taken(splats, view, plane, LEVEL))
            advance()
    return shots


def _fused(sights: Sequence[FusionSight], middle: Vector, stages: Stages) -> tuple[Points, Faces, Floats]:
    with stages.stage("fusion", total=SLABS) as advance:
        points, faces, cells = fuse_adaptively(sights, middle, advance)
    return points, faces, cells


def _near_centers(shots: Sequence[Sighting]) -> Points:
    """Where the half of the views that is nearest to what it sees stands, (E, 3): not the views from around."""
    found = [shot.seen.depth[np.isfinite(shot.seen.depth)] for shot in shots]
    depths = np.array([np.median(depth) if len(depth) else np.inf for depth in found])
    return np.array([shot.view.center for shot in shots])[depths <= np.median(depths)]


def _fog(splats: Splats, views: Sequence[View], near: Floats) -> float:
    """Median thickness of the surfaces that views see, over their distance."""
    found: list[Floats] = [np.zeros(0)]
    for probe in _probes(views):
        shot = Sighting.taken(splats, views[probe].resized(PROBE_PIXELS), near[probe])
        found.append((shot.thickness / shot.seen.depth).ravel())
    ratios = np.concatenate(found)
    ratios = ratios[np.isfinite(ratios)]
    return float(np.median(ratios)) if len(ratios) else 0.0


def _probes(views: Sequence[View]) -> Indices:
    """Indices of the views in which the fog is measured. Where views from around follow the eyes' six each, they are
    spread evenly: in a fixed step they would all look the same few ways, as many of them up as there happens."""
    step = max(1, len(views) // PROBES)
    evenly = np.arange(0, len(views), step)
    mixed = len({round(view.fx / view.width, 6) for view in views}) > 1
    return np.arange(PROBES) * len(views) // PROBES if mixed and step > 1 else evenly


def parted(mesh: Mesh, center: Vector, radius: float) -> tuple[Mesh, Mesh | None]:
    """A Mesh as two: what reaches into the ball around `center`, and the rest of it, the far background, or None."""
    outside = (np.linalg.norm(mesh.vertices - center, axis=1) > radius)[mesh.faces].all(axis=1)
    if not outside.any() or outside.all():
        return mesh, None
    return mesh.of_faces(~outside), mesh.of_faces(outside)
