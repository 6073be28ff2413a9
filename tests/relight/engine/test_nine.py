"""relight.engine.nine: a constant sky is exact, white scenes are untouched, numbers stay within what 16 bits hold."""

import numpy as np
import pytest
from captured_scenes import lamp_light, objects, patchy

from relight.engine.nine import nine_and_tint, with_received
from relight.transfer.bounces import with_bounces


@pytest.fixture(scope="module")
def scene():
    occluder, transfer, bounces, _ = objects()
    return transfer, patchy(occluder), bounces


def sent(received, albedo, light):
    grey, tint = nine_and_tint(received)
    return albedo * tint * np.maximum(grey @ light, 0.0)


def exact(scene, light):
    transfer, albedo, bounces = scene
    return with_bounces(np.maximum(transfer[:, :9] @ light.astype(np.float32), 0.0), albedo, bounces, 1e-6)[0]


def off(found, truth):
    return np.sqrt(np.square(found - truth).sum() / np.square(truth).sum())


def test_a_constant_sky_is_exact_bounces_and_all(scene):
    light = np.zeros((9, 3))
    light[0] = np.sqrt(4.0 * np.pi) * np.array([1.0, 0.8, 0.6])
    transfer, albedo, bounces = scene
    found = sent(with_received(transfer, albedo, bounces), albedo, light)
    # Bounces stop where those left out would add a thousandth of all light.
    assert off(found, exact(scene, light)) < 1e-3


def test_any_other_light_is_near_with_one_tint(scene):
    light = lamp_light().sh(3)
    transfer, albedo, bounces = scene
    found, truth = sent(with_received(transfer, albedo, bounces), albedo, light), exact(scene, light)
    # Of light that bounces the colour changes from place to place and from side to side; without any it is darker.
    assert off(found, truth) < 0.02 < 0.1 < off(sent(with_received(transfer, None), albedo, light), truth)


def test_without_bounces_the_transfer_is_kept_and_the_tint_white(scene):
    transfer = scene[0]
    grey, tint = nine_and_tint(with_received(transfer, None))
    np.testing.assert_allclose(grey, transfer[:, :9], atol=1e-6)
    assert (tint == 1.0).all()


def test_all_numbers_are_within_the_bound(scene):
    transfer, albedo, bounces = scene
    grey, tint = nine_and_tint(with_received(transfer, np.maximum(albedo, 0.95), bounces))
    assert np.abs(grey).max() < 0.64 and tint.min() >= 0.0 and tint.max() == 1.0


def test_a_vertex_that_no_light_reaches_is_black_and_not_nan():
    grey, tint = nine_and_tint(np.zeros((2, 9, 3), np.float32))
    assert (grey == 0.0).all() and (tint == 1.0).all()
