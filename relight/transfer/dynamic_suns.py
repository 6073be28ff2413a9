"""Suns on bodies that move: a bit for every vertex, sun and body, of which a motion renews only those that it can
reach."""

import numpy as np

from splat2mesh.base.arrays import Indices

from ..light.environment import Suns
from .bodies import Sight
from .dynamic import DynamicTransfer
from .reach import NodeRays
from .sunlight import cosines, shining


class DynamicSunlight:
    """Exit radiance of the white vertices of a DynamicTransfer under suns: as `sunlight.sunlight`.

    radiance: (V, 3) float32.
    """

    def __init__(
        self,
        transfer: DynamicTransfer,
        suns: Suns,
    ) -> None:
        """Trace all of them. Raises InputError for directions that are not unit vectors."""
        self._directions, self._weights = shining(suns)
        self._traced, self.radiance = transfer, np.zeros((len(transfer.transfer), 3), np.float32)
        self._sights: dict[int, Sight] = {}
        self._poses: dict[int, int] = {}
        self.update()

    def update(self) -> Indices:
        """Follow the DynamicTransfer after its own update: the sorted rows of the radiance that may be new, (M,)."""
        bodies = self._traced.lit
        moved = [body for body in bodies if self._poses.get(body.number) != body.poses]
        rows = [np.zeros(0, np.int64)]
        for body in bodies:
            if body in moved:
                rays = NodeRays.towards(body.node_origins, body.node_normals, self._directions)
                self._sights[body.number] = Sight(body, rays, self._traced.bodies)
            else:
                self._sights[body.number].renew(moved)
            sight = self._sights[body.number]
            changed = sight.changed()
            if not (changed.any() and len(self._directions)):
                continue
            nodes = np.flatnonzero(changed)
            radiance = np.zeros((len(changed), 3), np.float32)
            hidden = sight.hidden(nodes)
            sight.summed_up(nodes, hidden)
            cosine = cosines(body.node_normals[nodes], self._directions)
            cosine[np.unpackbits(hidden, axis=1, count=len(self._directions)).astype(bool)] = 0.0
            radiance[nodes] = np.einsum("vs,sc->vc", cosine.astype(np.float64), self._weights)
            own = np.flatnonzero(changed[body.rings.node])
            self.radiance[body.rows[own]] = radiance[body.rings.node[own]]
            rows.append(body.rows[own])
        self._poses = {body.number: body.poses for body in bodies}
        return np.sort(np.concatenate(rows))
