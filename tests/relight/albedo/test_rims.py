"""Rims of captured shadows: albedo beside an edge is a paint around it, where two shadows end a little apart."""

from types import SimpleNamespace

import numpy as np
import pytest

from relight.albedo import samples
from relight.albedo.captured import Estimate
from relight.albedo.division import Prior
from relight.albedo.rims import evened
from relight.light.environment import Environment
from relight.transfer.occluder import Occluder

SIDE, SUN, SKY = 60, 3.0, np.array([0.6, 0.8, 1.0])


@pytest.fixture(scope="module")
def floor():
    """A flat square of 3,600 vertices, and two paints on it, in stripes along x."""
    x, y = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    points = np.stack([x, np.zeros_like(x), y], axis=2).reshape(-1, 3).astype(np.float32)
    corner = (np.arange(SIDE - 1)[:, None] * SIDE + np.arange(SIDE - 1)).ravel()
    one = np.stack([corner, corner + SIDE, corner + 1], axis=1)
    other = np.stack([corner + 1, corner + SIDE, corner + SIDE + 1], axis=1)
    normals = np.tile(np.float32([0, 1, 0]), (len(points), 1))
    occluder = Occluder(points, normals, np.concatenate([one, other]).astype(np.int32))
    paint = np.where((points[:, 2:] // 5) % 2, [0.3, 0.25, 0.2], [0.5, 0.45, 0.35])
    return points, occluder, paint


def light(shaded):
    return np.where(shaded[:, None], SKY, SKY + SUN).astype(np.float32)


def estimated(floor, captured_shade, modelled_shade, usable=True):
    """The Estimate before and after, of a floor photographed in one shadow and modelled in another."""
    points, occluder, paint = floor
    captured = (0.2 * paint * light(captured_shade)).astype(np.float32)
    irradiance = np.float32(0.2) * light(modelled_shade)
    sky = Environment(np.ones((8, 16, 3), np.float32), "sky")
    prior = Prior(np.full(3, 0.4, np.float32), np.full(3, 1e-3, np.float32))
    found = Estimate(captured / irradiance, irradiance, sky, prior, 1.0, True, "", np.zeros(3), 0.0, np.ones(3), 1.0)
    seen = {"captured": captured, "usable": np.full(len(points), usable), "roughness": samples.roughness(occluder)}
    scene = SimpleNamespace(occluder=occluder, **seen)
    return found, evened(scene, found)


def error(found, paint):
    return np.abs(np.log(found.albedo / paint)).max(axis=1)


def test_a_shadow_modelled_a_little_beside_the_captured_one_leaves_no_rim(floor):
    points, _, paint = floor
    before, after = estimated(floor, points[:, 0] < 30, points[:, 0] < 31.5)
    rim = (points[:, 0] == 30) | (points[:, 0] == 31)
    assert error(before, paint)[rim].min() > 1.3  # log of 3.6 over .6
    light_paint = rim & (paint[:, 0] == 0.5)
    assert error(after, paint)[light_paint].max() < 0.05
    assert error(after, paint)[rim].max() < 0.6  # the dark paint may pass for the light one: log of .45 over .25
    np.testing.assert_array_equal(after.irradiance[~rim], before.irradiance[~rim])


def test_what_the_paint_around_explains_keeps_every_bit(floor):
    points, _, _ = floor
    shaded = points[:, 0] < 30
    before, after = estimated(floor, shaded, shaded)
    np.testing.assert_array_equal(after.irradiance, before.irradiance)
    thin = np.isin(points[:, 0], [30, 31])  # no vertex in such a shadow is far from its edges
    before, after = estimated(floor, thin, thin)
    np.testing.assert_array_equal(after.irradiance, before.irradiance)


def test_leaves_clipped_colours_and_scenes_without_shadows_are_left(floor):
    points, _, _ = floor
    before, after = estimated(floor, points[:, 0] < 30, points[:, 0] < 31.5, usable=False)
    assert after is before
    lit = np.zeros(len(points), bool)
    before, after = estimated(floor, points[:, 0] < 1, lit)
    assert after is before
