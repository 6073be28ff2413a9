"""relight.gloss: materials and the captured light from what pixels show, of balls whose gloss is known."""

import numpy as np
import pytest

from relight.gloss.fits import BANDS, KINDS, PatchFits, _sums
from relight.gloss.ggx import fresnel_rise, zonal_factors
from relight.gloss.material import ALPHAS, SURE_PATCHES, materials
from relight.sh import harmonics
from splat2mesh.base.errors import InputError

SIZE = BANDS**2 - 1
DEGREE, _ = harmonics.degrees_and_orders(BANDS)


def light_of(seed):
    """(K, 3) SH coefficients of a light that is strongest in its first degrees, mean 1."""
    rng = np.random.default_rng(seed)
    light = rng.normal(size=(BANDS**2, 3)) / (1.0 + DEGREE[:, None])
    light[0] = np.sqrt(4 * np.pi)
    return light


def shown(light, reflectance, alpha, metal, noise, seed, places=400, views=12):
    """Sums of the pixels of a ball under a light: (gram, moments, power), and how many pixels."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(places, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    toward = normals[:, None] + 0.9 * rng.normal(size=(places, views, 3))
    toward /= np.linalg.norm(toward, axis=2, keepdims=True)
    cosine = np.einsum("pk,pvk->pv", normals, toward)
    place, view = np.nonzero(cosine > 0.2)
    cosine, toward = cosine[place, view], toward[place, view]
    mirrored = 2 * cosine[:, None] * normals[place] - toward
    lobe = harmonics.evaluate(mirrored, BANDS) @ (zonal_factors(alpha, BANDS)[DEGREE][:, None] * light)
    diffuse = rng.uniform(0.1, 0.6, (places, 3)) * (not metal)
    color = diffuse[place] + reflectance * fresnel_rise(cosine, np.full(len(cosine), metal))[:, None] * lobe
    color += noise * rng.normal(size=color.shape)
    return _sums(place.astype(np.int32), color, mirrored, cosine), len(place)


def fits_of(light, kinds, noise=0.01, curved=0.5):
    """PatchFits with a patch for each (reflectance, alpha, metal)."""
    found = [shown(light, *kind, noise, number) for number, kind in enumerate(kinds)]
    gram, moments, power = (np.array([each[0][i] for each in found]) for i in range(3))
    pixels = np.array([each[1] for each in found])
    flat = np.full(len(kinds), curved)
    return PatchFits(np.arange(len(kinds), dtype=np.int32), gram, moments, power, pixels, flat)


GLAZE, RUBBED, GOLD, MATTE = (0.04, 0.1, False), (0.04, 0.3, False), (0.8, 0.2, True), (0.0, 0.3, False)


@pytest.mark.parametrize("seed", range(3))
def test_reflectance_and_roughness_are_those_that_were_shown(seed):
    light = light_of(seed)
    kinds = [GLAZE, RUBBED, (0.04, 0.5, False), GOLD, (0.5, 0.4, True), MATTE]
    found = materials(fits_of(light, kinds), light)
    for number, (reflectance, alpha, metal) in enumerate(kinds[:-1]):
        # Pixels have noise of .01, and the gloss of the plastics a spread of about .03.
        np.testing.assert_allclose(found.reflectance[number], reflectance, rtol=0.12)
        step = abs(np.log(found.alpha[number] / alpha))
        assert step < np.log(1.6), (found.alpha[number], alpha)
        assert found.flat[number] == metal
    assert not found.reflectance[-1].any() and found.explained[-1] < 0.005
    np.testing.assert_array_equal(found.glossy, [True] * 5 + [False])


def test_a_matte_scene_has_no_gloss():
    light = light_of(2)
    assert materials(fits_of(light, [MATTE] * 8, noise=0.03), light) is None


def test_one_glossy_patch_may_be_chance_and_two_are_gloss():
    light = light_of(3)
    assert SURE_PATCHES == 2
    assert materials(fits_of(light, [GLAZE, MATTE, MATTE]), light) is None
    assert materials(fits_of(light, [GLAZE, GLAZE, MATTE]), light).glossy.tolist() == [True] * 2 + [False]


def test_a_plane_shows_nothing_for_sure():
    light = light_of(4)
    assert materials(fits_of(light, [GLAZE] * 4, curved=0.003), light) is None


def test_sums_are_restored_and_damaged_ones_are_refused():
    fits = fits_of(light_of(0), [GLAZE, MATTE])
    for one, other in zip(PatchFits.restored(fits._asdict()), fits, strict=True):
        np.testing.assert_array_equal(one, other)
    for name, value in [
        ("gram", np.zeros((2, 2, KINDS, SIZE, 3))),
        ("moments", np.full_like(fits.moments, np.nan)),
        ("patch", np.array([0, 7], np.int32)),
    ]:
        with pytest.raises(InputError, match="kept reflections"):
            PatchFits.restored(fits._asdict() | {name: value})
    with pytest.raises(KeyError):
        PatchFits.restored({})


def test_distinct_roughnesses_differ_in_their_blur():
    factors = np.array([zonal_factors(alpha, BANDS)[1:] for alpha in ALPHAS])
    assert (np.diff(factors, axis=0) < -1e-3).all()
