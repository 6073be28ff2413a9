"""A geometry in which chunks move: what is kept between two poses, and renewed only where a motion reaches."""

import numpy as np

from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

from ..transfer.dynamic import DynamicTransfer
from ..transfer.dynamic_suns import DynamicSunlight


class DynamicGeometry:
    """A scene whose chunks `moving` may move, as `direct.DirectLight` asks it.

    settings: Settings with shadows everywhere; method "raytraced". moving: set of chunk numbers.
    """

    def __init__(self, scene, moving, settings, seed, max_speed, before=None):
        """before: that of the same scene with fewer moving chunks, whose pose and rays are taken over."""
        self.settings, self.moving = settings, frozenset(moving)
        kept = {} if before is None else {"frame": before._traced.frame, "ranks": before._traced.ranks}
        pose = scene if before is None else before.scene(scene)
        parts = sorted(self.moving)
        self._traced = DynamicTransfer(pose, parts, settings.bands, settings.rays, seed, max_speed, **kept)
        self._suns = self._sunlight = None

    @property
    def stale(self):
        """Whether some of the light is old, because its chunks moved too fast."""
        return bool(self._traced.stale)

    def transfer(self, settings=None):
        """(transfer (V, K) float32 in the present pose, the Settings that it was made by): the same for all."""
        return self._traced.transfer, self.settings

    def sunlight(self, suns, settings=None):
        """(V, 3) float32 of the suns in the present pose; None without."""
        known = self._suns
        same = known is not None and np.array_equal(known.directions, suns.directions)
        if not same or not np.array_equal(known.weights, suns.weights):
            self._suns, self._sunlight = suns, DynamicSunlight(self._traced, suns) if len(suns) else None
        return None if self._sunlight is None else self._sunlight.radiance

    def update(self, changes, seconds):
        """Move chunks, {number: (vertices, normals)}: sorted rows that may have changed, of transfer and of light."""
        return self._renewed(self._traced.update_all(changes, seconds))

    def catch_up(self):
        """Compute what was left out: sorted rows that may have changed, of the transfer and of the light."""
        return self._renewed(self._traced.catch_up())

    def scene(self, like):
        """The Scene in its present pose, with all else from another."""
        ends = np.cumsum([len(chunk.vertices) for chunk in like.chunks])[:-1]
        poses = np.split(self._traced.vertices, ends), np.split(self._traced.normals, ends)
        chunks = zip(*poses, like.chunks, strict=True)
        return Scene([Mesh(vertices, normals, old.faces, old.colors_srgb) for vertices, normals, old in chunks])

    def _renewed(self, rows):
        return rows, rows if self._sunlight is None else np.union1d(rows, self._sunlight.update())


def check_changes(scene, changes):
    """Raise InputError for chunks that a scene does not have."""
    for chunk in changes:
        if chunk != int(chunk) or not 0 <= chunk < len(scene.chunks):
            raise InputError(f"chunk {chunk}: the scene has chunks 0 to {len(scene.chunks) - 1}")
