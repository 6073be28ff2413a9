"""Light on a scene in which chunks move: what is kept between two poses, and renewed only where a motion reaches."""

import numpy as np

from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

from ..transfer.apply import Product
from ..transfer.moving import LiveTransfer
from ..transfer.moving_suns import LiveSunlight
from .split_light import image_key, split_light


class Live:
    """The direct light of a scene whose chunks `moving` may move.

    settings: Settings with shadows everywhere; method "raytraced". moving: set of chunk numbers.
    """

    def __init__(self, scene, moving, settings, seed, max_speed, before=None):
        """before: the Live of the same scene with fewer moving chunks, whose pose and rays are taken over."""
        self.settings, self.moving = settings, frozenset(moving)
        kept = {} if before is None else {"frame": before.lit.frame, "ranks": before.lit.ranks}
        pose = scene if before is None else before.scene(scene)
        parts = sorted(self.moving)
        self.lit = LiveTransfer(pose, parts, settings.bands, settings.rays, seed, max_speed, **kept)
        self._product = Product(self.lit.transfer)
        self._sunlight, self._light = None, None

    @property
    def stale(self):
        """Whether some of the light is old, because its chunks moved too fast."""
        return bool(self.lit.stale)

    def update(self, changes, seconds):
        """Move chunks, {number: (vertices, normals)}: the sorted rows, (M,), whose light may have changed."""
        return self._renewed(self.lit.update_all(changes, seconds))

    def catch_up(self):
        """Compute what was left out: the sorted rows, (M,), whose light may have changed."""
        return self._renewed(self.lit.catch_up())

    def direct(self, environment, cache):
        """Direct light on the white scene in its present pose: (V, 3) float32, and the number of suns."""
        coefficients, suns = split_light(environment, self.settings, cache)
        light = image_key(environment), environment.rotation_deg
        if light != self._light:
            self._sunlight, self._light = LiveSunlight(self.lit, suns) if len(suns) else None, light
        other = None if self._sunlight is None else self._sunlight.radiance
        return self._product.radiance(coefficients, other=other), len(suns)

    def scene(self, like):
        """The Scene in its present pose, with all else from another."""
        ends = np.cumsum([len(chunk.vertices) for chunk in like.chunks])[:-1]
        poses = zip(np.split(self.lit.vertices, ends), np.split(self.lit.normals, ends), like.chunks, strict=True)
        return Scene([Mesh(vertices, normals, old.faces, old.colors_srgb) for vertices, normals, old in poses])

    def _renewed(self, rows):
        self._product.write(rows, self.lit.transfer[rows])
        return rows if self._sunlight is None else np.union1d(rows, self._sunlight.update())


def check_changes(scene, changes):
    """Raise InputError for chunks that a scene does not have."""
    for chunk in changes:
        if chunk != int(chunk) or not 0 <= chunk < len(scene.chunks):
            raise InputError(f"chunk {chunk}: the scene has chunks 0 to {len(scene.chunks) - 1}")
