"""Keys of cached transfers, which cached ones serve for others, and their arrays."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Transfer

from .receivers import Receivers
from .settings import Settings
from .store import array_key

SURFACES = "surfaces"
"""Instead of the key of a Foliage."""

Key: TypeAlias = tuple[str, int, int, str, int, str]
"""The key of a transfer: method, bands, rays, chunks with shadows, seed, leaves."""


def key_of(settings: tuple[Any, ...]) -> Key | None:
    """The key that a transfer was kept under, or None for what is none."""
    types = tuple(map(type, settings))
    return settings if types == (str, int, int, str, int, str) else None


def serves(key: Key, settings: Settings, leaves: str) -> bool:
    """Whether the transfer of a key is as good as that of the settings, or better."""
    method, chunks = settings.method.replace("-", "_"), chunks_text(settings.shadowed)
    return stands_for(key, (method, settings.bands, settings.rays, chunks, key[4], leaves))


def stands_for(key: Key, other: Key) -> bool:
    """Whether the transfer of a key serves wherever that of another does."""
    method, bands, rays, chunks, seed, leaves = key
    same = (method, seed) == (other[0], other[4]) and chunks in ("all", other[3])
    return same and bands >= other[1] and rays >= other[2] and leaves == other[5]


def chunks_text(shadowed: Sequence[bool] | None) -> str:
    """The chunks with shadows as text for a file's name."""
    if shadowed is None:
        return "all"
    return array_key(np.array(shadowed))


def arrays_of(transfer: Transfer, receivers: Receivers) -> dict[str, NDArray[Any]]:
    """Dict of the arrays to keep of a transfer: its traced rows, from which the others follow."""
    return {"transfer": transfer if receivers.all else transfer[receivers.rows]}


def restored(kept: Mapping[str, NDArray[Any]], bands: int, receivers: Receivers) -> Transfer:
    """The transfer of `arrays_of`. Raises ValueError for another shape or type, and unless it is finite."""
    found, shape = kept["transfer"], (len(receivers.rows), bands**2)
    if found.shape != shape or found.dtype != np.float32 or not np.isfinite(found).all():
        raise ValueError(f"expected finite numbers of shape {shape}, found {found.dtype} of {found.shape}")
    if receivers.all:
        return found
    transfer = np.empty((len(receivers.traced), shape[1]), np.float32)
    transfer[receivers.rows] = found
    return receivers.filled(transfer)
