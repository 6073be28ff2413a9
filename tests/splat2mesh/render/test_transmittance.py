"""Depth by transmittance: the same from both sides, its closed form, its plain twin, and its levels."""

import numpy as np
import pytest
from disc_splats import plain
from scipy.spatial.transform import Rotation

from splat2mesh.render.levelsearch import TOLERANCE
from splat2mesh.render.opacityfield import field_depth
from splat2mesh.render.opacityfield_reference import OpacityField, field_depth_reference
from splat2mesh.render.transmittance import LevelByThickness
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats


def flat(level):
    """The same level at every thickness."""
    return LevelByThickness((0.0, 1.0), (level, level))


def scattered(n, seed, size, opacity):
    rng = np.random.default_rng(seed)
    scales = size * np.exp(rng.normal(0, 0.5, (n, 3)))
    means, quats = rng.normal(size=(n, 3)) * 0.4, rng.normal(size=(n, 4))
    return Splats(means, scales, quats, opacity * rng.random(n), rng.normal(0, 0.5, (n, 1, 3)))


def facing(distance):
    """A camera on the axis at -distance that looks along +z through one pixel."""
    pose = np.eye(4)
    pose[2, 3] = distance
    return View(1, 1, 400.0, 400.0, 0.5, 0.5, pose)


def test_half_of_what_fades_lies_at_the_same_place_from_both_sides():
    # v from the front times v from behind is 1 - a for every Gaussian, so the roots of all that is let through meet.
    distance = 100.0
    splats = scattered(12, 3, 0.5, 0.6)
    behind = facing(distance)
    behind.camera_from_world[:3, :3] = Rotation.from_euler("y", 180, degrees=True).as_matrix()
    left = np.prod(1 - OpacityField(splats, facing(distance)).alpha)
    level = flat(float(1 - np.sqrt(left)))
    views = facing(distance), behind
    front, back = (field_depth(splats, view, level=0.3, by_thickness=level).depth.item() for view in views)
    thickness = field_depth(splats, facing(distance), level=0.3).spread.item()
    # The lists drop what adds less than .004 behind the others, which differs from the two sides.
    assert thickness > 0.1
    assert front - distance == pytest.approx(distance - back, abs=0.03 * thickness)


@pytest.mark.parametrize("level", [0.35, 0.6, 0.85])
def test_one_gaussian_in_closed_form_before_and_after_its_peak(level):
    z, sigma, opacity = 4.0, 0.5, 0.95
    view = View(32, 24, 50.0, 50.0, 16.0, 12.0, np.eye(4))
    found = field_depth(plain([[0, 0, z]], sigma, opacity), view, level=0.3, by_thickness=flat(level)).depth
    squared = (view.ray_directions() ** 2).sum(axis=-1)
    pixels = (view.ray_directions()[..., :2] ** 2).sum(axis=-1) * view.fx**2
    alpha = opacity * np.exp(-pixels / (2 * ((view.fx * sigma / z) ** 2 + 0.3)))
    np.testing.assert_array_equal(np.isfinite(found), alpha >= level)
    left = 1 - level
    before = 1 - left**2 < alpha  # light is left at the peak: sqrt(1 - a) of it
    gaussian = np.where(before, 1 - left**2, 1 - ((1 - alpha) / left) ** 2)
    hit = (alpha > 1.02 * level) & (gaussian > 0.05 * alpha)  # further out the Gaussian ends with a step
    away = np.sqrt(2 * np.log(np.maximum(alpha / np.maximum(gaussian, 1e-9), 1)))
    expected = z / squared + np.where(before, -away, away) * sigma / np.sqrt(squared)
    # An error of the squared transmittance moves the depth by its share of the slope 2 T dT = T^2 G away / (1 - G).
    slope = left**2 * gaussian * away / (1 - gaussian) / sigma
    error = np.abs(found - expected)
    assert hit.sum() > 20 and (~before)[hit].any() and before[hit].any() == (level < 0.8)
    assert np.all(error[hit] < 1.1 * TOLERANCE / slope[hit] + 0.01 * sigma)


def test_agrees_with_the_plain_twin():
    splats, view = scattered(200, 1, 0.18, 1.0), View.look_at((1, 2, 5), (0, 0, 0), (0, 1, 0), 50, 36, 28)
    levels = LevelByThickness((0.02, 0.3), (0.3, 0.85))
    fast, slow = (find(splats, view, by_thickness=levels) for find in (field_depth, field_depth_reference))
    both = np.isfinite(fast.depth) & np.isfinite(slow.depth)
    # Rounding may move a splat over a cutoff: one pixel in 200.
    assert both.sum() > 150 and np.mean(np.isfinite(fast.depth) != np.isfinite(slow.depth)) <= 0.005
    wanted = levels.of(slow.spread * -(view.ray_directions() * slow.normal).sum(axis=-1))
    reached = 1 - OpacityField(splats, view).through(np.where(both, fast.depth, 0).astype(float))
    # The search is for the square: an error of 1e-3 there is 1e-3 / 2 T. A Gaussian ends with a step of .0025 a / T.
    error = np.abs(reached - wanted)[both] * 2 * (1 - wanted[both])
    assert np.quantile(error, 0.98) < 2 * float(TOLERANCE)
    assert np.median(np.abs(fast.depth - slow.depth)[both] / slow.spread[both]) < 0.005


def test_levels_rise_between_the_thicknesses_and_are_held_outside():
    levels = LevelByThickness((1.0, 3.0), (0.4, 0.8)).of(np.array([0.0, 1.0, 2.0, 3.0, 9.0, np.nan]))
    np.testing.assert_allclose(levels, [0.4, 0.4, 0.6, 0.8, 0.8, np.nan], rtol=1e-6)
