"""A mesh whose floor mirrors in the splats: closed where eyes see a reflection, without the images below.

The mesh of a mirror world is torn, and there is a hole above it: light and shadow rays would pass there, and added
objects would fall through. So light is traced on a mesh that is level there. Gaussians of the mirror world need no mesh
of it: `mirrored_places` lights them by what the floor mirrors.
"""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces, Floats, Mask, Points
from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import FREE, RayCaster
from splat2mesh.scene.chunks import split
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.cleaning import sound
from splat2mesh.splats.splats import Splats
from splat2mesh.surface.album import Album, RenderedPicture, filled_in

from ..albedo.seen import standing
from ..transfer.store import Cache, array_key
from .binding import PIXELS
from .floor_mirror import FloorMirror, placed
from .mirrored_places import seen_at
from .mirrored_room import views_down

COARSE = 3
"""Cells along a side of a block that is closed as one. A cell is as wide as the margin of the floor, .05 sizes of the
place."""

UNDER = 0.02
"""How far below the floor that is there the rim of what closes it lies, in margins: it must not hide it."""

LEVEL_ENOUGH = 0.5
"""Least cosine with the vertical of what counts as floor that is there."""


class _Patch(NamedTuple):
    """vertices (V, 3) float32 and faces (F, 3) int32 that close a floor, frame of the scene; colors: (V, 3) uint8."""

    vertices: NDArray[np.float32]
    faces: Faces
    colors: NDArray[np.uint8]


def closed_floor(scene: Scene, mirror: FloorMirror, splats: Splats, cache: Cache | None = None) -> Scene:
    """The Scene without the mirror world below its floor, and with a level grid in the gaps of that: further chunks, in
    the mean colour that eyes see there. Standpoints in the mirror world are left out.

    splats: of the scene, every row of the source. cache: of the scene. A layout of several splats stays as it is.
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
    key = array_key(mirror.rows, mirror.normal, np.array([mirror.offset, mirror.margin]), splats.means, splats.sh[:, 0])
    patch = None if cache is None else cache.restored(_restored, "closed_floor", key)
    if patch is None:
        patch = _patch(scene, mirror, splats, RayCaster(scene.vertices, standing_faces), eyes)
        if cache is not None:
            cache.put("closed_floor", key, **patch._asdict())
    return _mended(scene, kept, patch, mirror, eyes)


def _mended(scene: Scene, kept: list[Mask], patch: _Patch, mirror: FloorMirror, eyes: Points) -> Scene:
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
        normals = np.tile(mirror.normal.astype(np.float32), (len(patch.vertices), 1))
        parts = split(Mesh(patch.vertices, normals, patch.faces, patch.colors))
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


def _patch(scene: Scene, mirror: FloorMirror, splats: Splats, there: RayCaster, eyes: Points) -> _Patch:
    """What closes the floor of the rest of the mesh. eyes: above it."""
    normal, offset, margin = mirror.normal, mirror.offset, mirror.margin
    first = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    first /= np.linalg.norm(first)
    steps = margin * np.stack([first, np.cross(normal, first)])
    cells = _seen_cells(placed(splats, scene)[mirror.rows], mirror, there, eyes, steps)
    if not len(cells):
        return _Patch(np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int32), np.zeros((0, 3), np.uint8))
    corners = (cells[:, None] + [[0, 0], [1, 0], [1, 1], [0, 1]]).reshape(-1, 2)
    corners, number = np.unique(corners, axis=0, return_inverse=True)
    number = number.reshape(-1, 4)
    points = corners @ steps + offset * normal
    down = np.hstack([points + margin * normal, np.broadcast_to(-normal, points.shape)]).astype(np.float32)
    hits = there.first_hits(down)
    floor = (hits.distance < 2.0 * margin) & (hits.normals @ normal > LEVEL_ENOUGH)
    rise = (1.0 - UNDER) * margin - hits.distance[floor].astype(np.float64)
    points[floor] += np.minimum(rise, -UNDER * margin)[:, None] * normal
    below = there.occluded(_upwards(points, mirror))  # what is beyond the walls is not
    wanted = ~floor[number].all(axis=1) & below[number].any(axis=1)
    used, number = np.unique(number[wanted], return_inverse=True)
    a, b, c, d = number.reshape(-1, 4).T.astype(np.int32)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    vertices = points[used].astype(np.float32)
    return _Patch(vertices, faces, _colors(vertices, scene, splats, mirror, there, eyes))


def _seen_cells(
    images: NDArray[np.float64], mirror: FloorMirror, there: RayCaster, eyes: Points, steps: NDArray[np.float64]
) -> NDArray[np.int64]:
    """Cells (G, 2) of the plane where eyes (E, 3) see images (M, 3), and those about them. Cell i is the square from
    i @ steps + offset normal on. Outdoors, where nothing is above, an eye sees what is below a window's sill."""
    depth = mirror.offset - images @ mirror.normal
    blocks = np.zeros((0, 2), np.int64)
    for eye in eyes:
        seen = seen_at(images, depth, eye[None], mirror.normal, mirror.offset)
        ways = np.hstack([np.broadcast_to(eye, seen.shape), seen - eye]).astype(np.float32)
        seen = seen[~there.occluded(ways, FREE)]
        seen = seen[there.occluded(_upwards(seen, mirror))]
        found = np.floor(seen @ np.linalg.pinv(COARSE * steps)).astype(np.int64)
        blocks = np.unique(np.concatenate([blocks, found]), axis=0)
    around = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 1, 2)
    blocks = np.unique((blocks + around).reshape(-1, 2), axis=0)
    within = np.stack(np.meshgrid(*(np.arange(COARSE),) * 2), axis=-1).reshape(-1, 1, 2)
    return (COARSE * blocks + within).reshape(-1, 2)


