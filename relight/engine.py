"""From a scene and lights to radiance: transfer once per geometry, then one small product for every light."""

from typing import NamedTuple

import numpy as np

from splat2mesh.errors import InputError
from splat2mesh.stages import Stages

from . import sh
from .effects import BOUNCES, SHADOWS, SUN, chosen_effects
from .transfer import DEFAULT_BANDS, DEFAULT_RAYS, GASH_BANDS, METHODS, NEURAL_RAYS, check_rays
from .transfer.analytic import analytic


class Shading(NamedTuple):
    """Light on a scene. radiance: (V, 3) float32 linear exit radiance, in the vertex order of the scene.

    suns: how many directions were traced. bounces: relative contribution of each bounce, a list.
    """

    radiance: np.ndarray
    suns: int
    bounces: list


class Relighter:
    """Light on one scene: what depends on the geometry alone is computed on first use, for the whole scene.

    method: "raytraced"; "neural" (a network mixes what few rays saw); "neural-gash" (the paper's network: position and
        normal, three bands, no shadows but guessed ones); "analytic" (no shadows); "blinn-phong" (lamps without
        shadows, the baseline); "auto": raytraced, or analytic where no effects are wanted. The attribute holds the
        one in use.
    bands, rays, seed: SH bands 1..10; rays per vertex, by default as many as suit the method, and the seed of their
        directions, where rays are traced.
    effects: "auto", "none", or some of `relight.effects.EFFECTS`. With "auto" light bounces where an albedo says how:
        in a scene all white it would never fade.
    Raises InputError for options outside these and, on first use, for a scene that cannot be lit.
    """

    def __init__(self, scene, method="auto", bands=DEFAULT_BANDS, rays=None, seed=0, effects="auto", stages=None):
        if method not in METHODS:
            raise InputError(f"method {method!r}: expected one of {', '.join(METHODS)}")
        if seed != int(seed) or not 0 <= seed < 2**64:
            raise InputError(f"the seed must be a whole number from 0 to 2^64 - 1, found {seed}")
        self.scene = scene
        self.effects, self._only_fading = chosen_effects(effects, method)
        self.method = ("raytraced" if self.effects else "analytic") if method == "auto" else method
        self.bands, self.seed = sh.check_bands(bands), int(seed)
        self.bands = min(self.bands, GASH_BANDS) if method == "neural-gash" else self.bands
        self.rays = check_rays((NEURAL_RAYS if method == "neural" else DEFAULT_RAYS) if rays is None else rays)
        self._stages = Stages() if stages is None else stages
        self._occluder = self._transfer = self._interreflection = None

    @property
    def transfer(self):
        """Transfer of every vertex as if white, without bounces: (V, K) float32; see `relight.transfer`."""
        if self._transfer is None:
            self._transfer = self._computed()
        return self._transfer

    def shade(self, environment, albedo_linear=None):
        """Exit radiance of every vertex, (V, 3) float32 linear: the radiance of `shading`."""
        return self.shading(environment, albedo_linear).radiance

    def shading(
        self,
        environment,  # Environment
        albedo_linear=None,  # (V, 3) in [0, 1], white without
    ):
        """Light a scene: a Shading. A new light or rotation costs one product of matrices, a ray for each vertex and
        sun, and a sparse product for each bounce. Where truncated light rings below 0, it is 0.

        Raises InputError for an albedo that is not one colour in [0, 1] per vertex.
        """
        count = sum(len(chunk.vertices) for chunk in self.scene.chunks)
        if albedo_linear is not None and np.shape(albedo_linear) != (count, 3):
            raise InputError(f"the albedo must have shape ({count}, 3), found {np.shape(albedo_linear)}")
        albedo = np.ones((1, 3), np.float32) if albedo_linear is None else np.asarray(albedo_linear, np.float32)
        if not ((albedo >= 0.0) & (albedo <= 1.0)).all():
            raise InputError(f"the albedo must be in [0, 1], found {albedo.min()} to {albedo.max()}")
        direct, suns = self._direct(environment)
        if BOUNCES not in self.effects or (self._only_fading and (albedo == 1.0).all()):
            return Shading(direct if albedo_linear is None else direct * albedo, suns, [])
        from .transfer.bounces import with_bounces

        interreflection = self._bouncing()
        with self._stages.stage("bounces"):
            radiance, bounces = with_bounces(direct, np.broadcast_to(albedo, direct.shape), interreflection)
        return Shading(radiance, suns, bounces)

    def _computed(self):
        count = sum(len(chunk.vertices) for chunk in self.scene.chunks)
        if SHADOWS in self.effects:
            if self.method == "neural":
                from .transfer.neural import neural as of_scene
            else:
                from .transfer.raytraced import raytraced_scene as of_scene

            occluder = self._everything()
            with self._stages.stage("transfer", count) as advance:
                return of_scene(occluder, self.bands, self.rays, self.seed, advance)
        if self.method == "neural-gash":
            from .transfer.neuralgash import neural_gash

            with self._stages.stage("transfer", count) as advance:
                guess = neural_gash(self.scene.vertices, self.scene.normals, advance)
                return np.ascontiguousarray(guess[:, : self.bands**2])
        with self._stages.stage("transfer"):
            return analytic(self.scene.normals, self.bands)

    def _direct(self, environment):
        """Direct light on the white scene, (V, 3) float32 and never negative, and the number of suns traced."""
        if self.method == "blinn-phong":
            from .blinnphong import blinn_phong

            with self._stages.stage("shade"):
                return blinn_phong(self.scene.normals, environment), 0
        transfer, rest, suns = self.transfer, environment, ()
        if SUN in self.effects:
            from .suns import split

            with self._stages.stage("suns"):
                rest, suns = split(environment, self.bands)
        with self._stages.stage("shade"):
            radiance = transfer @ rest.sh(self.bands).astype(np.float32)
        if len(suns):
            from .transfer.sunlight import sunlight

            occluder = self._everything()
            with self._stages.stage("sunlight", len(radiance)) as advance:
                radiance += sunlight(occluder, slice(None), suns, advance)
        return np.maximum(radiance, np.float32(0.0), out=radiance), len(suns)

    def _everything(self):
        """The Occluder of the whole scene."""
        if self._occluder is None:
            from .transfer.occluder import Occluder

            with self._stages.stage("occluder"):
                self._occluder = Occluder(self.scene.vertices, self.scene.normals, self.scene.faces)
        return self._occluder

    def _bouncing(self):
        """The Interreflection of the whole scene."""
        if self._interreflection is None:
            from .transfer.bounces import DEFAULT_BOUNCE_RAYS, Interreflection, visible_fraction

            occluder, visible = self._everything(), visible_fraction(self.transfer)
            with self._stages.stage("bounce rays", len(visible)) as advance:
                self._interreflection = Interreflection(occluder, DEFAULT_BOUNCE_RAYS, self.seed, visible, advance)
        return self._interreflection
