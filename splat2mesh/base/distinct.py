"""Whole numbers, each once."""

import numpy as np
from numpy.typing import NDArray


def distinct(keys: NDArray[np.integer]) -> NDArray[np.integer]:
    """The values of (N,) integers, sorted, each once: as np.unique, which hashes them in NumPy 2.4 and takes thirty to
    eighty times as long over millions."""
    keys = np.sort(keys)
    return keys[np.append(True, keys[1:] != keys[:-1])[: len(keys)]]
