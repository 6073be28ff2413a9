"""The light that glossy patches agree on: their reflections are the same light, blurred by each roughness.

Patches of one place see one light. So the coefficients of patch k are F_k a_l(alpha_k) L_lm: one light L for all, found
in turn with the strength and roughness of each patch, up to its scale.
"""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.scene.color import luminance

from .fits import PatchFits
from .material import DEGREE, roughness_factors

TURNS = 30

RIDGE = 0.003 * (1.0 + 0.1 * DEGREE**2)
START_RIDGE = 0.03 + 0.006 * DEGREE**2

LEAST_PATCHES, LEAST_EXPLAINED = 3, 0.2
"""Patches that must agree on a light, each explaining so much of its other half."""


HINT, HINTS = 0.2, 2
"""How much of one half of a patch's places the light fitted to the other half explains, and in how many patches, for
more pictures to be worth their time: .41 in the second patch of a trained glossy table, .13 and .14 of two matt trained
objects."""


def hints_at_gloss(fits: PatchFits) -> bool:
    """Whether anything may be glossy at all."""
    rows = np.flatnonzero(fits.informative)
    alone = _alone(fits.gram[rows][:, :, 0], fits.moments[rows][:, :, 0], fits.power[rows].sum(axis=(1, 2)))
    return bool(np.count_nonzero(alone > HINT) >= HINTS)


def reflected_light(fits: PatchFits) -> NDArray[np.float64] | None:
    """The shape of the captured light that reflections show; None where too few patches agree on one.

    Returns (K,) SH coefficients of its luminance, K = BANDS^2 of `fits`, frame of the scene, scale unknown, mean 0.
    """
    rows = np.flatnonzero(fits.informative)
    if len(rows) < LEAST_PATCHES:
        return None
    gram, moments = fits.gram[rows][:, :, 0], fits.moments[rows][:, :, 0]
    power = fits.power[rows].sum(axis=(1, 2))
    found = _agreed(gram.sum(axis=1), moments.sum(axis=1), power, fits.pixels[rows], _alone(gram, moments, power))
    if found is None:
        return None
    light, strength, factor = found
    # Each half of the places is judged with the strength of the other half.
    shape = roughness_factors()[factor][:, :, None] * light
    along = np.einsum("pkc,phkc->ph", shape, moments)
    square = np.einsum("pkc,phkl,plc->ph", shape, gram, shape)
    each = np.maximum(along / np.maximum(square, 1e-30), 0.0)[:, ::-1]
    explained = (2 * each * along - each**2 * square).sum(axis=1) / np.maximum(power, 1e-30)
    if np.count_nonzero((explained > LEAST_EXPLAINED) & (strength > 0.0)) < LEAST_PATCHES:
        return None
    return np.append(0.0, np.asarray(luminance(light), np.float64))


def _alone(gram: NDArray[np.float64], moments: NDArray[np.float64], power: NDArray[np.float64]) -> NDArray[np.float64]:
    """(P,) how much of each half of a patch's places the light fitted to the other half explains."""
    gain = np.zeros(len(gram))
    for patch in range(len(gram)):
        for half in range(2):
            light = _solved(gram[patch, half], moments[patch, half], START_RIDGE)
            other = 1 - half
            gain[patch] += 2 * (light * moments[patch, other]).sum() - (light * (gram[patch, other] @ light)).sum()
    return gain / np.maximum(power, 1e-30)


def _agreed(
    gram: NDArray[np.float64],
    moments: NDArray[np.float64],
    power: NDArray[np.float64],
    count: NDArray[np.int64],
    alone: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]] | None:
    """(light (K, 3), strength (P,), number of the roughness (P,)), in turn, from the patch that shows most."""
    first = int((alone * np.sqrt(count)).argmax())
    if alone[first] <= 0.0:
        return None
    light = _solved(gram[first], moments[first], START_RIDGE)
    strength, factor = np.zeros(len(gram)), np.zeros(len(gram), np.int64)
    for _ in range(TURNS):
        shape = roughness_factors()[:, :, None] * light
        along = np.einsum("akc,pkc->pa", shape, moments)
        square = np.einsum("akc,pkl,alc->pa", shape, gram, shape)
        strengths = np.maximum(along / np.maximum(square, 1e-30), 0.0)
        gain = 2 * strengths * along - strengths**2 * square
        factor = gain.argmax(axis=1)
        rows = np.arange(len(gram))
        strength, explained = strengths[rows, factor], gain[rows, factor] / np.maximum(power, 1e-30)
        useful = (strength > 0.0) & (explained > 0.01)
        if not useful.any():
            return None
        noise = power[useful] * (1.0 - explained[useful]) / count[useful]
        scaled = roughness_factors()[factor[useful]] * strength[useful, None]
        whole = np.einsum("p,pk,pkl,pl->kl", 1.0 / noise, scaled, gram[useful], scaled)
        total = np.einsum("p,pk,pkc->kc", 1.0 / noise, scaled, moments[useful])
        new = _solved(whole, total, RIDGE)
        light = new * np.linalg.norm(light) / max(float(np.linalg.norm(new)), 1e-30)
    return light, strength, factor


def _solved(gram: NDArray[np.float64], moments: NDArray[np.float64], ridge: Floats) -> NDArray[np.float64]:
    """Coefficients (K, 3) of least squares, held by a ridge that is relative to the mean of the diagonal."""
    held = gram + np.diag(ridge * max(float(np.trace(gram)) / len(gram), 1e-30))
    return np.asarray(np.linalg.solve(held, moments), np.float64)
