"""Blinn-Phong: the furnace, Lambert's law, and the energy of its lamps."""

import numpy as np
import pytest

from relight import Environment
from relight.engine.blinnphong import blinn_phong, lamps
from relight.light.environment import Suns
from relight.light.projections import row_solid_angles


def unit(count, seed=0):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def test_constant_sky_gives_one():
    radiance = blinn_phong(unit(100), Environment(np.ones((16, 32, 3))))
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
