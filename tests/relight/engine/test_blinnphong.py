"""Blinn-Phong: the furnace, Lambert's law, the highlight's place and energy."""

import numpy as np
import pytest

from relight import Environment
from relight.engine.blinnphong import blinn_phong, lamps
from relight.light.projections import row_solid_angles
from relight.light.suns import Suns
from splat2mesh.base.errors import InputError

NO_SUNS = Suns(np.zeros((0, 3)), np.zeros((0, 3)))


def unit(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


@pytest.mark.parametrize("specular", [0.0, 0.5])
def test_constant_sky_gives_one(specular):
    normals = unit(100)
    options = {"vertices": unit(100, 1), "eye": (3.0, 2.0, 1.0), "specular": specular}
    radiance = blinn_phong(normals, Environment(np.ones((16, 32, 3))), **options)
    assert radiance.dtype == np.float32
    np.testing.assert_allclose(radiance, 1.0, rtol=1e-6)


def test_one_lamp_is_lamberts_law_on_top_of_the_ambient():
    normals, toward = unit(200), unit(1, 3)
    lamp = Suns(toward, np.array([[3.0, 2.0, 1.0]]))
    expected = [0.1, 0.2, 0.3] + np.maximum(normals @ toward.T, 0) * lamp.weights / np.pi
    np.testing.assert_allclose(blinn_phong(normals * 7, (np.array([0.1, 0.2, 0.3]), lamp)), expected, rtol=1e-5)


@pytest.mark.parametrize("name", ["noon", "studio", "overcast"])
def test_lamps_hold_all_the_energy(name):
    environment = Environment.load(name).rotated(30.0)
    ambient, suns = lamps(environment, 8)
    assert len(suns) <= 8 and (ambient > 0).all()
    image = environment.radiance.astype(np.float64)
    total = (image * row_solid_angles(*image.shape[:2])[..., None]).sum(axis=(0, 1))
    np.testing.assert_allclose(4 * np.pi * ambient + suns.weights.sum(axis=0), total, rtol=1e-9)


def test_noon_is_lit_from_its_sun():
    ambient, suns = lamps(Environment.load("noon"))
    azimuth, elevation = np.radians([-35.0, 60.0])
    sun = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
    lit = blinn_phong(np.stack([sun, -sun]), (ambient, suns))
    assert (lit[0] > 3 * lit[1]).all()
    assert suns.directions[0] @ sun > np.cos(np.radians(1.0))


def test_the_highlight_stands_halfway_between_eye_and_lamp():
    normals = unit(20_000)
    eye, toward = np.array([0.0, 0.0, 1e9]), np.array([[0.6, 0.0, 0.8]])
    lamp = np.zeros(3), Suns(toward, np.ones((1, 3)))
    gloss = blinn_phong(normals, lamp, np.zeros_like(normals), eye, specular=1.0, shininess=2000.0)
    half = toward[0] + [0, 0, 1]
    half /= np.linalg.norm(half)
    assert normals[gloss[:, 0].argmax()] @ half > np.cos(np.radians(2.0))  # normals are about a degree apart
    exact = blinn_phong(half[None], lamp, np.zeros((1, 3)), eye, specular=1.0, shininess=2000.0)
    np.testing.assert_allclose(exact[0], 2008 / (8 * np.pi) * (half @ toward[0]), rtol=1e-3)  # float32 normal^2000


@pytest.mark.parametrize("shininess", [0.0, 4.0, 32.0, 500.0])
def test_gloss_reflects_what_it_receives(shininess):
    """Light along the normal: what leaves over all eyes is the share `specular` of it."""
    count = 200_000
    eyes = unit(count, 4) * 1e9
    eyes[:, 1] = np.abs(eyes[:, 1])
    normals = np.tile([0.0, 1.0, 0.0], (count, 1))
    lamp = np.zeros(3), Suns(np.array([[0.0, 1.0, 0.0]]), np.ones((1, 3)))
    radiance = np.concatenate(
        [
            blinn_phong(normals[part], lamp, -eyes[part], np.zeros(3), specular=1.0, shininess=shininess)
            for part in np.array_split(np.arange(count), 4)
        ]
    )[:, 0]
    leaving = 2 * np.pi * (radiance * eyes[:, 1] / 1e9).mean()
    # (s + 8) / (8 pi) is up to 6% above the exact factor; the random eyes add 1% for the sharpest lobe.
    assert leaving == pytest.approx(1.03, abs=0.04)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"specular": 1.5}, "from 0 to 1"),
        ({"shininess": -1.0}, "from 0 up"),
        ({"specular": 0.5}, "needs an eye"),
        ({"specular": 0.5, "eye": (0, 0, 1), "vertices": np.zeros((2, 3))}, "one vertex per normal"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        blinn_phong(unit(3), (np.zeros(3), NO_SUNS), **options)
