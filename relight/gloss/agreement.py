"""Whether anything in a splat may be glossy: half of a patch's places predicts what the other half shows."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats

from .fits import PatchFits
from .material import DEGREE, GLOSS

START_RIDGE = 0.03 + 0.006 * DEGREE**2

HINTS = 2
"""Patches of which the light fitted to one half of the places must explain GLOSS.sure_explained of the other half, for
more pictures to be worth their time: .41 in the second patch of a trained glossy table, .13 and .14 of two matt trained
objects."""


def hints_at_gloss(fits: PatchFits) -> bool:
    """Whether anything may be glossy at all."""
    rows = np.flatnonzero(fits.informative)
    alone = _alone(fits.gram[rows][:, :, 0], fits.moments[rows][:, :, 0], fits.power[rows].sum(axis=(1, 2)))
    return bool(np.count_nonzero(alone > GLOSS.sure_explained) >= HINTS)


def _alone(gram: NDArray[np.float64], moments: NDArray[np.float64], power: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) how much of each half of a patch's places the light fitted to the other half explains."""
    gain = np.zeros(len(gram))
    for patch in range(len(gram)):
        for half in range(2):
            light = _solved(gram[patch, half], moments[patch, half], START_RIDGE)
            other = 1 - half
            gain[patch] += 2 * (light * moments[patch, other]).sum() - (light * (gram[patch, other] @ light)).sum()
    return gain / np.maximum(power, 1e-30)


def _solved(gram: NDArray[np.float64], moments: NDArray[np.float64], ridge: Floats) -> NDArray[np.float64]:
    """Coefficients (K, 3) of least squares, held by a ridge that is relative to the mean of the diagonal."""
    held = gram + np.diag(ridge * max(float(np.trace(gram)) / len(gram), 1e-30))
    return np.asarray(np.linalg.solve(held, moments), np.float64)
