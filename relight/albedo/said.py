"""What a person says of the light that a scene was captured in."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

from ..light import CAPTURED_SKIES

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

    @classmethod
    def read(
        cls, sun: Sequence[float] | None, sky: Any, light: Any, folder: str | os.PathLike[str] | None = None
    ) -> "Said":
        """Return what the `captured_sun`, `captured_sky` and `captured_light` of LightingOptions say.

        folder: of the scene, for lights that an estimate offered there. Raises InputError for what cannot be read.
        """
        from ..light.captured_light import known_light
        from ..light.loading import light_of

        if sky is not None and sky not in CAPTURED_SKIES and not hasattr(sky, "radiance"):
            if not os.path.lexists(sky):
                kinds = ", ".join(CAPTURED_SKIES)
                raise InputError(f"`captured_sky` {sky}: expected {kinds}, or a file of light; no such file")
            sky = light_of(sky)
        return cls(None if sun is None else np.asarray(sun, np.float64), sky, known_light(light, folder))

    @property
    def key(self) -> list[NDArray[Any]]:
        """Arrays that identify the sun and the sky, for a cache; none where nothing is said of them."""
        if self.sun is None and self.sky is None:
            return []
        sun = np.zeros(0) if self.sun is None else self.sun
        if self.sky is None or isinstance(self.sky, str):
            return [sun, np.array(self.sky or "unknown")]
        return [sun, self.sky.radiance, np.array(self.sky.rotation_deg)]
