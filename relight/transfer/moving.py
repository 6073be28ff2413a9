"""Transfer of a scene in which bodies move: only rays that the motion can have changed are traced again.

Visibility is kept as bits, one per ray and body: a ray is free if no body stops it. When a body moves, its own vertices
are traced anew; every other vertex keeps its bits but for this one body, and of these it needs only the rays that
meet the body's boxes now (`reach`). Transfer is summed and averaged again around what came out different.
The result is, to the bit, that of a new LiveTransfer of the moved scene with the same frame and ranks: rays depend on
the rank of their vertex, which stays, and not on history.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from splat2mesh.errors import InputError

from .. import sh
from ..normals import unit_normals
from . import DEFAULT_BANDS, DEFAULT_RAYS, check_rays, sampling
from .filtering import steps_for
from .neighbors import ranked_nodes
from .occluder import EDGE_OFFSET, INPUT_ROUNDINGS, MAX_OFFSET, MIN_OFFSET, MIN_OPENNESS
from .reach import Boxes, Hemisphere, blocked
from .rings import Rings
from .visibility import BATCH_RAYS, completed

STATIC = 0
"""Number of the body of all that never moves; it may have no faces."""

MAX_DRIFT = 64.0
"""Bodies may go this many diagonals from the middle of the first pose: farther off float32 loses contact shadows."""


class Frame(NamedTuple):
    """The unit frame of a scene's first pose, kept while bodies move.

    center: (3,) float64. diagonal: float. rounding: of the coordinates as they came, in this frame.
    """

    center: np.ndarray
    diagonal: float
    rounding: float

    @classmethod
    def around(cls, vertices, faces):
        """That of `occluder.Occluder`. Raises InputError for a mesh without extent."""
        used = np.zeros(len(vertices), bool)
        used[faces] = True
        seen = vertices if used.all() else vertices[used]
        low, high = seen.min(axis=0).astype(np.float64), seen.max(axis=0).astype(np.float64)
        diagonal = float(np.linalg.norm(high - low))
        if not 0.0 < diagonal < np.inf:
            raise InputError(f"the scene spans {diagonal} units; expected vertices that differ and fit in float32")
        return cls((low + high) / 2.0, diagonal, float(np.spacing(np.float32(np.abs([low, high]).max()))) / diagonal)

    def unit(self, vertices):
        """Scene frame to unit frame, (V, 3) float32. Raises InputError for what is not finite or drifted off."""
        unit = ((vertices - self.center) / self.diagonal).astype(np.float32)
        bad = int((~(np.abs(unit) <= MAX_DRIFT)).any(axis=1).sum())
        if bad:
            raise InputError(f"{bad} of {len(unit)} vertices are not finite or over {MAX_DRIFT:g} diagonals off")
        return unit


class Body:
    """Chunks that move as one, with the visibility of their nodes.

    number: its place among the bodies. rows: (V,) int64, its vertices among all. nodes: (N,) int64, the vertices, among
    its own, that stand for nodes. rings: Rings. rays: Hemisphere, or None without vertices.
    fixed: bits (N, bytes) of rays that the body itself or what never moves stops. others: number of another body ->
    bits of rays that it stops and these do not. boxes: Boxes, or None without faces.
    model, rest: (N, 4) and (N, K) float32 of `sampling.gather`, before averaging.
    """

    def __init__(self, number, rows, faces, bands):
        self.number, self.rows, self.faces = number, rows, np.ascontiguousarray(faces, np.uint32)
        self.others, self.boxes, self.rings, self.rays = {}, None, None, None
        self._bands = bands

    def place(self, unit, normals, rounding):
        """Move: new places (V, 3) in the unit frame and unit normals (V, 3), both float32. Bits become invalid."""
        self.unit, self.normals = unit, normals
        joined = self.rings is not None and not self._torn()
        if not joined:
            self._find_places()
        self.origins = np.zeros_like(unit)
        least = MIN_OFFSET * max(1.0, float(np.abs(unit).max(initial=0.0)))
        _stand_off(unit, normals, self.faces, self._place, self._distinct, least, rounding, self.origins)
        if not joined:
            self._join()
        if len(self.faces):
            import open3d as o3d

            self._scene = o3d.t.geometry.RaycastingScene()
            self._scene.add_triangles(o3d.core.Tensor.from_numpy(unit), o3d.core.Tensor.from_numpy(self.faces))
            if self.boxes is None:
                self.boxes = Boxes(unit, self.faces)
            else:
                self.boxes.move(unit)

    def aim(self, azimuths, offsets):
        """Set the rays: azimuths (R, 2), offsets (N, 2) of the nodes. Weights of the neighbours follow too."""
        self.node_normals = np.ascontiguousarray(self.normals[self.nodes])
        self.rays = Hemisphere(np.ascontiguousarray(self.origins[self.nodes]), self.node_normals, azimuths, offsets)
        self.rings.bend(self.node_normals)

    def look(self, bodies):
        """Trace all rays against all bodies: once they, or this one, are new."""
        everything = np.arange(len(self.nodes))
        self.fixed = np.zeros((len(everything), -(-self.rays.rays // 8)), np.uint8)
        for body in sorted({bodies[STATIC], self}, key=lambda body: body.number):
            if body.boxes is not None:
                self.fixed |= blocked(self.rays, everything, body.boxes, body.occluded, self.fixed)
        self.others = {
            body.number: blocked(self.rays, everything, body.boxes, body.occluded, self.fixed)
            for body in bodies
            if body.number != STATIC and body is not self and body.boxes is not None
        }

    def look_again(self, moved):
        """Trace the rays that meet bodies at their new place: which nodes see something else, (N,) bool."""
        everything = np.arange(len(self.nodes))
        before = self.others
        self.others = dict(before)
        changed = np.zeros(len(everything), bool)
        for body in moved:
            if body.boxes is not None:
                bits = blocked(self.rays, everything, body.boxes, body.occluded, self.fixed)
                changed |= (bits != before[body.number]).any(axis=1)
                self.others[body.number] = bits
        return changed

    def occluded(self, rays):
        """Whether the body stops the rays, (n, 6) float32 -> (n,) bool."""
        import open3d as o3d

        return self._scene.test_occlusions(o3d.core.Tensor.from_numpy(rays)).numpy()

    def hidden(self):
        """Bits (N, bytes) of the rays that anything stops."""
        hidden = self.fixed.copy()
        for bits in self.others.values():
            hidden |= bits
        return hidden

    def gather(self, nodes):
        """Sum up the rays of some nodes (M,) into model and rest."""
        origins, normals, azimuths, offsets = self.rays.arrays
        batch = max(1, BATCH_RAYS // self.rays.rays)
        hidden = self.hidden()
        for start in range(0, len(nodes), batch):
            part = nodes[start : start + batch]
            shot = np.zeros((len(part), self.rays.rays, 6), np.float32)
            sampling.shoot_at(origins[part], normals[part], azimuths, offsets[part], shot)
            stopped = np.unpackbits(hidden[part], axis=1, count=self.rays.rays).view(bool)
            model, rest = np.zeros((len(part), 4), np.float32), np.zeros((len(part), self.rest.shape[1]), np.float32)
            sampling.gather(shot, stopped, normals[part], model, rest)
            self.model[part], self.rest[part] = model, rest

    def _find_places(self):
        """Which vertices share a position, and one for each normal that there is at it."""
        order, new_node, new_place = ranked_nodes(self.unit, self.normals)
        self._place = np.zeros(len(order), np.int64)
        self._place[order] = np.cumsum(new_place) - 1
        self._distinct = order[new_node]

    def _join(self):
        """Find the nodes and who is beside whom, in the pose as it is."""
        self.rings = Rings(self.origins, self.normals, self.faces)
        self.nodes = self.rings.vertices
        copies = np.flatnonzero(self.nodes[self.rings.node] != np.arange(len(self.unit)))
        self._copies = copies, self.nodes[self.rings.node[copies]]
        self.model = np.zeros((len(self.nodes), 4), np.float32)
        self.rest = np.zeros((len(self.nodes), self._bands**2), np.float32)

    def _torn(self):
        """Whether vertices that were one are no longer."""
        copies, first = self._copies
        return (self.unit[copies] != self.unit[first]).any() or (self.normals[copies] != self.normals[first]).any()


class LiveTransfer:
    """Transfer of a whole scene that is kept up to date while some of its chunks move.

    Neighbours are averaged within a body only; but for that, the first transfer is that of `raytraced_scene`, to the
    bit if there is one body.
    transfer: (V, K) float32, vertex order of the scene. bodies: list of Body; the first holds all that never moves.
    stale: set of the numbers of bodies whose transfer is old, because they were too fast.
    """

    def __init__(
        self,
        scene,
        moving,  # chunks that may move: numbers, or lists of numbers of those that move as one
        bands=DEFAULT_BANDS,
        rays=DEFAULT_RAYS,
        seed=0,
        max_speed=math.inf,  # of any vertex, in diagonals of the scene per second, at which transfer is still computed
        frame=None,  # Frame; that of the scene without
        ranks=None,  # (V,) integers below V by which vertices get their rays; without, along a curve through the scene
        advance=lambda count: None,  # called with the number of vertices done
    ):
        """Raises InputError for chunks that are not there or named twice, bands outside 1..10, rays outside 1..65536."""
        self.bands, self.ray_count, self.max_speed = sh.check_bands(bands), check_rays(rays), float(max_speed)
        counts = [len(chunk.vertices) for chunk in scene.chunks]
        self._starts = np.append(0, np.cumsum(counts))
        self._body_of = _bodies(moving, len(counts))
        self._vertices, self._normals, faces = scene.vertices, unit_normals(scene.normals), scene.faces
        if len(faces) == 0:
            raise InputError("the scene has no faces: light needs a surface")
        self.frame = Frame.around(self._vertices, faces) if frame is None else frame
        self._azimuths = sampling.fibonacci_azimuths(self.ray_count)
        self._offsets = sampling.ranked_offsets(0, len(self._vertices), seed)
        self.transfer = np.zeros((len(self._vertices), self.bands**2), np.float32)
        self.bodies, self.stale = self._split(np.repeat(self._body_of, counts), faces), set()
        for body in self.bodies:
            self._place(body)
        self.ranks = self._first_ranks() if ranks is None else np.asarray(ranks)
        if self.ranks.shape != self.transfer.shape[:1]:
            raise InputError(f"expected a rank for each of {len(self.transfer)} vertices, found {self.ranks.shape}")
        self._refresh(self.bodies)

    @property
    def vertices(self):
        """(V, 3) float32, scene frame: the pose that was given last."""
        return self._vertices

    @property
    def normals(self):
        """(V, 3) float32, unit: of the pose that was given last."""
        return self._normals

    def update(self, chunk, vertices, normals, seconds=None):
        """Move one chunk; see `update_all`."""
        return self.update_all({chunk: (vertices, normals)}, seconds)

    def update_all(
        self,
        changes,  # chunk -> (vertices, normals), (V, 3) each, scene frame: as many as it had
        seconds=None,  # since these chunks were given before; without, no speed is known and none is too high
    ):
        """Bring the transfer up to date: the sorted rows of it that may be new, (M,).

        A body with a vertex faster than `max_speed` is only carried along: its transfer turns with it, what else there
        is sees it where it was, and its number is in `stale` until an update finds it slower, or `catch_up`.
        Raises InputError for chunks that never move, and arrays that do not fit. Then nothing has changed.
        """
        checked = {chunk: self._checked(chunk, *arrays) for chunk, arrays in changes.items()}
        moved, old = {}, {}
        for chunk, (vertices, normals) in checked.items():
            rows = slice(self._starts[chunk], self._starts[chunk + 1])
            number = self._body_of[chunk]
            step = vertices - self._vertices[rows]
            far = float(np.sqrt(np.einsum("ij,ij->i", step, step).max(initial=0.0))) / self.frame.diagonal
            moved[number] = max(moved.get(number, 0.0), far)
            if number not in old:
                own = self.bodies[number].rows
                old[number] = self._vertices[own], self._normals[own]
            self._vertices[rows], self._normals[rows] = vertices, normals
        fast = {number for number, far in moved.items() if seconds is not None and far > self.max_speed * seconds}
        carried = [self._carry(self.bodies[number], *old[number]) for number in sorted(fast)]
        self.stale |= fast
        slow = [self.bodies[number] for number in sorted(set(moved) - fast)]
        return np.unique(np.concatenate([*carried, self._move(slow)]))

    def catch_up(self):
        """Compute what was left out because bodies were too fast: the sorted rows of the transfer that may be new."""
        return self._move([self.bodies[number] for number in sorted(self.stale)])

    def _move(self, bodies):
        for body in bodies:
            self._place(body)
            self.stale.discard(body.number)
        return self._refresh(bodies)

    def _checked(self, chunk, vertices, normals):
        if not (0 <= chunk < len(self._body_of)) or self._body_of[chunk] == STATIC:
            movable = ", ".join(map(str, np.flatnonzero(self._body_of)))
            raise InputError(f"chunk {chunk} was not named among those that move; these are {movable}")
        expected = int(self._starts[chunk + 1] - self._starts[chunk]), 3
        vertices, normals = np.asarray(vertices, np.float32), np.asarray(normals)
        for name, array in (("vertices", vertices), ("normals", normals)):
            if array.shape != expected:
                raise InputError(f"the {name} of chunk {chunk} must have shape {expected}, found {array.shape}")
        self.frame.unit(vertices)
        return vertices, unit_normals(normals)

    def _split(self, owner, faces):
        """The bodies, given that of every vertex, (V,)."""
        local = np.zeros(len(owner), np.int64)
        bodies = []
        for number in range(int(self._body_of.max(initial=0)) + 1):
            rows = np.flatnonzero(owner == number)
            local[rows] = np.arange(len(rows))
            bodies.append(Body(number, rows, local[faces[owner[faces[:, 0]] == number]], self.bands))
        return bodies

    def _place(self, body):
        vertices = self._vertices[body.rows]
        own = float(np.spacing(np.float32(np.abs(vertices).max(initial=0.0)))) / self.frame.diagonal
        rounding = INPUT_ROUNDINGS * max(own, self.frame.rounding)
        body.place(self.frame.unit(vertices), self._normals[body.rows], rounding)

    def _first_ranks(self):
        """Rank of every vertex along a curve through the whole scene, (V,) int64, equal for equal vertices."""
        origins = np.zeros((len(self.transfer), 3), np.float32)
        for body in self.bodies:
            origins[body.rows] = body.origins
        order, new_node, _ = ranked_nodes(origins, self._normals)
        ranks = np.zeros(len(order), np.int64)
        ranks[order] = np.cumsum(new_node) - 1
        return ranks

    def _refresh(self, moved):
        """Trace, sum and average what bodies at a new place can have changed: the sorted rows of the transfer."""
        rows = [np.zeros(0, np.int64)]
        for body in moved:
            body.aim(self._azimuths, self._offsets[self.ranks[body.rows[body.nodes]]])
        for body in self.bodies:
            if body in moved:
                body.look(self.bodies)
                changed = np.ones(len(body.nodes), bool)
            else:
                changed = body.look_again(moved)
            if changed.any():
                body.gather(np.flatnonzero(changed))
                rows.append(self._average(body, changed))
        return np.sort(np.concatenate(rows))

    def _average(self, body, changed):
        """Write the transfer around changed nodes: its rows."""
        steps = steps_for(self.ray_count, self.bands)
        nodes, model, rest = body.rings.averaged(
            body.node_normals, body.model, body.rest, self.ray_count, steps, changed
        )
        found = np.full(len(body.nodes), -1, np.int64)
        found[nodes] = np.arange(len(nodes))
        found = found[body.rings.node]
        own = np.flatnonzero(found >= 0)
        for start in range(0, len(own), BATCH_RAYS // 32):
            part = own[start : start + BATCH_RAYS // 32]
            at = found[part]
            self.transfer[body.rows[part]] = completed(body.normals[part], model[at], rest[at])
        return body.rows[own]

    def _carry(self, body, vertices, normals):
        """Turn the transfer of a body with it, from an old pose to that given last: its rows."""
        return body.rows


def _bodies(moving, chunks):
    """Number of the body of every chunk, (chunks,) int64: STATIC, or from 1 on."""
    body_of = np.full(chunks, STATIC, np.int64)
    for number, group in enumerate(moving, 1):
        members = np.atleast_1d(group)
        if members.dtype.kind != "i" or not len(members) or members.min() < 0 or members.max() >= chunks:
            raise InputError(f"chunks that move must be numbers from 0 to {chunks - 1}, found {group}")
        if (body_of[members] != STATIC).any() or len(set(members.tolist())) < len(members):
            raise InputError(f"a chunk can move with one body only, found {moving}")
        body_of[members] = number
    return body_of


@njit(cache=True, nogil=True, error_model="numpy")
def _stand_off(vertices, normals, faces, place, distinct, least, rounding, origins):
    """Ray origins off the surface: as `occluder._origins`, for known places (V,) and one vertex for each normal there.

    least: offset that the coordinates need to be told apart. rounding: of the coordinates as they came.
    """
    count = place.max() + 1 if len(place) else 0
    common, shortest = np.zeros((count, 3), np.float32), np.full(count, np.inf)
    for v in distinct:
        for axis in range(3):
            common[place[v], axis] += normals[v, axis]
    for p in range(count):
        x, y, z = common[p]
        length = np.float32(max(np.sqrt(x * x + y * y + z * z), np.float32(1e-12)))
        common[p, 0], common[p, 1], common[p, 2] = x / length, y / length, z / length
    for f in range(len(faces)):
        for c in range(3):
            i, j = faces[f, c], faces[f, c - 1]
            x, y, z = vertices[i, 0] - vertices[j, 0], vertices[i, 1] - vertices[j, 1], vertices[i, 2] - vertices[j, 2]
            length = np.sqrt(x * x + y * y + z * z)
            if length > 0:
                shortest[place[i]] = min(shortest[place[i]], np.float64(length))
                shortest[place[j]] = min(shortest[place[j]], np.float64(length))
    for v in range(len(vertices)):
        p = place[v]
        open_by = common[p, 0] * normals[v, 0] + common[p, 1] * normals[v, 1] + common[p, 2] * normals[v, 2]
        offset = max(min(max(EDGE_OFFSET * shortest[p], least), MAX_OFFSET), rounding)
        for axis in range(3):
            step = common[p, axis] if open_by > MIN_OPENNESS else normals[v, axis]
            origins[v, axis] = np.float64(vertices[v, axis]) + offset * np.float64(step)
