"""Properties of turned harmonics and of light probes: they hold for every rotation, every coefficient, every size."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from seeded import bounded

from relight import Environment
from relight.light import projections
from relight.sh import harmonics, latlong, rotors

# Turns and sums in float64 of at most 100 coefficients below 10: 1e-12 leaves room for a thousand roundings.
CLOSE = {"rtol": 0, "atol": 1e-11}

components = st.tuples(*[st.floats(-1, 1, allow_subnormal=False)] * 4).filter(lambda q: sum(c * c for c in q) > 1e-2)
rotation = components.map(lambda q: Rotation.from_quat(q))
bands = st.integers(1, harmonics.MAX_BANDS)


def of_scipy(rotation):
    w, x, y, z = rotation.as_quat(scalar_first=True)
    return np.array([w, -z, y, -x])


def coefficients(count, seed):
    return np.random.default_rng(seed).normal(size=(count * count, 3))


@bounded
@given(rotation, rotation, bands)
def test_a_product_of_rotations_turns_as_one_after_the_other(a, b, count):
    first, second = (each.as_matrix() for each in (a, b))
    apart = harmonics.rotation_matrix(first, count) @ harmonics.rotation_matrix(second, count)
    np.testing.assert_allclose(harmonics.rotation_matrix(first @ second, count), apart, **CLOSE)


@bounded
@given(rotation, bands)
def test_the_inverse_rotation_turns_back_and_is_the_transpose(a, count):
    forth = harmonics.rotation_matrix(a.as_matrix(), count)
    back = harmonics.rotation_matrix(a.inv().as_matrix(), count)
    np.testing.assert_allclose(back @ forth, np.eye(count * count), **CLOSE)
    np.testing.assert_allclose(back, forth.T, **CLOSE)


@bounded
@given(rotation, bands, st.integers(0, 2**16))
def test_every_band_keeps_its_energy(a, count, seed):
    before = coefficients(count, seed)
    after = harmonics.rotation_matrix(a.as_matrix(), count) @ before
    for degree in range(count):
        band = slice(degree**2, (degree + 1) ** 2)
        np.testing.assert_allclose(np.square(after[band]).sum(axis=0), np.square(before[band]).sum(axis=0), rtol=1e-10)


@bounded
@given(rotation, bands, st.integers(0, 2**16))
def test_rotors_turn_as_matrices_do(a, count, seed):
    before = coefficients(count, seed)
    np.testing.assert_allclose(
        rotors.rotate(before, of_scipy(a)), harmonics.rotation_matrix(a.as_matrix(), count) @ before, **CLOSE
    )


@bounded
@given(rotation, bands, st.integers(0, 2**16))
def test_turned_light_arrives_from_turned_directions(a, count, seed):
    r, light = a.as_matrix(), coefficients(count, seed)
    directions = projections.texel_directions(3, 6).reshape(-1, 3)
    turned = harmonics.evaluate(directions @ r.T, count) @ harmonics.rotation_matrix(r, count) @ light
    # evaluate() keeps float32 where it is given that; here all is float64.
    np.testing.assert_allclose(turned, harmonics.evaluate(directions, count) @ light, rtol=0, atol=1e-10)


@bounded
@given(st.integers(1, 3), st.integers(8, 64), st.integers(0, 2**16))
def test_light_of_few_harmonics_survives_its_image(count, height, seed):
    """Projecting its lat-long image gives the coefficients back, up to the size of the texels."""
    light = coefficients(count, seed)
    image = harmonics.evaluate(projections.texel_directions(height, 2 * height).reshape(-1, 3), count) @ light
    found = latlong.project_latlong(image.reshape(height, 2 * height, 3), count)
    # A texel's centre differs from its mean by the square of its angle times the second derivative.
    np.testing.assert_allclose(found, light, rtol=0, atol=4.0 * (np.pi / height) ** 2 * np.abs(light).sum())


@bounded
@given(st.floats(-1e4, 1e4), st.floats(-1e4, 1e4), st.integers(0, 2**16))
def test_turns_of_an_environment_add_up(a, b, seed):
    image = np.random.default_rng(seed).random((4, 8, 3), np.float32)
    one, other = Environment(image).rotated(a).rotated(b), Environment(image).rotated(a + b)
    np.testing.assert_allclose(one.sh(4), other.sh(4), rtol=0, atol=1e-8)  # angles of 1e4 degrees carry 2e-12 of a turn
    np.testing.assert_allclose(one.rotated(-a - b).sh(4), Environment(image).sh(4), rtol=0, atol=1e-8)


@bounded
@given(st.sampled_from(["angular map", "vertical cross"]), st.integers(8, 40), st.integers(0, 2**16))
def test_a_probe_of_smooth_light_shows_that_light(kind, half, seed):
    """Draw smooth light as a probe, resample it: the lat-long image has the light, up to a texel of the probe."""
    rng = np.random.default_rng(seed)
    slope, level = rng.normal(size=(3, 3)) * 0.1, rng.uniform(1.0, 2.0, 3)
    if kind == "angular map":
        size = 4 * half
        offset = (np.arange(size) + 0.5 - size / 2) / (size / 2)
        right, top = offset[None, :] + 0 * offset[:, None], -offset[:, None] + 0 * offset[None, :]
        radius = np.hypot(right, top)
        sine = np.sinc(np.minimum(radius, 1.0)) * np.pi  # sin(pi r) / r
        directions = np.stack([right * sine, top * sine, -np.cos(np.pi * np.minimum(radius, 1))], axis=-1)
        image = np.where(radius[..., None] <= 1, directions @ slope + level, 0)
        found, texel = projections.latlong_from_angular(image), 2 * np.pi / size
    else:
        image = np.zeros((4 * half, 3 * half, 3))
        side = (np.arange(half) + 0.5) / half * 2 - 1
        for (column, row), forward, right, down in projections._CROSS_FACES:
            across, along = side[None, :, None] * np.array(right), side[:, None, None] * np.array(down)
            directions = np.array(forward) + across + along
            directions = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
            image[row * half :][:half, column * half :][:, :half] = directions @ slope + level
        found, texel = projections.latlong_from_cross(image), np.pi / 2 / half
    assert projections.recognise(image) == kind
    expected = projections.texel_directions(*found.shape[:2]) @ slope + level
    # At the rim of an angular map, the last three texels are those before them.
    np.testing.assert_allclose(found, expected, rtol=0, atol=4 * texel * np.abs(slope).sum())


@pytest.mark.parametrize("count", [1, 4, harmonics.MAX_BANDS])
def test_no_rotation_changes_nothing(count):
    np.testing.assert_allclose(harmonics.rotation_matrix(np.eye(3), count), np.eye(count * count), **CLOSE)
