"""Whole numbers for the cells of a lattice."""

import numpy as np
from numpy.typing import NDArray

from .arrays import Indices, Integers

CELLS = 2**20
"""Cells along each axis that keys distinguish, half of them on either side of the origin: three such numbers, and what
distinguishes a few things within a cell, are less than 2**63."""


def keys_of(cells: Integers) -> Indices:
    """The key of each cell (N, 3), in [-CELLS / 2, CELLS / 2): (N,), in the order of their numbers."""
    x, y, z = (cells.astype(np.int64) + CELLS // 2).T
    return (x * CELLS + y) * CELLS + z


def cells_of(keys: Integers) -> NDArray[np.int32]:
    """The cells (N, 3) of keys (N,)."""
    columns = keys // CELLS**2, keys // CELLS % CELLS, keys % CELLS
    return (np.stack(columns, axis=1) - CELLS // 2).astype(np.int32)
