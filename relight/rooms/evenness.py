"""Light averaged along the surface, to remove the unevenness of noisy normals and few rays."""

import numpy as np
import scipy
from numpy.typing import NDArray

from splat2mesh.base.sphere import NO_DIRECTION

from ..transfer.neighbors import Neighbors
from ..transfer.occluder import Occluder


class Evenness:
    """Averages values of the vertices of an Occluder over rings of neighbours that face the same way.

    A vertex's own value has the weight 1, the most that one of its ring has.
    """

    def __init__(self, occluder: Occluder) -> None:
        neighbors = Neighbors(occluder.origins, occluder.normals, occluder.faces, occluder.ranked)
        rows = neighbors.matrix.astype(np.float64) + scipy.sparse.eye_array(len(neighbors.vertices), format="csr")
        self._blend = scipy.sparse.diags_array(1.0 / np.asarray(rows.sum(axis=1)).ravel()).tocsr() @ rows
        self._vertices, self._node = neighbors.vertices, neighbors.node

    def average(self, values: NDArray[np.floating], rounds: int) -> NDArray[np.float32]:
        """The values (V,) or (V, C) averaged so many times, each of which reaches one ring further; float32.

        Vertices that agree in position and normal have the same."""
        nodes = np.asarray(values, np.float64)[self._vertices]
        for _ in range(rounds):
            nodes = self._blend @ nodes
        return nodes[self._node].astype(np.float32)

    def average_directions(self, normals: NDArray[np.float32], rounds: int) -> NDArray[np.float32]:
        """The same of unit normals (V, 3), unit again; where neighbours cancel out, the given ones."""
        mean = self.average(normals, rounds)
        length = np.linalg.norm(mean, axis=1, keepdims=True)
        return np.where(length > NO_DIRECTION, mean / np.maximum(length, NO_DIRECTION), normals).astype(np.float32)
