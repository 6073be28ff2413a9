"""The effect of a new light in a room without a known way in for it: an assumption instead of physics.

The light that came in on the capture day takes the brightness and the colour of the new one, relative to a white sky of
radiance 1: by that a camera was exposed and balanced.
"""

import math

import numpy as np
from numpy.typing import NDArray

from splat2mesh.scene.color import luminance

from ..light.environment import Environment

OUTSIDE = 0.5
"""Share of the captured light assumed to come from outside, if lamps were found but no window. It cannot be estimated:
the model attributes all light of unknown origin to the lamps."""

LEAST, MOST = 1.0 / 16.0, 1.0
"""Range of the change of brightness: at night four stops, so that no black picture results, and what is brighter than
white would burn out, for a camera is exposed for it."""


def assumed_change(environment: Environment, scale: float = 1.0) -> NDArray[np.float32]:
    """Return the factors of each colour, (3,) float32, on light that came from outside.

    environment: the new light; radiance 1 all around is the light of the capture. scale: factor on it, beyond the range
    that the change is kept in.
    """
    mean, bright = _mean(environment)
    if not bright > 0.0:
        return np.full(3, LEAST * scale, np.float32)
    return (_brightness(bright) * scale * mean / bright).astype(np.float32)


def assumed_exposure(environment: Environment, scale: float = 1.0) -> float:
    """Return the factor on the mean radiance of an environment that gives `assumed_change`; 0 for a black one."""
    _, bright = _mean(environment)
    return _brightness(bright) * scale / bright if bright > 0.0 else 0.0


def _mean(environment: Environment) -> tuple[NDArray[np.float64], float]:
    """Mean radiance (3,) over all directions, not negative, and its luminance."""
    mean = np.maximum(np.asarray(environment.sh(1)[0], np.float64) / math.sqrt(4.0 * math.pi), 0.0)
    return mean, float(luminance(mean))


def _brightness(bright: float) -> float:
    """How bright an environment is taken for, beside white, of which the mean luminance is `bright`."""
    return min(max(bright, LEAST), MOST)
