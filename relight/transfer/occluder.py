"""All occluders of light as one set of triangles, and the origins of their rays."""

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Indices, Integers, Mask, Points, Rays
from splat2mesh.base.errors import InputError
from splat2mesh.base.kernels import kernel
from splat2mesh.base.threads import read_only
from splat2mesh.render.raycaster import Hits, RayCaster

from ..sh.normals import unit_normals
from .borders import inward_of_borders
from .checks import check_faces, check_mesh
from .neighbors import ranked_nodes

BATCH_RAYS = 2**20
"""Rays in memory at once: 24 MiB."""

MAX_OFFSET = 1e-4
"""Ray origins stand off the surface by at most this part of the scene's diagonal. Folds and sheets closer than that
cast no shadow on each other: with 1e-5 fine meshes change by up to 2%, in dents that are noise of their making."""

EDGE_OFFSET = 0.05
"""... and by at most this part of the vertex's shortest edge: fine detail in a wide scene keeps contact."""

MIN_OFFSET = 16 * float(np.finfo(np.float32).eps)
"""... but by at least this, 1.9e-6: Embree's intersections are good to a few roundings of the unit frame."""

INPUT_ROUNDINGS = 2.0
"""... and by this many roundings of the coordinates as they came, which far from the origin are coarse. Neighbours may
be off by half of one along each axis, against each other: sqrt 3 together. So no dent of rounding casts a shadow."""

MIN_OPENNESS = 0.1
"""Least cosine between a normal and the common direction of all normals at its place for that to be used."""


class Frame(NamedTuple):
    """The unit frame of a scene: what has faces is centred, its diagonal 1.

    center: (3,) float64. diagonal: float. rounding: of the coordinates as they came, in this frame.
    """

    center: NDArray[np.float64]
    diagonal: float
    rounding: float

    @classmethod
    def around(cls, vertices: Points, faces: Integers) -> "Frame":
        """That of a mesh; a lost point far off must cost no digits. Raises InputError for one without extent."""
        used = np.zeros(len(vertices), bool)
        used[faces] = True
        seen = vertices if used.all() else vertices[used]
        low, high = seen.min(axis=0).astype(np.float64), seen.max(axis=0).astype(np.float64)
        diagonal = float(np.linalg.norm(high - low))
        if not 0.0 < diagonal < np.inf:
            raise InputError(f"the scene spans {diagonal} units; expected vertices that differ and fit in float32")
        return cls((low + high) / 2.0, diagonal, float(np.spacing(np.float32(np.abs([low, high]).max()))) / diagonal)

    def unit(self, vertices: Points) -> NDArray[np.float32]:
        """Scene frame to unit frame, (V, 3) float32."""
        return ((vertices - self.center) / self.diagonal).astype(np.float32)


class Occluder:
    """Everything that can hide light, ready for ray tracing, with the ray origins of its own vertices.

    origins: (V, 3) float32, in the occluder's unit frame (Frame), whatever the scene's size.
    normals: (V, 3) float32, unit, as `unit_normals` repairs them.
    faces: (F, 3) uint32.
    frame: that unit frame.
    """

    def __init__(
        self,
        vertices: ArrayLike,  # (V, 3) scene frame
        normals: ArrayLike,  # (V, 3) scene frame
        faces: ArrayLike,  # (F, 3) integers, opaque from both sides
        first: "Occluder | None" = None,  # of the same vertices in another pose, whose frame and ranks are kept
    ) -> None:
        """Build the Embree scene. Raises InputError for arrays that do not make a mesh with an extent."""
        vertices, faces = np.asarray(vertices), np.asarray(faces)
        check_mesh(vertices, normals)
        check_faces(faces, len(vertices))
        self.frame: Frame = Frame.around(vertices, faces) if first is None else first.frame
        centered = self.frame.unit(vertices)
        self.normals = unit_normals(normals)
        self.origins = _origins(centered, self.normals, faces, INPUT_ROUNDINGS * self.frame.rounding)
        self.faces = np.ascontiguousarray(faces, np.uint32)
        self._caster = RayCaster(centered, self.faces)
        self._hidden: RayCaster | None = None
        if first is not None:
            self.ranked, self._hidden = first.ranked, first._hidden

    @cached_property
    def ranked(self) -> tuple[NDArray[np.int64], Mask, Mask]:
        """`ranked_nodes` of the origins; those of the first pose where there is one, so that each keeps its rays."""
        return ranked_nodes(self.origins, self.normals)

    def shut(self, triangles: NDArray[np.float32]) -> None:
        """Let no ray leave the scene through triangles (B, 3, 3), unit frame. Between surfaces they hide nothing."""
        if len(triangles):
            corners = triangles.reshape(-1, 3)
            self._hidden = RayCaster(corners, np.arange(len(corners)).reshape(-1, 3))

    @property
    def is_shut(self) -> bool:
        """Whether `shut` was called with any triangles."""
        return self._hidden is not None

    def occluded(self, rays: Rays, far: float = np.inf) -> Mask:
        """Whether anything hides the rays up to `far` lengths of their directions: (..., 6) float32 origin, direction,
        unit frame -> (...) bool."""
        hidden = self._caster.occluded(rays, far)
        if self._hidden is not None and far == np.inf:
            free = ~hidden
            hidden[free] = self._hidden.occluded(np.asarray(rays)[free])
        return hidden

    def first_hits(self, rays: Rays) -> Hits:
        """The first hits of rays (..., 6) float32, unit frame: Hits."""
        return self._caster.first_hits(rays)


