"""Axes about which a light turns, without NumPy, which a command line does without until it has work."""

import math
from collections.abc import Sequence

from splat2mesh.base.errors import InputError


def check_axis(axis: Sequence[float]) -> tuple[float, float, float]:
    """Return the three numbers of an axis. Raises InputError unless they are finite and not all 0."""
    found = [float(each) for each in axis]
    if len(found) != 3 or not all(map(math.isfinite, found)) or not any(found):
        raise InputError(f"an axis must be three finite numbers, not all 0, found {', '.join(f'{x:g}' for x in found)}")
    return found[0], found[1], found[2]
