"""A texture of a scene: the texture coordinates of each vertex, and the surface point of every texel.

The mesh is welded and sorted by the bits of its vertices before it is unwrapped, so the division into chunks
changes no texel.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Faces, Floats, Integers, Mask, Points
from ..base.choices import LARGEST_TEXTURE, SMALLEST_TEXTURE
from ..base.errors import InputError
from ..base.kernels import kernel
from ..base.threads import in_slices, read_only, shared
from .fill import filled

if TYPE_CHECKING:
    from ..scene.scene import Scene

REACH = 2.0
"""Texels beside a chart that are baked at its nearest point: bilinear filtering mixes them in."""


@dataclass(frozen=True)
class Atlas:
    """Texture coordinates of a scene of V vertices and F faces, and the surface of its texels.

    uv: (W, 2) float32 in [0, 1], u to the right, v down from the top row, as in glTF. vertex: (W,) int32, the scene
    vertex that each is a copy of. faces: (F, 3) int32 of these, in the scene's order. chunks: list of the ranges of W,
    one for each chunk. vertices: V. size: side of the texture in texels.
    texels: (T,) int64 ascending, row * size + column, of the texels that show the surface, gutters included. face: (T,)
    int32. weights: (T, 3) float32 of the face's corners. texel_size: width of one in the scene's unit, a mean.
    inside: (T,) bool, whether its centre lies in its face; the others are gutter.
    """

    uv: NDArray[np.float32]
    vertex: NDArray[np.int32]
    faces: Faces
    chunks: list[range]
    vertices: int
    size: int
    texels: NDArray[np.int64]
    face: NDArray[np.int32]
    weights: NDArray[np.float32]
    inside: Mask
    texel_size: float

    def interpolate(self, values: Floats, rows: slice = slice(None)) -> NDArray[np.float32]:
        """Values of scene vertices at the texels, or some of them: (V, C) -> (T, C) float32."""
        found = np.empty((len(self.face[rows]), values.shape[1]), np.float32)
        _mix(len(found), self._corners, self.face[rows], self.weights[rows], read_only(values), found)
        return found

    def image(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values of texels as an image: (T, C) -> (size, size, C); every other texel has what is around it."""
        return filled(self.size, self.texels, values)

    @cached_property
    def _corners(self) -> NDArray[np.int32]:
        return self.vertex[self.faces]


def atlas_of(scene: "Scene", mesh: "Welded", uv: Floats, faces: Integers, size: int, reach: float = REACH) -> Atlas:
    """The Atlas of a scene whose charts are known.

    mesh: Welded of the scene. uv: (W, 2) in texels from the top left corner. faces: (F, 3) of these, in the order of
    `mesh`. size: side of the texture. reach: texels beside a chart that show it too. Raises InputError where no texel
    shows anything.
    """
    order = mesh.order
    uv = uv.astype(np.float32)
    texels, face, weights, inside = _shown(uv, faces, size, reach)
    # Back from the welded mesh to the faces and vertices of the scene, chunk by chunk.
    in_scene = np.empty_like(faces)
    in_scene[order[0]] = np.take_along_axis(faces, order[2], axis=1)
    weights = np.take_along_axis(weights, order[2][face], axis=1)
    vertex, coordinates, final, first = [], [], [], 0
    chunks: list[range] = []
    scene_faces = scene.faces
    for chunk in scene.chunks:
        rows = slice(first, first + len(chunk.faces))
        first = rows.stop
        both = scene_faces[rows].astype(np.int64).ravel() << 32 | in_scene[rows].ravel()
        unique, index = np.unique(both, return_inverse=True)
        start = chunks[-1].stop if chunks else 0
        chunks.append(range(start, start + len(unique)))
        vertex.append(unique >> 32)
        coordinates.append(uv[unique & 0xFFFFFFFF])
        final.append(index.reshape(-1, 3) + start)
    return Atlas(
        np.clip(np.concatenate(coordinates) / np.float32(size), 0.0, 1.0),
        np.concatenate(vertex).astype(np.int32),
        np.concatenate(final).astype(np.int32),
        chunks,
        len(scene.vertices),
        size,
        texels,
        order[0][face].astype(np.int32),
        weights,
        inside,
        float(np.sqrt(surface_area(mesh) / max(int(inside.sum()), 1))),
    )


