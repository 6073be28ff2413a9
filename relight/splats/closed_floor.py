"""A mesh whose floor mirrors in the splats: closed where eyes see a reflection, without the images below.

The mesh of a mirror world is torn, and there is a hole above it: light and shadow rays would pass there, and added
objects would fall through. So light is traced on a mesh that is level there. Gaussians of the mirror world need no mesh
of it: `mirrored_places` lights them by what the floor mirrors.
"""

from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Floats, Mask, Points
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.chunks import split
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import Splats

from ..albedo.seen import standing
from .floor_mirror import FloorMirror, placed
from .mirrored_places import seen_at

LEVEL_ENOUGH = 0.5
"""Least cosine with the vertical of what counts as floor that is there."""


def closed_floor(scene: Scene, mirror: FloorMirror, splats: Splats) -> Scene:
    """The Scene without the mirror world below its floor, and with a level grid in the gaps of that: further chunks, in
    the mean colour that eyes see there. Standpoints in the mirror world are left out.

    splats: of the scene, every row of the source. A layout of several splats stays as it is.
    """
    if len(scene.source.get("objects") or ()) > 1:
        return scene
    image = _images(scene, mirror, splats)
    kept: list[Mask] = [np.asarray(~image[faces].any(axis=1)) for faces in _by_chunk(scene)]
    standing_faces = scene.faces[np.concatenate(kept)]
    if not len(standing_faces):
        return scene
    eyes = standing(scene)
    eyes = eyes[eyes @ mirror.normal > mirror.offset]
    images = placed(splats, scene)[mirror.rows]
    return _mended(scene, kept, _patch(images, mirror, RayCaster(scene.vertices, standing_faces), eyes), eyes)


def _mended(scene: Scene, kept: list[Mask], patch: Mesh, eyes: Points) -> Scene:
    """The Scene with the kept faces of its chunks alone, and a patch."""
    chunks: list[Mesh] = []
    hull: list[int] = []
    shares: list[Floats] = []
    volume = None if scene.measured is None else scene.measured.vertex_volume
    starts = np.cumsum([0, *(len(chunk.vertices) for chunk in scene.chunks)])
    for number, (chunk, rows) in enumerate(zip(scene.chunks, kept, strict=True)):
        if rows.any():
            hull += [len(chunks)] if number in scene.hull else []
            used, corners = np.unique(chunk.faces[rows], return_inverse=True)
            faces = corners.reshape(-1, 3).astype(np.int32)
            chunks.append(Mesh(chunk.vertices[used], chunk.normals[used], faces, chunk.colors_srgb[used]))
            shares += [] if volume is None else [volume[starts[number] + used]]
    if len(patch.faces):
        parts = split(patch)
        shares += [np.zeros(len(part.vertices), np.float32) for part in parts]
        chunks += parts
    measured = scene.measured
    if measured is not None:
        measured = measured._replace(vertex_volume=np.concatenate(shares).astype(np.float32))
    capture = {**scene.capture, "eyes": eyes.tolist()}
    left = tuple(np.flatnonzero(rows) for number, rows in enumerate(kept) if number not in scene.hull)
    return replace(scene, chunks=chunks, hull=tuple(hull), measured=measured, capture=capture, left=left)


def _by_chunk(scene: Scene) -> list[Faces]:
    """The faces of each chunk, into the vertices of the Scene."""
    ends = np.cumsum([len(chunk.faces) for chunk in scene.chunks])[:-1]
    return np.split(scene.faces, ends)


def _images(scene: Scene, mirror: FloorMirror, splats: Splats) -> Mask:
    """(V,) bool: the vertices below a floor whose nearest splat there is a reflection."""
    points = placed(splats, scene)
    low = sound(splats)
    low[low] = points[low] @ mirror.normal < mirror.offset - mirror.margin
    found = scene.vertices @ mirror.normal < mirror.offset - mirror.margin
    rows, below = np.flatnonzero(found), np.flatnonzero(low)
    if len(rows) and len(below):
        nearest = below[scipy.spatial.cKDTree(points[below]).query(scene.vertices[rows])[1]]
        found[rows] = np.isin(nearest, mirror.rows)
    return np.asarray(found & bool(len(below)))


def _patch(images: NDArray[np.float64], mirror: FloorMirror, there: RayCaster, eyes: NDArray[np.float64]) -> Mesh:
    """What closes the floor of the rest of the mesh, in squares of the margin's size: where eyes (E, 3), above it, see
    images (M, 3), no floor is there, and something is above. What is beyond the walls stays open."""
    normal, offset, margin = mirror.normal, mirror.offset, mirror.margin
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    steps = margin * np.stack([first, np.cross(normal, first)])
    seen = seen_at(images, offset - images @ normal, eyes, normal, offset)
    low, high = (np.array([end(axis) for axis in (seen @ np.linalg.pinv(steps)).T]) for end in (np.min, np.max))
    counts = [np.arange(np.floor(a), np.ceil(b) + 1.0) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*counts, indexing="ij"), axis=-1)
    each = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    number = np.stack([each[:-1, :-1], each[1:, :-1], each[1:, 1:], each[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = grid.reshape(-1, 2) @ steps + offset * normal
    hits = there.first_hits(_rays(points + margin * normal, -normal))
    floor = (hits.distance < 2.0 * margin) & (hits.normals @ normal > LEVEL_ENOUGH)
    height = margin - hits.distance[floor].astype(np.float64)
    points[floor] += (np.minimum(height, 0.0) - 0.5 * margin)[:, None] * normal  # it must not hide the floor around
    below = there.occluded(_rays(points + margin * normal, normal))
    number = number[~floor[number].all(axis=1) & below[number].any(axis=1)]
    used, corners = np.unique(number, return_inverse=True)
    a, b, c, d = corners.reshape(-1, 4).T.astype(np.int32)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    color = bytes_from_unit(srgb_from_linear(np.clip(mirror.color, 0.0, 1.0)))
    normals, colors = np.tile(normal.astype(np.float32), (len(used), 1)), np.tile(color, (len(used), 1))
    return Mesh(points[used].astype(np.float32), normals, faces, colors)


def _rays(starts: Points, way: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.hstack([starts, np.broadcast_to(way, starts.shape)]).astype(np.float32)
