"""A static geometry: its transfer under any settings, kept between runs, and the shadows of suns on it."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Indices, Transfer
from splat2mesh.base.progress import Stages

from ..transfer.sunlight import sunlight

if TYPE_CHECKING:
    from ..light.environment import Suns
    from ..transfer.precomputed import Precomputed
    from ..transfer.settings import Settings


class StaticGeometry:
    """The view that `direct.DirectLight` has of a Precomputed; `dynamic.DynamicGeometry` is its counterpart in motion.

    To the bit a DynamicGeometry of one body, but its visibility is kept for more bands, more rays and the next run.
    """

    def __init__(self, precomputed: "Precomputed", stages: Stages) -> None:
        self._precomputed, self._stages = precomputed, stages

    def transfer(self, settings: "Settings") -> tuple[Transfer, "Settings"]:
        """(transfer (V, K) float32 of at least `settings.bands`, the Settings with the rays it really has)."""
        return self._precomputed.transfer(settings)

    def sunlight(self, suns: "Suns", settings: "Settings", rows: Indices | None = None) -> NDArray[np.float32] | None:
        """(V, 3) float32 of the suns. Given `rows`, (N,) vertices, others may be left out."""
        if not len(suns):
            return None
        light = self._on_surfaces(suns, rows)
        if settings.volume and self._precomputed.foliage is not None:
            with self._stages.stage("sunlight"):
                light = self._precomputed.foliage.with_suns(light, suns)
        return light

    def _on_surfaces(self, suns: "Suns", rows: Indices | None) -> NDArray[np.float32]:
        occluder, count = self._precomputed.occluder, int(self._precomputed.sizes.sum())
        receivers = self._precomputed.receivers
        light = np.zeros((count, 3), np.float32)
        traced = receivers.rows if rows is None or not receivers.all else rows
        with self._stages.stage("sunlight", len(traced)) as advance:
            light[traced] = sunlight(occluder, traced, suns, advance)
        return light if receivers.all else receivers.filled(light)
