"""The angle that brings light from behind the viewer to the side, and no angle for other light."""

import numpy as np
import pytest

from relight import Environment
from relight.output.frontal import FRONTAL_DEG, SIDE_DEG, side_angle
from relight.output.inset import strongest

SUN_DEG = -60.0
"""Azimuth of the sun of `sunset`, counter-clockwise from +z as seen from above."""


def camera(azimuth_deg, height=0.3):
    a = np.radians(azimuth_deg)
    return {"eye": [2.0 + np.sin(a), 1.0 + height, np.cos(a)], "target": [2.0, 1.0, 0.0]}


def off(azimuth_deg, angle_deg):
    """Azimuth of the light over that of the viewer, degrees."""
    light = strongest(Environment.load("sunset").rotated(angle_deg))
    return (np.degrees(np.arctan2(light[0], light[2])) - azimuth_deg + 180.0) % 360.0 - 180.0


@pytest.mark.parametrize("turned", [0.0, 90.0, 200.0])
@pytest.mark.parametrize("aside", [-35.0, -10.0, 5.0, 38.0])
def test_light_behind_the_viewer_is_brought_to_the_nearer_side(turned, aside):
    eye = SUN_DEG + turned - aside
    angle = side_angle(Environment.load("sunset").rotated(turned), camera(eye))
    assert angle % 5.0 == 0.0 and 0.0 <= angle < 360.0
    assert off(eye, turned) == pytest.approx(aside, abs=0.5)
    assert off(eye, angle) == pytest.approx(np.copysign(SIDE_DEG, aside), abs=3.0)  # a multiple of 5
    assert side_angle(Environment.load("sunset").rotated(angle), camera(eye)) is None


def test_light_from_the_side_and_from_behind_the_scene_stays():
    for aside in (FRONTAL_DEG + 2.0, 90.0, -90.0, 180.0):
        assert side_angle(Environment.load("sunset"), camera(SUN_DEG - aside)) is None


@pytest.mark.parametrize("name", ["overcast", "noon", "studio"])
def test_high_and_even_light_stays(name):
    assert all(side_angle(Environment.load(name), camera(azimuth)) is None for azimuth in range(0, 360, 30))
    even = Environment(np.ones((8, 16, 3), np.float32), "even")
    assert side_angle(even, camera(0.0)) is None


def test_a_view_straight_down_has_no_side():
    assert side_angle(Environment.load("sunset"), {"eye": [0.0, 3.0, 0.0], "target": [0.0, 0.0, 0.0]}) is None
