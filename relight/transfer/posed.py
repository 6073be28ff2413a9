"""Light on the vertices of a scene that has been lit, in another pose.

Each vertex keeps its frame, its rank and so its rays, which are all traced: of a vertex that rests, those that the
motion does not reach meet what they met, to the bit.
"""

from splat2mesh.scene.scene import Scene

from .occluder import Occluder
from .precomputed import Precomputed


class PosedPrecomputed(Precomputed):
    """A Precomputed of the same vertices in another pose. Leaves and grass keep the light of the first one."""

    sparing = False

    def __init__(self, first: Precomputed, scene: Scene) -> None:
        super().__init__(scene, first.seed, stages=first._stages)
        self.foliage, self._receivers = first.foliage, first.receivers
        self._occluder = Occluder(scene.vertices, scene.normals, scene.faces, first.occluder)
