"""The light of a session beside its environment: the kept part of the captured light, and placed lamps."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Received = Callable[[NDArray[np.float32], float], NDArray[np.floating]]


class SessionMixture(NamedTuple):
    """New light of several parts, as in `engine.mixing`. A session changes only the environment.

    radiance, received: (V, 3) float32, exit radiance and irradiance over pi of all parts but the environment, in its
    unit. env_scale: factor on the environment. level: units of the picture per unit of the environment. backdrop:
    factor on the visible light itself. keeps_sky: whether the sky is that of the capture, only dimmed. captured: factor
    on the captured light.
    """

    radiance: NDArray[np.float32]
    received: NDArray[np.float32]
    env_scale: float
    level: float
    backdrop: float
    keeps_sky: bool
    captured: float = 0.0

    def with_environment(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the radiance (V, 3) of all parts. radiance: of the environment."""
        return np.asarray(self.radiance + np.float32(self.env_scale) * radiance, np.float32)

    def receives(self, received: Received) -> Received:
        """Return a function for the irradiance of all parts. received: that of the environment alone, as in a
        SplatLook."""

        def mixed(radiance: NDArray[np.float32], exposure: float) -> NDArray[np.floating]:
            if not (radiance.any() and self.env_scale > 0.0):
                return self.received
            return self.received + np.float32(self.env_scale) * received(radiance, self.level)

        return mixed
