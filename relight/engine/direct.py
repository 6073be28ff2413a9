"""Direct light: the harmonics of a light, by one product with the transfer, and single suns."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Transfer
from splat2mesh.base.progress import Stages

from ..transfer.apply import BlockTransfer
from ..transfer.split_light import split_light
from ..transfer.sunlight import sunlight

if TYPE_CHECKING:
    from ..light.environment import Environment
    from ..light.suns import Suns
    from ..transfer.precomputed import Precomputed
    from ..transfer.settings import Settings
    from ..transfer.store import Cache


class DirectLight:
    """The direct light on the white scene of a Precomputed, light after light. cache: for the light alone."""

    def __init__(self, precomputed: "Precomputed", cache: "Cache", stages: Stages) -> None:
        self._precomputed, self._cache, self._stages = precomputed, cache, stages
        self._blocks: tuple[BlockTransfer, Transfer, int] | None = None  # of a transfer, in so many bands

    def shade(self, environment: "Environment", settings: "Settings") -> tuple[NDArray[np.float32], int, "Settings"]:
        """Direct light on the white scene, (V, 3) float32 and never negative; how many suns; the Settings as done."""
        transfer, done = self._precomputed.transfer(settings)
        with self._stages.stage("light"):
            light, suns = split_light(environment, settings, self._cache)
        by_suns = self.by_suns(suns, settings)
        with self._stages.stage("shade"):
            known, bands = self._blocks, settings.bands
            if known is None or known[1] is not transfer or known[2] != bands:
                known = self._blocks = BlockTransfer(transfer[:, : bands**2]), transfer, bands
            return known[0].apply(light, other=by_suns), len(suns), done

    def sunlight(self, environment: "Environment", settings: "Settings") -> NDArray[np.float32] | None:
        """The part of that which single suns have, (V, 3) float32; None without suns."""
        _, suns = split_light(environment, settings, self._cache)
        return self.by_suns(suns, settings)

    def by_suns(self, suns: "Suns", settings: "Settings", rows: Indices | None = None) -> NDArray[np.float32] | None:
        """(V, 3) float32 of suns. Where no shadows are wanted they are harmonics: a cosine needs no more. Given `rows`,
        (N,) vertices, others may be left out."""
        if not len(suns):
            return None
        light = self._on_surfaces(suns, settings, rows)
        if settings.volume and self._precomputed.foliage is not None:
            with self._stages.stage("sunlight"):
                light = self._precomputed.foliage.with_suns(light, suns)
        return light

    def _on_surfaces(self, suns: "Suns", settings: "Settings", rows: Indices | None) -> NDArray[np.float32]:
        occluder, count = self._precomputed.occluder, int(self._precomputed.sizes.sum())
        receivers = self._precomputed.receivers
        light = np.zeros((count, 3), np.float32)
        if settings.shadowed is None:
            traced = receivers.rows if rows is None or not receivers.all else rows
            with self._stages.stage("sunlight", len(traced)) as advance:
                light[traced] = sunlight(occluder, traced, suns, advance)
            return light if receivers.all else receivers.filled(light)
        transfer, bands = self._precomputed.transfer(settings)[0], settings.bands
        shadowed = np.repeat(settings.shadowed, self._precomputed.sizes)
        light[~shadowed] = transfer[~shadowed, : bands**2] @ suns.sh(bands).astype(np.float32)
        with self._stages.stage("sunlight", int(shadowed.sum())) as advance:
            light[shadowed] = sunlight(occluder, np.flatnonzero(shadowed), suns, advance)
        return light
