"""Direct light on a scene at rest: one product of transfer and light, and a shadow ray for each vertex and sun."""

import numpy as np

from ..transfer.apply import Product
from ..transfer.sunlight import sunlight
from .split_light import split_light


class Still:
    """The direct light of a scene whose Precomputed is given; `live.Live` is its counterpart in motion."""

    def __init__(self, precomputed, stages):
        self._precomputed, self._stages = precomputed, stages
        self._product, self._of = None, None

    def direct(self, environment, settings):
        """Direct light on the white scene, (V, 3) float32 and never negative; how many suns; the Settings as done."""
        if settings.method == "blinn-phong":
            from .blinnphong import blinn_phong

            with self._stages.stage("shade"):
                return blinn_phong(self._precomputed.scene.normals, environment), 0, settings
        transfer, done = self._precomputed.transfer(settings)
        with self._stages.stage("light"):
            coefficients, suns = split_light(environment, settings, self._precomputed.cache)
        other = self._sunlight(suns, settings, environment, transfer) if len(suns) else None
        with self._stages.stage("shade"):
            if self._of is None or self._of[0] is not transfer or self._of[1] != settings.bands:
                self._product, self._of = Product(transfer[:, : settings.bands**2]), (transfer, settings.bands)
            return self._product.radiance(coefficients, other=other), len(suns), done

    def _sunlight(self, suns, settings, environment, transfer):
        """(V, 3) float32 of the suns. Where no shadows are wanted they are harmonics: a cosine needs no more."""
        occluder = self._precomputed.occluder
        if settings.shadowed is None:
            with self._stages.stage("sunlight", len(transfer)) as advance:
                return sunlight(occluder, slice(None), suns, advance)
        shadowed = np.repeat(settings.shadowed, self._precomputed.sizes)
        light = np.zeros((len(transfer), 3), np.float32)
        light[~shadowed] = transfer[~shadowed, : settings.bands**2] @ suns.sh(settings.bands).astype(np.float32)
        with self._stages.stage("sunlight", int(shadowed.sum())) as advance:
            light[shadowed] = sunlight(occluder, np.flatnonzero(shadowed), suns, advance)
        return light
