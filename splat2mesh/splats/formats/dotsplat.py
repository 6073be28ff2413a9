"""The `.splat` file of antimatter15's viewer: 32 bytes a splat, no header, no view-dependent colour.

Source: github.com/antimatter15/splat (position and scale float32, colour RGBA and quaternion wxyz as bytes).
"""

import os
import warnings

import numpy as np

from ...base.errors import DataWarning, InputError
from ...base.threads import ROWS_AT_ONCE
from ..splats import ABSURD_LENGTH, Splats
from .encoding import sh_from_color

_RECORD = np.dtype([("mean", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("quat_wxyz", "u1", 4)])


def read(path: str | os.PathLike[str]) -> Splats:
    """Read a `.splat` file. Returns Splats without harmonics. Raises InputError when it cannot be one. Warns with a
    DataWarning about half a record at the end."""
    count, extra = divmod(os.path.getsize(path), _RECORD.itemsize)
    if count == 0:
        raise InputError(f"{path} is cut short: a .splat record takes {_RECORD.itemsize} bytes, found {extra}")
    if extra:
        warnings.warn(f"{path}: ignored {extra} bytes after the last whole record", DataWarning, stacklevel=2)
    records = np.memmap(path, _RECORD, "r", shape=(count,))
    quats = (records["quat_wxyz"].astype(np.float32) - 128) / 128
    # The format has no mark of its own, and quaternions of any length are in use, but no scale is negative.
    some = np.array(records[:: 1 + count // ROWS_AT_ONCE])
    likely = (np.abs(some["mean"]) <= ABSURD_LENGTH) & (some["scale"] >= 0) & (some["scale"] <= ABSURD_LENGTH)
    if np.count_nonzero(likely.all(axis=1)) < len(some) / 2:
        raise InputError(f"{path} is not a .splat file: most of its records hold no place and no size")
    rgba = records["rgba"] / np.float32(255)
    return Splats(records["mean"], records["scale"], quats, rgba[:, 3], sh_from_color(rgba[:, None, :3]))
