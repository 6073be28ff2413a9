"""The shadow of a moved object without rays, against closed forms and against rays."""

from dataclasses import replace

import numpy as np
from disc_scenes import WHITE, disc, every, floor, form_factor, standing_of

from relight.insert.gathering import Casting, change_at
from relight.insert.hidden import HiddenLight
from relight.insert.standing import Standing
from relight.insert.surroundings import Sky, surroundings_of
from relight.light.environment import Environment


def moved(standing, matrix):
    """The same objects under another matrix."""
    return Standing.of(standing.frame, standing.objects, [matrix @ standing.placed[0]])


def turned(angle_deg, offset=(0.0, 0.0, 0.0)):
    matrix, angle = np.eye(4), np.radians(angle_deg)
    matrix[::2, ::2] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = offset
    return matrix


def test_a_disc_hides_its_form_factor_wherever_it_is_moved_and_however_turned():
    scene, occluder, black = floor()
    around = surroundings_of(scene, occluder, black, [Sky(WHITE, 2.0)], [])
    standing = standing_of(scene, *disc(0.5, 0.4), albedo=0.0)
    hidden = HiddenLight.of(around, standing, 0, np.zeros_like(standing.vertices))
    for matrix in (np.eye(4), turned(0.0, (1.3, 0.0, -0.7)), turned(50.0, (1.3, 0.0, -0.7))):
        found = np.exp(hidden.logarithms(moved(standing, matrix), every(occluder)))
        distance = np.linalg.norm((scene.vertices - matrix[:3, 3])[:, [0, 2]], axis=1)
        wanted = 1.0 - form_factor(distance, 0.4, 0.5)[:, None]
        # 32 directions a place, each 3% of the light on average and 6% overhead; the edge is two texels wide.
        assert np.abs(found - wanted).max() < 0.12
        assert np.abs(found - wanted).mean() < 0.01


def test_the_shadow_of_a_sun_falls_where_rays_find_it():
    image = np.full((64, 128, 3), 0.2, np.float32)
    image[16, 40] = 2000.0  # at 44 degrees
    scene, occluder, black = floor()
    around = surroundings_of(scene, occluder, black, [Sky(Environment(image, "sun"), 1.0)], [])
    standing, at = standing_of(scene, *disc(0.5, 0.6), albedo=0.0), every(occluder)
    hidden = HiddenLight.of(around, standing, 0, np.zeros_like(standing.vertices))
    there = moved(standing, turned(20.0, (-0.8, 0.0, 0.5)))
    reached = hidden.reached(there, at, 1.0 / 16.0)
    found = np.zeros_like(black)
    found[reached] = hidden.logarithms(there, at.of(np.flatnonzero(reached)))
    change = change_at(around, there, np.zeros_like(there.vertices), Casting(64), at)[:, 1]
    dark = change < 0.8 * change.min()  # of the sun
    assert dark.sum() > 50
    assert ((found[:, 1] < -0.5) != dark).sum() < 0.15 * dark.sum()  # a texel along the edge


def test_a_disc_that_sends_what_it_hides_changes_nothing():
    scene, occluder, black = floor()
    around = surroundings_of(scene, occluder, black, [Sky(WHITE, 1.0)], [])
    standing = standing_of(scene, *disc(0.5, 0.4), albedo=1.0)
    hidden = HiddenLight.of(around, standing, 0, np.ones_like(standing.vertices))
    above = hidden.maps.directions[:, 1] > 0.1  # at the horizon a direction has some of the floor
    assert (hidden.light[~above] <= 1.01 * 4 * np.pi / 64).all()
    kept = replace(hidden, light=np.where(above[:, None], hidden.light, np.float32(4 * np.pi / 64)))
    np.testing.assert_allclose(kept.logarithms(standing, every(occluder)), 0.0, atol=0.02)
