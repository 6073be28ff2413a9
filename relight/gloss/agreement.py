"""Whether anything in a splat may be glossy: half of a patch's places predicts what the other half shows."""

import numpy as np
from numpy.typing import NDArray

from .fits import PatchFits
from .harmonicsfit import RIDGE
from .material import SURE_EXPLAINED, SURE_PATCHES


def hints_at_gloss(fits: PatchFits) -> bool:
    """Whether anything may be glossy at all."""
    rows = np.flatnonzero(fits.informative)
    alone = _alone(fits.gram[rows][:, :, 0], fits.moments[rows][:, :, 0], fits.power[rows].sum(axis=(1, 2)))
    return bool(np.count_nonzero(alone > SURE_EXPLAINED) >= SURE_PATCHES)


def _alone(gram: NDArray[np.float64], moments: NDArray[np.float64], power: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) how much of each half of a patch's places the light fitted to the other half explains."""
    gain = np.zeros(len(gram))
    for patch in range(len(gram)):
        for half in range(2):
            light = _solved(gram[patch, half], moments[patch, half])
            other = 1 - half
            gain[patch] += 2 * (light * moments[patch, other]).sum() - (light * (gram[patch, other] @ light)).sum()
    return gain / np.maximum(power, 1e-30)


def _solved(gram: NDArray[np.float64], moments: NDArray[np.float64]) -> NDArray[np.float64]:
    """Coefficients (K, 3) of least squares, held by a ridge that is relative to the mean of the diagonal."""
    held = gram + RIDGE * max(float(np.trace(gram)) / len(gram), 1e-30) * np.eye(len(gram))
    return np.asarray(np.linalg.solve(held, moments), np.float64)
