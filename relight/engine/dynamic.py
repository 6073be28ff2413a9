"""A geometry with moving chunks: its light is kept between poses and renewed only where a motion reaches."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Directions, Indices, Points, Transfer
from splat2mesh.scene.scene import Scene

from ..transfer.dynamic import Anchor, DynamicTransfer
from ..transfer.dynamic_suns import DynamicSunlight
from ..transfer.settings import Settings
from .posed import scene_at

if TYPE_CHECKING:
    from ..light.environment import Suns


class DynamicGeometry:
    """A scene whose chunks `moving` may move, as `direct.DirectLight` asks it.

    settings: Settings with shadows everywhere; method "raytraced". moving: set of chunk numbers.
    """

    _traced: DynamicTransfer

    def __init__(
        self,
        scene: Scene,
        moving: Iterable[int],
        settings: Settings,
        seed: int,
        before: "DynamicGeometry | None" = None,
    ) -> None:
        """before: that of the same scene with fewer moving chunks, whose pose and rays are taken over."""
        self.settings, self.moving = settings, frozenset(moving)
        anchor = Anchor() if before is None else before._traced.anchor
        pose = scene if before is None else before.scene(scene)
        parts = sorted(self.moving)
        self._traced = DynamicTransfer(pose, parts, settings.bands, settings.rays, seed, anchor)
        self._suns: Suns | None = None
        self._sunlight: DynamicSunlight | None = None

    def transfer(self, settings: Settings | None = None) -> tuple[Transfer, Settings]:
        """(transfer (V, K) float32 in the present pose, the Settings that it was made by): the same for all."""
        return self._traced.transfer, self.settings

    def sunlight(self, suns: "Suns", settings: Settings | None = None) -> NDArray[np.float32] | None:
        """(V, 3) float32 of the suns in the present pose; None without."""
        known = self._suns
        pairs = () if known is None else ((known.directions, suns.directions), (known.weights, suns.weights))
        if known is None or not all(np.array_equal(*pair) for pair in pairs):
            self._suns, self._sunlight = suns, DynamicSunlight(self._traced, suns) if len(suns) else None
        return None if self._sunlight is None else self._sunlight.radiance

    def update(self, changes: Mapping[int, tuple[Points, Directions]]) -> tuple[Indices, Indices]:
        """Move chunks, {number: (vertices, normals)}: sorted rows that may have changed, of transfer and of light."""
        rows = self._traced.update_all(changes)
        return rows, rows if self._sunlight is None else np.union1d(rows, self._sunlight.update())

    def scene(self, like: Scene) -> Scene:
        """The Scene in its present pose, with all else from another."""
        return scene_at(like, self._traced.vertices, self._traced.normals)