def atlas_again(
    scene: "Scene", uv: Sequence[Floats], faces: Sequence[Integers], size: int, reach: float = 1.5
) -> Atlas:
    """The Atlas of a scene whose chunks have been unwrapped before. uv: of each chunk (W, 2) in [0, 1], as of an Atlas.
    faces: of each (F, 3) of these, in the order of the scene. size: side of the texture. reach: as of `atlas_of`."""
    starts = np.cumsum([0, *map(len, uv)])
    joined = np.concatenate([each + start for each, start in zip(faces, starts[:-1], strict=True)]).astype(np.int32)
    coordinates = np.concatenate(uv).astype(np.float32)
    vertex = np.zeros(len(coordinates), np.int32)
    vertex[joined] = scene.faces
    texels, face, weights, inside = _shown(coordinates * np.float32(size), joined, size, reach)
    chunks = [range(first, last) for first, last in pairwise(starts.tolist())]
    area = float(face_areas(scene.vertices, scene.faces).sum())
    width = float(np.sqrt(area / max(int(inside.sum()), 1)))
    return Atlas(coordinates, vertex, joined, chunks, len(scene.vertices), size, texels, face, weights, inside, width)


def _shown(
    uv: NDArray[np.float32], faces: Integers, size: int, reach: float
) -> tuple[NDArray[np.int64], NDArray[np.int32], NDArray[np.float32], Mask]:
    """The texels that show something, ascending, the face of each, its weights there, and whether it lies inside."""
    best = np.full((size, size), np.inf, np.float32)
    face, weights = np.full((size, size), -1, np.int32), np.zeros((size, size, 3), np.float32)
    in_slices(_draw, size, uv, faces, np.float32(reach), best, face, weights)
    texels = np.flatnonzero(face.ravel() >= 0)
    if len(texels) == 0:
        raise InputError(f"a texture of {size} texels is too small for this scene: choose a larger `texture_size`")
    return texels, face.ravel()[texels], weights.reshape(-1, 3)[texels], best.ravel()[texels] == 0.0


def surface_area(mesh: "Welded") -> float:
    """The area of a Welded surface. Raises InputError for one that has none."""
    total = float(face_areas(mesh.nodes[:, :3], mesh.corners).sum())
    if not 0.0 < total < np.inf:
        raise InputError(f"a texture needs a surface: the faces of the scene have an area of {total}")
    return total


def check_size(size: int) -> int:
    """The side of a texture as an int. Raises InputError out of range."""
    if isinstance(size, bool) or int(size) != size or not SMALLEST_TEXTURE <= size <= LARGEST_TEXTURE:
        sides = f"{SMALLEST_TEXTURE} to {LARGEST_TEXTURE}"
        raise InputError(f"`texture_size` {size}: expected a whole number of texels from {sides}")
    return int(size)


class Welded(NamedTuple):
    """The vertices of a scene that differ, and its faces of these, in an order that no division into chunks changes.

    nodes: (M, 6) float32 of position and normal, ascending. corners: (F, 3). order: how these stand to the scene: the
    scene's face of each, the first corner of each there, and for each corner of the scene's face which corner of ours
    it is.
    """

    nodes: NDArray[np.float32]
    corners: NDArray[np.int64]
    order: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]


def welded(scene: "Scene") -> Welded:
    """The Welded mesh of a scene."""
    content = np.hstack([scene.vertices, scene.normals]).astype(np.float32) + np.float32(0.0)
    ranked = np.lexsort(content.T[::-1])
    sorted_rows = content[ranked]
    new = np.append(True, (sorted_rows[1:] != sorted_rows[:-1]).any(axis=1))[: len(content)]
    nodes, node = sorted_rows[new], np.empty(len(content), np.int64)
    node[ranked] = np.cumsum(new) - 1
    corners = node[scene.faces]
    turn = corners.argmin(axis=1)
    corners = np.take_along_axis(corners, (turn[:, None] + np.arange(3)) % 3, axis=1)
    order = np.lexsort(corners.T[::-1])
    turn = turn[order]
    return Welded(nodes, corners[order], (order, turn, (np.arange(3) - turn[:, None]) % 3))


