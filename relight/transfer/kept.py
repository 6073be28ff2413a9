"""Keys of cached transfers, which cached ones serve for others, and their format: 16 bits a number."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Transfer
from splat2mesh.base.threads import in_batches

from .receivers import Receivers
from .settings import Settings
from .store import array_key

SURFACES = "surfaces"
"""Instead of the key of a Foliage."""

OPEN = np.float32(1.0 / math.sqrt(4.0 * math.pi))
"""The first coefficient of a vertex that nothing hides. None is larger than 1.16 of it but by what few rays are off."""

STEPS = 24_000
"""Of OPEN: numbers are whole steps, so that what nothing hides stays exact, and all else is off by 3e-6 (root mean
square): a thousandth of what hundreds of rays leave."""

LARGE = 1 << 22
"""Numbers above which a transfer is rounded: smaller ones take 16 MB at most."""


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
    return same and bands >= other[1] and rays >= other[2] and _as_leafy(leaves, other[5])


def leaf_directions(key: Key) -> int:
    """From how many directions light comes to leaves, as the key of a transfer says; 0 where they are surfaces."""
    count = key[5].split("x")[-1]
    return int(count) if count.isdigit() else 0


def _as_leafy(kept: str, wanted: str) -> bool:
    """Whether leaves of so many directions, as `Precomputed._leaves` writes them, serve for others."""
    (*known, count), (*names, least) = kept.split("x"), wanted.split("x")
    if count.isdigit() and least.isdigit():
        return known == names and int(count) >= int(least)
    return kept == wanted


def chunks_text(shadowed: Sequence[bool] | None) -> str:
    """The chunks with shadows as text for a file's name."""
    if shadowed is None:
        return "all"
    return array_key(np.array(shadowed))


def rounded(transfer: Transfer) -> Transfer:
    """A transfer (V, K), in place; a large one rounded to what is kept of it, so that it comes back to the bit."""
    if transfer.size >= LARGE:

        def work(rows: slice) -> None:
            transfer[rows] = _numbers(_steps(transfer[rows]))

        in_batches(work, len(transfer))
    return transfer


def arrays_of(transfer: Transfer, receivers: Receivers) -> dict[str, NDArray[Any]]:
    """Dict of the arrays to keep of a transfer that was `rounded`: its traced rows, from which the others follow."""
    rows = slice(None) if receivers.all else receivers.rows
    if transfer.size < LARGE:
        return {"transfer": transfer[rows]}
    steps = np.empty((len(transfer) if receivers.all else len(receivers.rows), transfer.shape[1]), np.int16)

    def work(part: slice) -> None:
        steps[part] = _steps(transfer[part] if receivers.all else transfer[receivers.rows[part]])

    in_batches(work, len(steps))
    return {"transfer": steps}


def restored(kept: Mapping[str, NDArray[Any]], bands: int, receivers: Receivers) -> Transfer:
    """The transfer of `arrays_of`. Raises ValueError for another shape or type, and unless it is finite."""
    found, shape = kept["transfer"], (len(receivers.rows), bands**2)
    if found.shape != shape or found.dtype not in (np.float32, np.int16) or not np.isfinite(found).all():
        raise ValueError(f"expected finite numbers of shape {shape}, found {found.dtype} of {found.shape}")
    if receivers.all and found.dtype == np.float32:
        return found
    transfer = np.empty((len(receivers.traced), shape[1]), np.float32)

    def work(part: slice) -> None:
        some = _numbers(found[part]) if found.dtype == np.int16 else found[part]
        transfer[part if receivers.all else receivers.rows[part]] = some

    in_batches(work, len(found))
    return receivers.filled(transfer)


def _steps(numbers: NDArray[np.float32]) -> NDArray[np.int16]:
    most = np.float32(np.iinfo(np.int16).max)
    return np.clip(np.rint(numbers / OPEN * np.float32(STEPS)), -most, most).astype(np.int16)


def _numbers(steps: NDArray[np.int16]) -> NDArray[np.float32]:
    return steps.astype(np.float32) / np.float32(STEPS) * OPEN
