"""Transfer of a scene with moving bodies: only rays that the motion can have changed are traced again.

Visibility is kept as bits, one per ray and body: a ray is free if no body stops it. When a body moves, its own vertices
are traced again; every other vertex keeps its bits except for this body, and of these it needs only the rays that
now meet the body's box (`reach`). Transfer is summed and averaged again around changed vertices.
The result is, to the bit, that of a new DynamicTransfer of the moved scene with the same frame and ranks: rays
depend on the rank of their vertex, which stays, and not on history.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Faces, Indices, Integers, Mask, Points
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

from ..sh import harmonics
from ..sh.normals import unit_normals
from . import DEFAULT_BANDS, DEFAULT_RAYS, check_rays, sampling
from .bodies import STATIC, Body, Sight, placed
from .checks import check_shape
from .filtering import steps_for
from .neighbors import ranked_nodes
from .occluder import INPUT_ROUNDINGS, Frame
from .visibility import BATCH_RAYS, completed

Moving: TypeAlias = Sequence[int | Sequence[int]]
"""Numbers of chunks, or of those that move as one."""

Changes: TypeAlias = Mapping[int, tuple[Points, Directions]]
"""Chunk -> (vertices, normals), (V, 3) each, scene frame."""


class Anchor(NamedTuple):
    """The state that a transfer takes from another, so both trace the same rays.

    frame: that of the scene without. ranks: (V,) below V, by which vertices get their rays; without, along a curve.
    """

    frame: Frame | None = None
    ranks: Integers | None = None


class DynamicTransfer:
    """Transfer of a whole scene that is kept up to date while some of its chunks move.

    Neighbours are averaged within a body only; except for that, the first transfer is that of `raytraced_scene`, to the
    bit if there is one body. transfer: (V, K) float32, vertex order of the scene. bodies: list of Body; the first holds
    all that never moves.
    """

    def __init__(
        self,
        scene: Scene,
        moving: Moving,
        bands: int = DEFAULT_BANDS,
        rays: int = DEFAULT_RAYS,
        seed: int = 0,
        anchor: Anchor = Anchor(),  # noqa: B008
    ) -> None:
        """Raises InputError for chunks not there or named twice, bands outside 1..10, rays outside 1..65536."""
        self.bands, self.ray_count = harmonics.check_bands(bands), check_rays(rays)
        counts = [len(chunk.vertices) for chunk in scene.chunks]
        self._starts = np.append(0, np.cumsum(counts))
        self._body_of = _bodies(moving, len(counts))
        self._vertices, faces = np.array(scene.vertices), scene.faces  # a copy: it is what moves
        self._normals = np.array(unit_normals(scene.normals))
        if len(faces) == 0:
            raise InputError("the scene has no faces: light needs a surface")
        self.frame = Frame.around(self._vertices, faces) if anchor.frame is None else anchor.frame
        self._azimuths = sampling.fibonacci_azimuths(self.ray_count)
        self._offsets = sampling.ranked_offsets(np.arange(len(self._vertices)), seed)
        self.transfer = np.zeros((len(self._vertices), self.bands**2), np.float32)
        self.bodies = self._split(np.repeat(self._body_of, counts), faces)
        known = None if anchor.ranks is None else np.asarray(anchor.ranks)
        if known is not None and known.shape != self.transfer.shape[:1]:
            raise InputError(f"expected a rank for each of {len(self.transfer)} vertices, found {known.shape}")
        for body in self.lit:
            body.ranks = None if known is None else known[body.rows]
            self._place(body)
        self.ranks: Integers = self._first_ranks() if known is None else known
        if known is None:
            for body in self.lit:
                body.ranks = self.ranks[body.rows]
        self._refresh(self.lit)

    @property
    def anchor(self) -> Anchor:
        """The Anchor that identifies transfers with the same rays."""
        return Anchor(self.frame, self.ranks)

    @property
    def lit(self) -> list[Body]:
        """The bodies that have vertices."""
        return [body for body in self.bodies if len(body.rows)]

    @property
    def vertices(self) -> NDArray[np.float32]:
        """(V, 3) float32, scene frame: the pose that was given last."""
        return self._vertices

    @property
    def normals(self) -> NDArray[np.float32]:
        """(V, 3) float32, unit: of the pose that was given last."""
        return self._normals

    def update(self, chunk: int, vertices: Points, normals: Directions) -> Indices:
        """Move one chunk; see `update_all`."""
        return self.update_all({chunk: (vertices, normals)})

    def update_all(
        self,
        changes: Changes,  # chunk -> (vertices, normals), (V, 3) each, scene frame: as many as it had
    ) -> Indices:
        """Bring the transfer up to date: the sorted rows of it that may be new, (M,).

        Raises InputError for chunks that never move, and arrays that do not fit. Then nothing has changed.
        """
        checked = {chunk: self._checked(chunk, *arrays) for chunk, arrays in changes.items()}
        for chunk, (vertices, normals) in checked.items():
            rows = slice(self._starts[chunk], self._starts[chunk + 1])
            self._vertices[rows], self._normals[rows] = vertices, normals
        moved = [self.bodies[number] for number in sorted({int(self._body_of[chunk]) for chunk in checked})]
        for body in moved:
            self._place(body)
        return self._refresh(moved)

    def _checked(
        self, chunk: int, vertices: Points, normals: Directions
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        if not (0 <= chunk < len(self._body_of)) or self._body_of[chunk] == STATIC:
            movable = ", ".join(map(str, np.flatnonzero(self._body_of)))
            raise InputError(f"chunk {chunk} was not named among those that move; these are {movable}")
        expected = int(self._starts[chunk + 1] - self._starts[chunk]), 3
        vertices, normals = np.asarray(vertices, np.float32), np.asarray(normals)
        for name, array in (("vertices", vertices), ("normals", normals)):
            check_shape(f"the {name} of chunk {chunk}", array, expected)
        placed(self.frame, vertices)
        return vertices, unit_normals(normals)

    def _split(self, owner: Integers, faces: Faces) -> list[Body]:
        """The bodies, given that of every vertex, (V,)."""
        local = np.zeros(len(owner), np.int64)
        bodies = []
        for number in range(int(self._body_of.max(initial=0)) + 1):
            rows = np.flatnonzero(owner == number)
            local[rows] = np.arange(len(rows))
            bodies.append(Body(number, rows, local[faces[owner[faces[:, 0]] == number]], self.bands))
        return bodies

    def _place(self, body: Body) -> None:
        vertices = self._vertices[body.rows]
        own = float(np.spacing(np.float32(np.abs(vertices).max(initial=0.0)))) / self.frame.diagonal
        rounding = INPUT_ROUNDINGS * max(own, self.frame.rounding)
        body.place(placed(self.frame, vertices), self._normals[body.rows], rounding)

    def _first_ranks(self) -> NDArray[np.int64]:
        """Rank of every vertex along a curve through the whole scene, (V,) int64, equal for equal vertices."""
        origins = np.zeros((len(self.transfer), 3), np.float32)
        for body in self.lit:
            origins[body.rows] = body.origins
        order, new_node, _ = ranked_nodes(origins, self._normals)
        ranks = np.zeros(len(order), np.int64)
        ranks[order] = np.cumsum(new_node) - 1
        return ranks

    def _refresh(self, moved: Sequence[Body]) -> Indices:
        """Trace, sum and average what bodies at a new place can have changed: the sorted rows of the transfer."""
        rows = [np.zeros(0, np.int64)]
        for body in self.lit:
            if body in moved:
                offsets = self._offsets[self.ranks[body.rows[body.nodes]]]
                body.sight = Sight(body, body.aim(self._azimuths, offsets), self.bodies)
            else:
                body.sight.renew(moved)
            changed = body.sight.changed()
            if changed.any():
                body.gather(np.flatnonzero(changed))
                rows.append(self._average(body, changed))
        return np.sort(np.concatenate(rows))

    def _average(self, body: Body, changed: Mask) -> Indices:
        """Write the transfer around changed nodes: its rows."""
        steps = steps_for(self.ray_count, self.bands)
        seen = body.model, body.rest
        nodes, model, rest = body.rings.averaged(body.node_normals, seen, self.ray_count, steps, changed)
        found = np.full(len(body.nodes), -1, np.int64)
        found[nodes] = np.arange(len(nodes))
        found = found[body.rings.node]
        own = np.flatnonzero(found >= 0)
        for start in range(0, len(own), BATCH_RAYS // 32):
            part = own[start : start + BATCH_RAYS // 32]
            at = found[part]
            self.transfer[body.rows[part]] = completed(body.normals[part], model[at], rest[at])
        return body.rows[own]


def _bodies(moving: Moving, chunks: int) -> NDArray[np.int64]:
    """Number of the body of every chunk, (chunks,) int64: STATIC, or from 1 on."""
    body_of = np.full(chunks, STATIC, np.int64)
    for number, group in enumerate(moving, 1):
        members: NDArray[np.int64] = np.atleast_1d(np.asarray(group))
        if members.dtype.kind != "i" or not len(members) or members.min() < 0 or members.max() >= chunks:
            raise InputError(f"chunks that move must be numbers from 0 to {chunks - 1}, found {group}")
        if (body_of[members] != STATIC).any() or len(set(members.tolist())) < len(members):
            raise InputError(f"a chunk can move with one body only, found {moving}")
        body_of[members] = number
    return body_of
