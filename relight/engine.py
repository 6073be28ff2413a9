"""From a scene and lights to radiance: transfer once per geometry, then one small product for every light."""

import numpy as np

from splat2mesh.errors import InputError
from splat2mesh.stages import Stages

from . import sh
from .transfer import DEFAULT_BANDS, DEFAULT_RAYS, METHODS, check_rays
from .transfer.analytic import analytic


class Relighter:
    """Light on one scene: transfer computed on first use, chunk by chunk, in the shadow of the whole scene.

    method: "raytraced", "analytic" (no shadows) or "auto" (raytraced); the attribute holds the method in use.
    bands, rays, seed: SH bands 1..10; rays per vertex and the seed of their directions, unused by "analytic".
    Raises InputError for options outside these and, on first use, for a scene that cannot be lit.
    """

    def __init__(self, scene, method="auto", bands=DEFAULT_BANDS, rays=DEFAULT_RAYS, seed=0, stages=None):
        if method not in METHODS:
            raise InputError(f"method {method!r}: expected one of {', '.join(METHODS)}")
        if seed != int(seed) or not 0 <= seed < 2**64:
            raise InputError(f"the seed must be a whole number from 0 to 2^64 - 1, found {seed}")
        self.scene = scene
        self.method = "raytraced" if method == "auto" else method
        self.bands, self.rays, self.seed = sh.check_bands(bands), check_rays(rays), int(seed)
        self._stages = Stages() if stages is None else stages
        self._transfer = None

    @property
    def transfer(self):
        """Transfer of every vertex as if white: (V, K) float32, chunk after chunk; see `relight.transfer`."""
        if self._transfer is None:
            self._transfer = self._computed()
        return self._transfer

    def shade(
        self,
        environment,  # Environment
        albedo_linear=None,  # (V, 3) in [0, 1], white without
    ):
        """Exit radiance of every vertex, (V, 3) float32 linear, in the vertex order of the scene.

        A new light or rotation costs one product of matrices. Where truncated light rings below 0, it is 0.
        Raises InputError for an albedo that is not one colour per vertex.
        """
        transfer = self.transfer
        if albedo_linear is not None and np.shape(albedo_linear) != (len(transfer), 3):
            raise InputError(f"the albedo must have shape ({len(transfer)}, 3), found {np.shape(albedo_linear)}")
        with self._stages.stage("shade"):
            radiance = np.maximum(transfer @ environment.sh(self.bands).astype(np.float32), np.float32(0.0))
            return radiance if albedo_linear is None else radiance * np.asarray(albedo_linear, np.float32)

    def _computed(self):
        counts = [len(chunk.vertices) for chunk in self.scene.chunks]
        transfer = np.zeros((sum(counts), self.bands**2), np.float32)
        with self._stages.stage("transfer", len(transfer)) as advance:
            of_chunk = self._method_for_chunks(advance)
            start = 0
            for chunk, count in zip(self.scene.chunks, counts, strict=True):
                part = slice(start, start + count)
                transfer[part] = of_chunk(chunk, part)
                start += count
        return transfer

    def _method_for_chunks(self, advance):
        """The function (chunk, its slice of the vertices) -> transfer; the calls are independent."""
        if self.method == "analytic":
            return lambda chunk, part: analytic(chunk.normals, self.bands)
        from .transfer.occluder import Occluder
        from .transfer.raytraced import raytraced

        occluder = Occluder(self.scene.vertices, self.scene.normals, self.scene.faces)
        return lambda chunk, part: raytraced(occluder, part, self.bands, self.rays, self.seed, advance)
