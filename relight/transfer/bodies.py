"""Bodies of a dynamic scene: the parts that move as one, their ray origins, and which body stops which ray.

Everything here lives in the unit frame of the first pose, which stays (Frame). See `dynamic`.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Integers, Mask, Points
from splat2mesh.base.distinct import distinct
from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster

from . import sampling
from .occluder import MIN_OFFSET, Frame, places_of, stood_off
from .reach import Box, NodeRays, blocked
from .rings import Rings
from .visibility import BATCH_RAYS

STATIC = 0
"""Number of the body of all that never moves; it may have no faces."""

MAX_DRIFT = 16.0
"""Bodies may go this many diagonals from the middle of the first pose: farther off float32 loses contact shadows."""


def placed(frame: Frame, vertices: Points) -> NDArray[np.float32]:
    """Scene frame to unit frame, (V, 3) float32. Raises InputError for what is not finite or drifted off."""
    unit = frame.unit(vertices)
    bad = int((~(np.abs(unit) <= MAX_DRIFT)).any(axis=1).sum())
    if bad:
        raise InputError(f"{bad} of {len(unit)} vertices are not finite or over {MAX_DRIFT:g} diagonals off")
    return unit


class Sight:
    """The occlusion of the rays of a body's nodes, as bits (N, bytes) uint8 of `numpy.packbits`.

    rays: NodeRays. fixed: bits of rays that the body itself or static geometry stops. others: number of
    another body -> bits of rays that it stops and these do not.
    """

    def __init__(self, body: "Body", rays: NodeRays, bodies: "Sequence[Body]") -> None:
        """Trace all rays of a body against all bodies: once they, or this one, are new."""
        self.rays, self._nodes = rays, np.arange(len(rays.origins))
        self._summed: NDArray[np.uint8] | None = None
        self.fixed = np.zeros((len(self._nodes), -(-rays.each // 8)), np.uint8)
        for stopping in [bodies[STATIC]] if body.number == STATIC else [bodies[STATIC], body]:
            if stopping.box is not None:
                self.fixed |= self._stopped(stopping)
        others = [other for other in bodies if other.number not in (STATIC, body.number) and other.box is not None]
        self.others = {other.number: self._stopped(other) for other in others}

    def renew(self, moved: "Iterable[Body]") -> None:
        """Trace the rays that meet bodies at their new place."""
        for body in moved:
            if body.box is not None:
                self.others[body.number] = self._stopped(body)

    def changed(self) -> Mask:
        """Which nodes see something else than when they were summed up, (N,) bool."""
        if self._summed is None:
            return np.ones(len(self._nodes), bool)
        return (self.hidden(self._nodes) != self._summed).any(axis=1)

    def summed_up(self, nodes: Indices, hidden: NDArray[np.uint8]) -> None:
        """Remember what some nodes saw when they were summed up."""
        if self._summed is None:
            self._summed = np.zeros_like(self.fixed)
        self._summed[nodes] = hidden

    def hidden(self, nodes: Indices) -> NDArray[np.uint8]:
        """Bits of the rays of some nodes that anything stops."""
        hidden = self.fixed[nodes]
        for bits in self.others.values():
            hidden |= bits[nodes]
        return hidden

    def _stopped(self, body: "Body") -> NDArray[np.uint8]:
        assert body.box is not None  # never called for a body without faces, which stops nothing
        return blocked(self.rays, body.box, body.occluded, self.fixed)


class Body:
    """Chunks that move as one, with the visibility of their nodes.

    number: its place among the bodies. rows: (V,) int64, its vertices among all. nodes: (N,) int64, the vertices, among
    its own, that stand for nodes. rings: Rings. sight: Sight of the nodes' hemispheres. ranks: (V,), once known.
    box: Box, or None without faces. poses: how often it was placed.
    model, rest: (N, 4) and (N, K) float32 of `sampling.gather`, before averaging.
    """

    rings: Rings
    sight: Sight

    def __init__(self, number: int, rows: Indices, faces: Integers, bands: int) -> None:
        self.number, self.rows, self.faces = number, rows, np.ascontiguousarray(faces, np.uint32)
        self._corners = distinct(self.faces.ravel())
        self.box: Box | None = None
        self.ranks: Integers | None = None
        self._joined = False
        self._bands, self.poses = bands, 0

    def place(self, unit: NDArray[np.float32], normals: NDArray[np.float32], rounding: float) -> None:
        """Move: new places (V, 3) in the unit frame and unit normals (V, 3), both float32. Bits become invalid."""
        self.unit, self.normals = unit, normals
        self.poses += 1
        joined = self._joined and not self._torn()
        if not joined:
            self._places = places_of(unit, normals)
        least = MIN_OFFSET * max(1.0, float(np.abs(unit).max(initial=0.0)))
        self.origins = stood_off(unit, normals, self.faces, self._places, least, rounding)
        if not joined:
            self._join()
        if len(self.faces):
            self._caster = RayCaster(unit, self.faces)
            self.box = Box.around(unit[self._corners])

    def aim(self, azimuths: NDArray[np.float32], offsets: NDArray[np.float32]) -> NodeRays:
        """The rays of the nodes: azimuths (R, 2), offsets (N, 2). Weights of the neighbours follow too."""
        self.node_origins = np.ascontiguousarray(self.origins[self.nodes])
        self.node_normals = np.ascontiguousarray(self.normals[self.nodes])
        self.rings.bend(self.node_normals)
        return NodeRays.over_hemispheres(self.node_origins, self.node_normals, azimuths, offsets)

    def occluded(self, rays: NDArray[np.float32]) -> Mask:
        """Whether the body stops the rays, (n, 6) float32 -> (n,) bool."""
        return self._caster.occluded(rays)

    def gather(self, nodes: Indices) -> None:
        """Sum up the rays of some nodes (M,) into model and rest."""
        rays, width = self.sight.rays, self.rest.shape[1]
        origins, normals, azimuths, offsets, _ = rays
        batch = max(1, BATCH_RAYS // rays.each)
        for start in range(0, len(nodes), batch):
            part = nodes[start : start + batch]
            shot = np.zeros((len(part), rays.each, 6), np.float32)
            sampling.shoot_at(origins[part], normals[part], azimuths, offsets[part], shot)
            hidden = self.sight.hidden(part)
            stopped = np.unpackbits(hidden, axis=1, count=rays.each).view(bool)
            self.sight.summed_up(part, hidden)
            model, rest = np.zeros((len(part), 4), np.float32), np.zeros((len(part), width), np.float32)
            sampling.gather(shot, stopped, normals[part], model, rest)
            self.model[part], self.rest[part] = model, rest

    def _join(self) -> None:
        """Find the nodes and their neighbours in the current pose."""
        self.rings = Rings(self.origins, self.normals, self.faces, self.ranks)
        self._joined = True
        self.nodes = self.rings.vertices
        copies = np.flatnonzero(self.nodes[self.rings.node] != np.arange(len(self.unit)))
        self._copies = copies, self.nodes[self.rings.node[copies]]
        self.model = np.zeros((len(self.nodes), 4), np.float32)
        self.rest = np.zeros((len(self.nodes), self._bands**2), np.float32)

    def _torn(self) -> bool:
        """Whether vertices that were one are no longer."""
        copies, first = self._copies
        return (self.unit[copies] != self.unit[first]).any() or (self.normals[copies] != self.normals[first]).any()
