"""Reflectance and roughness of each patch: the share of the captured light's reflection that its pixels show."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats

from ..sh import harmonics
from .fits import BANDS, PatchFits
from .ggx import zonal_factors

ALPHAS = np.geomspace(0.05, 0.65, 12)
"""GGX roughness that is distinguished. Degree 3 shows little between the first two; a noisy normal looks rough."""

DEGREE = harmonics.degrees_and_orders(BANDS)[0][1:]


@lru_cache(1)
def roughness_factors() -> NDArray[np.float64]:
    """(A, K) factor of each roughness on each coefficient but the mean."""
    found = np.array([zonal_factors(alpha, BANDS)[DEGREE] for alpha in ALPHAS])
    found.setflags(write=False)
    return found


LEAST_EXPLAINED, SURE_EXPLAINED = 0.05, 0.2
"""Of what depends on the view in a patch, the share that the reflected light must explain, each half of its places
judged by the other; and the share in SURE_PATCHES curved patches without which nothing in a scene is glossy. Chosen on
one trained table of glazed and metal objects (`scripts/bench gloss`); matte patches of five generated tables explain
up to .02, .01, .07, .12 and .43."""

SURE_PATCHES = 2
"""Patches of which the light fitted to one half of the places must explain SURE_EXPLAINED of the other half: matte
trained objects had at most one, with .13 and .14 in two of them, a trained glossy table has .41 in its second."""


class Gloss(NamedTuple):
    """The reflecting materials of M nodes. reflectance: (M, 3) at normal incidence, 0 without reflection: as far as the
    lobe follows what is seen, so that noise of the normals makes it weak. alpha: (M,) GGX roughness, that of the noise
    of the normals included. flat: (M,) bool, whether it does not rise at grazing angles. explained: (M,) share of the
    view-dependent part that the reflection explains, its confidence."""

    reflectance: NDArray[np.float32]
    alpha: NDArray[np.float32]
    flat: NDArray[np.bool_]
    explained: NDArray[np.float32]

    @property
    def glossy(self) -> NDArray[np.bool_]:
        """(M,) bool: whether anything is reflected."""
        return np.asarray(self.reflectance.any(axis=1))


def materials(fits: PatchFits, light: Floats) -> Gloss | None:
    """The Gloss of a surface under the light of the capture; None where it is matte.

    light: (K, 3) or more, its SH coefficients in the frame of the scene and in the unit of the captured colours.
    """
    whole_light = np.asarray(light, np.float64)[: BANDS**2]
    count = len(fits.pixels)
    reflectance, explained = np.zeros((count, 3)), np.zeros(count)
    alpha, flat = np.zeros(count), np.zeros(count, bool)
    for patch in range(count):
        if not fits.pixels[patch]:
            continue
        found = best_lobe(fits, patch, whole_light)
        explained[patch], reflectance[patch], alpha[patch], flat[patch] = found
    dull = (explained < LEAST_EXPLAINED) | ~reflectance.any(axis=1)
    if np.count_nonzero((explained > SURE_EXPLAINED) & fits.informative & ~dull) < SURE_PATCHES:
        return None
    reflectance[dull] = 0.0
    of = fits.patch
    return Gloss(
        np.minimum(reflectance, 1.0)[of].astype(np.float32),
        alpha[of].astype(np.float32),
        flat[of],
        explained[of].astype(np.float32),
    )


class Lobe(NamedTuple):
    """The lobe of a patch: the share that it explains, (3,) reflectance, GGX alpha, and whether it does not rise at
    grazing angles."""

    explained: float
    reflectance: NDArray[np.float64]
    alpha: float
    flat: bool


def best_lobe(fits: PatchFits, patch: int, light: Floats) -> Lobe:
    """The Lobe that explains most of a patch under a light (K, 3), K = BANDS^2, half by half."""
    gain, factor, flat = -np.inf, 0, False
    reflectance, total = np.zeros(3), max(float(fits.power[patch].sum()), 1e-30)
    for kind in (False, True):
        gram, moments = fits.gram[patch, :, int(kind)], fits.moments[patch, :, int(kind)]
        for number, factors in enumerate(roughness_factors()):
            shape = factors[:, None] * light[1:]
            along = np.einsum("kc,hkc->hc", shape, moments)
            square = np.einsum("kc,hkl,lc->hc", shape, gram, shape)
            each = np.maximum(along / np.maximum(square, 1e-30), 0.0)[::-1]  # of the other half
            found = float((2 * each * along - each**2 * square).sum()) / total
            if found > gain:
                reflectance = np.maximum(along.sum(axis=0) / np.maximum(square.sum(axis=0), 1e-30), 0.0)
                gain, factor, flat = found, number, kind
    return Lobe(gain, reflectance, float(ALPHAS[factor]), flat)
