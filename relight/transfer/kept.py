"""Keys of cached transfers, which cached ones serve for others, and their arrays."""

from collections.abc import Mapping
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Transfer

from .receivers import Receivers
from .settings import Settings

SURFACES = "surfaces"
"""Instead of the key of a Foliage."""

Key: TypeAlias = tuple[str, int, int, int, str]
"""The key of a transfer: method, bands, rays, seed, leaves."""


def key_of(settings: tuple[Any, ...]) -> Key | None:
    """The key that a transfer was kept under, or None for what is none."""
    types = tuple(map(type, settings))
    return settings if types == (str, int, int, int, str) else None


def serves(key: Key, settings: Settings, leaves: str) -> bool:
    """Whether the transfer of a key is as good as that of the settings, or better."""
    return stands_for(key, (settings.method.replace("-", "_"), settings.bands, settings.rays, key[3], leaves))


def stands_for(key: Key, other: Key) -> bool:
    """Whether the transfer of a key serves wherever that of another does."""
    method, bands, rays, *scene = key
    return method == other[0] and bands >= other[1] and rays >= other[2] and scene == [*other[3:]]


def restored(kept: Mapping[str, NDArray[Any]], bands: int, receivers: Receivers) -> Transfer:
    """The transfer whose traced rows were kept. Raises ValueError for another shape or type, and if not finite."""
    found, shape = kept["transfer"], (len(receivers.rows), bands**2)
    if found.shape != shape or found.dtype != np.float32 or not np.isfinite(found).all():
        raise ValueError(f"expected finite numbers of shape {shape}, found {found.dtype} of {found.shape}")
    if receivers.all:
        return found
    transfer = np.empty((len(receivers.traced), shape[1]), np.float32)
    transfer[receivers.rows] = found
    return receivers.filled(transfer)
