"""A light as applied: coefficients for the transfer and separate suns, computed once for an image."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..light.environment import Environment, Suns, turned_about_y
from ..light.sun_split import split
from .settings import Settings
from .store import Cache, array_key


def image_key(environment: Environment) -> str:
    """Short text that differs for any two images; the same for all rotations of one."""
    return environment.derived("key", lambda: array_key(environment.radiance))


def _checked(kept: Mapping[str, NDArray[Any]], bands: int) -> Mapping[str, NDArray[Any]]:
    """A light from its cached arrays. Raises ValueError where its arrays do not fit each other or are not finite."""
    directions, weights = kept["directions"], kept["weights"]
    fits = kept["coefficients"].shape == (bands**2, 3) and directions.shape == weights.shape == (len(directions), 3)
    if not (fits and all(each.dtype.kind == "f" and np.isfinite(each).all() for each in kept.values())):
        raise ValueError("a light of another kind")
    return kept


def split_light(environment: Environment, settings: Settings, cache: Cache) -> tuple[NDArray[np.float32], Suns]:
    """(coefficients, suns) of an environment as turned: (K, 3) float32 for a transfer of `settings.bands`, and Suns.

    Suns are those for all bands, whatever the transfer has. They take a tenth of a second to find; so they are kept
    with the environment, and in the Cache for the next run.
    """
    bands, tolerance = settings.bands, settings.sun_tolerance

    def found() -> tuple[NDArray[np.float64], Suns]:
        name = image_key(environment), bands, f"{tolerance:g}"
        kept = cache.restored(lambda arrays: _checked(arrays, bands), "suns", *name)
        if kept is None:
            whole = environment.rotated(-environment.rotation_deg)
            rest, suns = split(whole, tolerance=tolerance) if tolerance else (whole, Suns.none())
            kept = {"coefficients": rest.sh(bands), "directions": suns.directions, "weights": suns.weights}
            if tolerance:
                cache.put("suns", *name, **kept)
        return kept["coefficients"], Suns(kept["directions"], kept["weights"])

    coefficients, suns = environment.derived(("light", bands, tolerance), found)
    turned = environment.rotation_deg
    return turned_about_y(coefficients, turned).astype(np.float32), suns.rotated(turned) if turned else suns
