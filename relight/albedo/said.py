"""What a person says of the light that a scene was captured in."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..light.environment import Environment


@dataclass(frozen=True, eq=False)
class Said:
    """What a person says of the captured light; None for what nobody says.

    sun: (3,) float64 unit direction toward the sun, scene frame. sky: one of `light.CAPTURED_SKIES`, or an Environment.
    light: the whole light, an Environment, whose exposure alone is to be found.
    """

    sun: NDArray[np.float64] | None = None
    sky: "str | Environment | None" = None
    light: "Environment | None" = None