def face_areas(points: Points, faces: Integers) -> NDArray[np.float64]:
    """Areas of faces (F, 3), (F,) float64, in the squared unit of the points (V, 3)."""
    a, b, c = (points[corner].astype(np.float64) for corner in faces.T)
    return np.asarray(np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2)


@shared
@kernel
def _mix(
    begin: int, end: int, corners: Integers, face: Integers, weights: Floats, values: Floats, found: Floats
) -> None:
    """Values (V, C) of the corners (F, 3) of the faces (T,), by their weights (T, 3): (T, C)."""
    for t in range(begin, end):
        a, b, c = corners[face[t]]
        for channel in range(values.shape[1]):
            two = weights[t, 0] * values[a, channel] + weights[t, 1] * values[b, channel]
            found[t, channel] = two + weights[t, 2] * values[c, channel]


@kernel
def _draw(
    begin: int,
    end: int,
    uv: NDArray[np.float32],
    faces: Integers,
    reach: float,
    best: NDArray[np.float32],
    face: NDArray[np.int32],
    weights: NDArray[np.float32],
) -> None:
    """Find for each texel of some rows the first face that holds its centre or else the nearest one within `reach`, its
    weights there, and the square of its distance."""
    size = best.shape[0]
    for f in range(len(faces)):
        ax, ay = np.float64(uv[faces[f, 0], 0]), np.float64(uv[faces[f, 0], 1])
        bx, by = np.float64(uv[faces[f, 1], 0]), np.float64(uv[faces[f, 1], 1])
        cx, cy = np.float64(uv[faces[f, 2], 0]), np.float64(uv[faces[f, 2], 1])
        top = max(int(np.ceil(min(ay, by, cy) - reach - 0.5)), begin)
        bottom = min(int(np.floor(max(ay, by, cy) + reach - 0.5)), end - 1)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if area == 0.0 or top > bottom:
            continue
        left = max(int(np.ceil(min(ax, bx, cx) - reach - 0.5)), 0)
        right = min(int(np.floor(max(ax, bx, cx) + reach - 0.5)), size - 1)
        for row in range(top, bottom + 1):
            y = row + 0.5
            for column in range(left, right + 1):
                if best[row, column] == 0.0:
                    continue
                x, distance = column + 0.5, np.inf
                second: float = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                third: float = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                first: float = 1.0 - second - third
                if first >= 0.0 and second >= 0.0 and third >= 0.0:
                    best[row, column], face[row, column] = 0.0, f
                    weights[row, column, 0], weights[row, column, 1] = first, second
                    weights[row, column, 2] = third
                    continue
                for side in range(3):
                    if side == 0:
                        px, py, qx, qy = ax, ay, bx, by
                    elif side == 1:
                        px, py, qx, qy = bx, by, cx, cy
                    else:
                        px, py, qx, qy = cx, cy, ax, ay
                    ex, ey = qx - px, qy - py
                    length = ex * ex + ey * ey
                    along = ((x - px) * ex + (y - py) * ey) / length if length > 0.0 else 0.0
                    along = min(max(along, 0.0), 1.0)
                    away = (x - px - along * ex) ** 2 + (y - py - along * ey) ** 2
                    if away < distance:
                        distance = away
                        first = 1.0 - along if side == 0 else (along if side == 2 else 0.0)
                        second = along if side == 0 else (1.0 - along if side == 1 else 0.0)
                        third = along if side == 1 else (1.0 - along if side == 2 else 0.0)
                # Rounding must not move a texel from the face it lies in to one beside it.
                distance = max(distance, 1e-12)
                if distance < best[row, column] and distance <= reach * reach:
                    best[row, column], face[row, column] = distance, f
                    weights[row, column, 0], weights[row, column, 1] = first, second
                    weights[row, column, 2] = third
