"""Direct light: what harmonics carry of a light, by one product with the transfer, and single suns beside it."""

from ..transfer.apply import BlockTransfer
from ..transfer.split_light import split_light


class DirectLight:
    """The direct light on a white scene, light after light, whether it moves or not.

    geometry: a StaticGeometry or a DynamicGeometry. Both tell, for Settings, `transfer(settings)`, which is (V, K) of
    at least as many bands and the Settings as done, and `sunlight(suns, settings)`, (V, 3) or None without suns.
    """

    def __init__(self, geometry, cache, stages):
        self._geometry, self._cache, self._stages = geometry, cache, stages
        self._blocks, self._of = None, None

    def shade(self, environment, settings):
        """Direct light on the white scene, (V, 3) float32 and never negative; how many suns; the Settings as done."""
        transfer, done = self._geometry.transfer(settings)
        with self._stages.stage("light"):
            light, suns = split_light(environment, settings, self._cache)
        sunlight = self._geometry.sunlight(suns, settings)
        with self._stages.stage("shade"):
            if self._of is None or self._of[0] is not transfer or self._of[1] != settings.bands:
                self._blocks, self._of = BlockTransfer(transfer[:, : settings.bands**2]), (transfer, settings.bands)
            return self._blocks.apply(light, other=sunlight), len(suns), done

    def renew(self, rows):
        """Take over rows, (M,), of a transfer that has changed in place."""
        if self._of is not None:
            transfer, bands = self._of
            self._blocks.write(rows, transfer[rows, : bands**2])
