"""A mix of lights: an environment, the part of the captured light that stays, and placed lamps."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .appearance import Appearance
from .placed import Placed
from .relighter import Shading


class CapturedPart(NamedTuple):
    """The captured light that stays. colors: (V, 3) float32, the captured colours under it, with lamps as in the
    options. factor: its dimming."""

    colors: NDArray[np.float32]
    factor: float


def mixed(
    look: Appearance,
    environment: Shading,
    env_scale: float,
    captured: CapturedPart,
    placed: Placed | None,
    level: float,
) -> Shading:
    """Return the Shading of all parts together, in the unit of the environment.

    Parameters
    ----------
    look : Appearance
    environment : Shading
        Under the environment alone; black without one.
    env_scale : float
        Factor on it.
    captured : CapturedPart
    placed : Placed, optional
        What placed lamps do, in units of the picture.
    level : float
        Units of the picture per unit of the environment.

    Notes
    -----
    What receives k E of the captured light E and L of lamps sends out c (k E + L) / E = k c + a L: the captured colour
    c keeps its gloss and its detail, and only the new light needs the albedo a.
    """
    kept = np.float32(captured.factor) * captured.colors
    # The captured light at each vertex after switching: unchanged to the bit if nothing was switched off.
    change = np.divide(captured.colors, look.captured, out=np.ones_like(look.captured), where=look.captured > 0.0)
    share = np.float32(captured.factor) * change * look.irradiance
    if placed is not None:
        kept, share = kept + placed.radiance, share + placed.received
    radiance, received = kept / np.float32(level), share / np.float32(level)
    if environment.radiance.any() and env_scale > 0.0:
        radiance = radiance + np.float32(env_scale) * environment.radiance
        received = received + np.float32(env_scale) * look.received(environment.radiance, level)
    bounces = environment.bounces or (placed.bounces if placed is not None else [])
    return environment._replace(
        radiance=radiance.astype(np.float32), received=received.astype(np.float32), bounces=bounces
    )
