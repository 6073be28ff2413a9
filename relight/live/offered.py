"""The lights that may have lit the capture, for a page: sky and sun apart, so that a hand can move the sun."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..albedo.by_hand import SkyAndSun
from ..engine.by_hand import LightByHand, can_be_set
from ..light.pooling import pooled
from .harmonics import about_y
from .lights import IMAGE
from .response import BANDS

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Relighter


class OfferedLight(NamedTuple):
    """A likely light of the capture, in the unit of its colours. name: for people. share: of the posterior. image:
    (64, 128, 3) float32 radiance of its sky, without a sun. rest: (K, 3) coefficients of that about +y. color: (3,) of
    the sun, luminance 1. sun: `azimuth_deg`, `height_deg` and `sun_share` of a HandLight, as offered."""

    name: str
    share: float
    image: NDArray[np.float32]
    rest: NDArray[np.float64]
    color: list[float]
    sun: dict[str, float]

    @classmethod
    def of(cls, offered: SkyAndSun) -> "OfferedLight":
        """The OfferedLight of a SkyAndSun."""
        image: NDArray[np.float32] = pooled(offered.sky.radiance, IMAGE).astype(np.float32)
        sun = {name: float(getattr(offered.hand, name)) for name in ("azimuth_deg", "height_deg", "sun_share")}
        color = [float(each) for each in offered.color]
        entry = offered.entry
        return cls(entry.name, entry.share, image, about_y(offered.sky.sh(BANDS)), color, sun)

    def described(self, file: str) -> dict[str, Any]:
        """Its entry in live.json, a dict. file: of its image."""
        numbers = {"rest": self.rest.tolist(), "color": self.color, **self.sun}
        return {"name": self.name, "share": self.share, "file": file, **numbers}


def offered_lights(relighter: "Relighter", look: "Appearance") -> list[OfferedLight]:
    """The likely lights of a scene; none where its captured light cannot be set by hand."""
    if not can_be_set(look, relighter):
        return []
    return [OfferedLight.of(each) for each in LightByHand(relighter, look).offered]
