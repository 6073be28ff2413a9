"""Quantiles of weighted values."""

import numpy as np

from .arrays import Floats


def weighted_quantile(values: Floats, weights: Floats, part: float = 0.5) -> float:
    """The least of the values (N,), N > 0, up to which their weights (N,) reach this part of their sum, the median by
    default; NaN counts as infinite. The same in any order, but for the rounding of the sum."""
    ordered = np.where(np.isnan(values), np.inf, values).astype(np.float64)
    return float(np.quantile(ordered, part, weights=np.asarray(weights, np.float64), method="inverted_cdf"))