def _origins(
    vertices: NDArray[np.float32], normals: NDArray[np.float32], faces: Integers, rounding: float
) -> NDArray[np.float32]:
    """Ray origins a little off the surface, (V, 3) float32, unit frame.

    Where faces meet at a hard edge, each with vertices of its own, a step along one face's normal can stay
    in its neighbour's plane, where rays slip through. So the step goes along the sum of the distinct normals
    at the position, away from all of them; and along the vertex's own normal where they oppose each other.
    At the border of a patch it goes inward by as little as counts: what the patch ends at may have no vertex there.
    Any other vertex that lies exactly in a face is taken to be behind it, that is dark.
    """
    group, distinct = places_of(np.ascontiguousarray(vertices), normals)
    return stood_off(vertices, normals, faces, (group, distinct), MIN_OFFSET, rounding)


def places_of(vertices: NDArray[np.float32], normals: NDArray[np.float32]) -> tuple[Indices, Indices]:
    """Which vertices share a position, (V,) from 0, and one vertex for each normal there, position after position."""
    order, new_node, new_place = ranked_nodes(vertices, normals)
    group = np.zeros(len(order), np.int64)
    group[order] = np.cumsum(new_place) - 1
    return group, order[new_node]


def stood_off(
    vertices: NDArray[np.float32],
    normals: NDArray[np.float32],
    faces: Integers,
    places: tuple[Indices, Indices],  # of `places_of`, in this pose or another
    least: float,  # offset that the coordinates need to be distinct
    rounding: float,  # of the coordinates as they came
) -> NDArray[np.float32]:
    """The ray origins of `_origins`, for known places."""
    (group, distinct), faces = places, read_only(faces, np.int32)
    starts = np.flatnonzero(np.diff(group[distinct], prepend=-1))
    common = np.add.reduceat(normals[distinct], starts, axis=0) if len(starts) else np.zeros((0, 3), np.float32)
    common /= np.maximum(np.linalg.norm(common, axis=1, keepdims=True), 1e-12)
    step = np.where((common[group] * normals).sum(axis=1, keepdims=True) > MIN_OPENNESS, common[group], normals)
    shortest = np.full(len(common), np.inf)
    _shorten(vertices, faces, group, shortest)
    offset = np.maximum(np.clip(EDGE_OFFSET * shortest, least, MAX_OFFSET), rounding)[group]
    inward = inward_of_borders(vertices, normals, faces, group, distinct)
    return (vertices + offset[:, None] * step + max(least, rounding) * inward).astype(np.float32)


@kernel
def _shorten(
    vertices: NDArray[np.float32], faces: Integers, group: NDArray[np.int64], shortest: NDArray[np.float32]
) -> None:
    """The length of the shortest edge at every place, edges of no length left out."""
    for f in range(len(faces)):
        for corner in range(3):
            a, b = faces[f, corner], faces[f, corner - 1]
            square = np.float32(0)
            for axis in range(3):
                side = vertices[a, axis] - vertices[b, axis]
                square += side * side
            length = np.sqrt(square)
            if length > 0.0:
                shortest[group[a]] = min(shortest[group[a]], length)
                shortest[group[b]] = min(shortest[group[b]], length)
