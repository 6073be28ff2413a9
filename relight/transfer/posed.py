"""Light on the vertices of a scene that has been lit, in another pose: only what the motion can reach is traced again.

Each vertex keeps its frame, its rank and so its rays. Of a vertex that rests, those rays alone are traced again that
meet what moved, where it was or where it is; the others meet what they met, to the bit.
"""

from splat2mesh.scene.scene import Scene

from .occluder import Occluder
from .precomputed import Precomputed
from .reach import Swept
from .settings import Settings
from .visibility import Visibility


class PosedPrecomputed(Precomputed):
    """A Precomputed of the same vertices in another pose. Leaves and grass keep the light of the first one."""

    def __init__(self, first: Precomputed, scene: Scene) -> None:
        super().__init__(scene, first.seed, stages=first._stages)
        self.foliage, self._receivers, self._first = first.foliage, first.receivers, first
        self._occluder = Occluder(scene.vertices, scene.normals, scene.faces, first.occluder)
        self._swept = Swept.between(first.scene, scene, (first.occluder, self._occluder))

    def _known_visibility(self, settings: Settings) -> Visibility | None:
        """That of the first pose, renewed where the motion reaches."""
        if self._visibility is not None:
            return super()._known_visibility(settings)
        known = self._first._known_visibility(settings)
        return None if known is None else known.posed(self.occluder, self._swept, settings.rays)
