"""The light of a request beside its environment, as terms of the live light: captured light and added lamps."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lamps.photometry import axis_intensity
from ..lamps.shapes import Lamp, MeshLamp
from .terms import CAPTURED, LAMP, Source, as_white

if TYPE_CHECKING:
    from ..engine.placed import LampLight

MOST_LAMPS = 32
"""Most terms of lamps: further lamps share the last term and its slider."""


class Mixture(NamedTuple):
    """asked: whether the options want light beside the environment. captured: the requested factor on the captured
    light, or None. env_scale: factor on environments. light: LampLight, or None. lamps: in the splat's frame.
    names: of the lamps. colors: (V, 3) captured colours with the captured lamps as requested; None for unchanged.
    exposed: whether the exposure was requested; otherwise light beside the environment is exposed as in the capture.
    """

    asked: bool = False
    captured: float | None = None
    env_scale: float = 1.0
    light: "LampLight | None" = None
    lamps: Sequence[Lamp] = ()
    names: Sequence[str] = ()
    colors: NDArray[np.float32] | None = None
    exposed: bool = False

    def sources(self, look: Any) -> list[Source]:
        """The captured light and each lamp as Sources. look: the Appearance."""
        white, received = np.ones(3), None
        if self.colors is not None and not np.array_equal(self.colors, look.captured):
            change = np.divide(self.colors, look.captured, out=np.ones_like(look.captured), where=look.captured > 0.0)
            received = change * look.irradiance
        found = [Source(CAPTURED, "Captured light", white, received)]
        if self.light is None:
            return found
        count = len(self.lamps)
        alone = count if count <= MOST_LAMPS else MOST_LAMPS - 1
        groups = [[number] for number in range(alone)] + [list(range(alone, count))] * (alone < count)
        for group in groups:
            found.append(self._lamp(group))
        return found

    def _lamp(self, group: list[int]) -> Source:
        """The Source of lamps by their numbers."""
        assert self.light is not None
        lamps = [self.lamps[number] for number in group]
        color = np.sum([axis_intensity(lamp) for lamp in lamps], axis=0)
        several = len(lamps) > 1 or any(isinstance(lamp, MeshLamp) and lamp.radiance.ndim == 2 for lamp in lamps)
        direct, tint = as_white(self.light.direct_of(*group), color, several)
        received = self._received(direct, tint, alone=len(lamps) == len(self.lamps))
        if len(lamps) > 1:
            return Source(LAMP, f"{len(lamps)} more lamps", tint, received)
        name = self.names[group[0]] or f"Lamp {group[0] + 1}"
        shines = self.light.emitters.of_lamp(*group), self.light.frame
        return Source(LAMP, name, tint, received, place_of(lamps[0]), shines)

    def _received(self, direct: NDArray[np.float32], tint: NDArray[np.float64], alone: bool) -> NDArray[np.float32]:
        """Irradiance (V, 3) of lamps with direct light (V, 3), in units of their tint (3,). alone: they are all lamps,
        whose light the result has: bounces keep the colours apart, so it takes a division."""
        assert self.light is not None
        if alone and (tint > 0.0).all():
            return np.asarray(self.light.placed.received / tint, np.float32)
        return self.light.with_bounces(direct).received


def place_of(lamp: Lamp) -> list[float]:
    """Position of a lamp, (3,): its middle, or an end of a tube."""
    if isinstance(lamp, MeshLamp):
        return [float(each) for each in lamp.vertices.mean(axis=0)]
    return [float(each) for each in next(getattr(lamp, n) for n in ("position", "center", "start") if hasattr(lamp, n))]
