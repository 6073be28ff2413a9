"""Direct light: the harmonics of a light, by one product with the transfer, and single suns."""

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Transfer
from splat2mesh.base.progress import Stages

from ..transfer.apply import BlockTransfer
from ..transfer.split_light import split_light

if TYPE_CHECKING:
    from ..light.environment import Environment, Suns
    from ..transfer.settings import Settings
    from ..transfer.store import Cache


class Geometry(Protocol):
    """A geometry at rest or in motion, as `DirectLight` asks it."""

    def transfer(self, settings: "Settings") -> tuple[Transfer, "Settings"]:
        """(V, K) float32 of at least as many bands as the Settings ask for, and the Settings as done."""

    def sunlight(self, suns: "Suns", settings: "Settings") -> NDArray[np.float32] | None:
        """Exit radiance of white vertices under the suns, (V, 3) float32; None without suns."""


class DirectLight:
    """The direct light on a white scene, light after light, whether it moves or not.

    geometry: a StaticGeometry or a DynamicGeometry.
    """

    def __init__(self, geometry: Geometry, cache: "Cache", stages: Stages) -> None:
        self._geometry, self._cache, self._stages = geometry, cache, stages
        self._blocks: tuple[BlockTransfer, Transfer, int] | None = None  # of a transfer, in so many bands

    def shade(self, environment: "Environment", settings: "Settings") -> tuple[NDArray[np.float32], int, "Settings"]:
        """Direct light on the white scene, (V, 3) float32 and never negative; how many suns; the Settings as done."""
        transfer, done = self._geometry.transfer(settings)
        with self._stages.stage("light"):
            light, suns = split_light(environment, settings, self._cache)
        sunlight = self._geometry.sunlight(suns, settings)
        with self._stages.stage("shade"):
            known, bands = self._blocks, settings.bands
            if known is None or known[1] is not transfer or known[2] != bands:
                known = self._blocks = BlockTransfer(transfer[:, : bands**2]), transfer, bands
            return known[0].apply(light, other=sunlight), len(suns), done

    def sunlight(self, environment: "Environment", settings: "Settings") -> NDArray[np.float32] | None:
        """The part of that which single suns have, (V, 3) float32; None without suns."""
        _, suns = split_light(environment, settings, self._cache)
        return self._geometry.sunlight(suns, settings)

    def renew(self, rows: Indices) -> None:
        """Take over rows, (M,), of a transfer that has changed in place."""
        if self._blocks is not None:
            blocks, transfer, bands = self._blocks
            blocks.write(rows, transfer[rows, : bands**2])
