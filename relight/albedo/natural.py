"""The colour of captured light that nothing shows: from orange to blue, hardly ever green or magenta.

Skies, suns and lamps of all kinds lie near the colours of a black body. Surfaces do not: grass and leaves are green,
and a scene of them says little about its light. So of the mean colour of a scene its light takes a large part along
the first direction, and a small one across.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.calibration import Provenance
from splat2mesh.scene.color import luminance

GREEN = np.array([-1.0, 2.0, -1.0]) / math.sqrt(6.0)
"""Unit direction of log colour, linear Rec. 709, from magenta to green. Along it black bodies from 3,000 to 25,000 K
lie between -.15 and .17, the mean colours of eight environments (four built in, four photographed) between -.11 and
.05, that of a ninth, grace, at -.33; leaves at .5 to .8."""


@dataclass(frozen=True)
class HueCalibration:
    """Light and surfaces as parts of the colour of a scene.

    warm_share, green_share: of the log colour of a scene, what its light is taken for, from orange to blue and across.
    warm, green: spread of the log colour of light around that.
    """

    provenance: ClassVar = Provenance(
        script="scripts/bench albedo",
        fitted_on="mean colours of eight environments; no scene",
        held_out="18 generated scenes, four of them of leaves, and real captures (docs/albedo.md)",
    )

    warm_share: float = 0.5
    green_share: float = 0.1
    warm: float = 0.25
    green: float = 0.05


HUES = HueCalibration()

_ACROSS = np.outer(GREEN, GREEN)
_ALONG = np.eye(3) - np.full((3, 3), 1.0 / 3.0) - _ACROSS

PRECISION = _ALONG / HUES.warm**2 + _ACROSS / HUES.green**2
"""(3, 3) of the prior on log colour, as `fit.prior_of` takes it."""


def light_of(color: NDArray[np.float64]) -> NDArray[np.float64]:
    """The colour of a light by that of the surfaces it lights: (3,) positive to (3,) of the same luminance."""
    bright = luminance(color)
    log_color = np.log(color / bright)
    light = np.exp((HUES.warm_share * _ALONG + HUES.green_share * _ACROSS) @ log_color)
    return np.asarray(light / luminance(light) * bright)