def _upwards(points: Points, mirror: FloorMirror) -> NDArray[np.float32]:
    """Rays (N, 6) from above the floor that is there."""
    starts = points + mirror.margin * mirror.normal
    return np.hstack([starts, np.broadcast_to(mirror.normal, starts.shape)]).astype(np.float32)


def _colors(
    points: NDArray[np.float32],
    scene: Scene,
    splats: Splats,
    mirror: FloorMirror,
    there: RayCaster,
    eyes: Points,
) -> NDArray[np.uint8]:
    """Colours (V, 3) sRGB of points on the plane, as eyes (E, 3) see it in pictures of all splats."""
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    back = np.linalg.inv(matrix)
    scale = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3]))))
    pictures = []
    for eye, view in views_down(eyes, matrix, PIXELS):
        rays = view.ray_directions().reshape(-1, 3)
        turned = rays @ matrix[:3, :3].T
        down = -(turned @ mirror.normal)
        far = np.where(down > 0.0, eye @ mirror.normal - mirror.offset, np.nan) / np.where(down > 0.0, down, 1.0)
        asked = np.flatnonzero(np.isfinite(far))
        starts = np.broadcast_to(eye, (len(asked), 3))
        ways = np.hstack([starts, turned[asked] * (far[asked, None] - mirror.margin)]).astype(np.float32)
        far[asked[there.occluded(ways, 1.0)]] = np.nan
        depth = (far * (rays @ view.forward)).reshape(PIXELS, PIXELS).astype(np.float32)
        near = mirror.margin / scale
        color = np.clip(rasterize(splats, view, near).color, 0.0, 1.0)
        pictures.append(RenderedPicture.from_render(view, color, depth, np.full_like(depth, np.nan)))
    seen = (points @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
    normals = np.tile((matrix[:3, :3].T @ mirror.normal / scale).astype(np.float32), (len(points), 1))
    album = Album.of_object(pictures, float(np.linalg.norm(np.ptp(seen, axis=0))) / 2)
    return filled_in(album.look_up(seen, normals)[0], seen)[0]


def _restored(arrays: Mapping[str, NDArray[Any]]) -> _Patch:
    """What was kept. Raises InputError, KeyError or ValueError for what is none."""
    vertices, faces, colors = (arrays[name] for name in _Patch._fields)
    count = len(vertices)
    if (vertices.dtype, faces.dtype, colors.dtype) != (np.float32, np.int32, np.uint8):
        raise InputError("kept floor has other kinds of numbers")
    if vertices.shape != (count, 3) or colors.shape != (count, 3) or faces.shape != (len(faces), 3):
        raise InputError("kept floor has other shapes")
    if not np.isfinite(vertices).all() or faces.min(initial=0) < 0 or faces.max(initial=-1) >= count:
        raise InputError("kept floor is broken")
    return _Patch(vertices, faces, colors)
