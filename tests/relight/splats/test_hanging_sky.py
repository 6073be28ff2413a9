"""Sky in the air before the background: of its colour, coarse, and with nothing behind it wherever people stand."""

from types import SimpleNamespace

import numpy as np
import pytest
from splat_samples import open_air

from relight.splats import shown_as_sky
from relight.splats.hanging_sky import hanging_sky
from relight.splats.sky import sky_rows
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import SH_C0, Splats

WHITE, GREY = (0.95, 0.97, 1.0), (0.6, 0.6, 0.6)
EYES = np.array([[0.0, 0.2, 0.0], [0.6, 0.2, 0.5], [-0.5, 0.2, 0.4], [0.1, 0.3, -0.6]])
TURNS = np.diag([1.0, 1, 1, 1]), np.diag([1.0, -1, -1, 1])


def some(means, size, color):
    """Round, opaque splats of one size and colour."""
    means = np.atleast_2d(np.asarray(means, np.float32))
    count = len(means)
    sh = np.tile((np.array(color) - 0.5) / SH_C0, (count, 1))[:, None].astype(np.float32)
    return Splats(means, np.full((count, 3), size), np.tile([1.0, 0, 0, 0], (count, 1)), np.full(count, 0.95), sh)


def roofed(turn):
    """`open_air` with a wall 6 units away along x, and single splats whose numbers come with their names."""
    splats, far, sky = open_air()
    z, y = np.meshgrid(np.arange(-4, 4, 0.5), np.arange(-1, 3, 0.5))
    wall = some(np.stack([np.full(z.size, 6.0), y.ravel(), z.ravel()], axis=1), 0.35, (0.5, 0.3, 0.2))
    single = {
        "over the roof": some([6.0, 4.2, 0.0], 0.5, WHITE),
        "before the wall": some([5.0, 0.8, 0.0], 0.5, WHITE),
        "behind the wall": some([9.0, 1.0, 0.0], 0.5, WHITE),
        "of another colour": some([6.0, 4.2, 2.0], 0.5, GREY),
        "chimney": some([6.0, 3.8, -2.0], 0.03, WHITE),
    }
    numbers = dict(zip(single, len(splats) + len(wall) + np.arange(len(single)), strict=True))
    together = joined([splats, wall, *single.values()])
    together.means[:] = together.means @ turn[:3, :3]
    return together, far, sky, numbers


@pytest.mark.parametrize("turn", TURNS)
def test_what_hangs_over_a_roof_is_sky_and_nothing_else_becomes_it(turn):
    splats, far, _, numbers = roofed(turn)
    before = sky_rows(splats, far, turn)
    found = sky_rows(splats, far, turn, EYES)
    np.testing.assert_array_equal(found[: len(before)], before)
    np.testing.assert_array_equal(found[len(before) :], [numbers["over the roof"]])


def test_of_the_far_background_only_what_has_sky_behind_it():
    splats, far, _, numbers = roofed(TURNS[0])
    rows = np.append(far, [numbers["over the roof"], numbers["before the wall"], numbers["chimney"]])
    before = sky_rows(splats, rows, TURNS[0])
    found = sky_rows(splats, rows, TURNS[0], EYES)
    np.testing.assert_array_equal(found[len(before) :], [numbers["over the roof"]])


def test_one_eye_alone_decides_nothing():
    splats, far, _, _ = roofed(TURNS[0])
    for eyes in (EYES[:0], EYES[:1]):
        np.testing.assert_array_equal(sky_rows(splats, far, TURNS[0], eyes), sky_rows(splats, far, TURNS[0]))


def test_without_sky_or_candidates_there_is_none():
    splats, far, sky, numbers = roofed(TURNS[0])
    middle, none = np.zeros(3), np.zeros(0, np.int64)
    assert not len(hanging_sky(splats, far, none, np.array([numbers["over the roof"]]), middle, EYES))
    assert not len(hanging_sky(splats, far, sky, none, middle, EYES))
    everything = np.setdiff1d(np.arange(len(splats)), sky)
    assert not len(hanging_sky(splats, np.arange(len(splats)), sky, everything[:0], middle, EYES))


def test_damaged_splats_are_left_out():
    splats, far, _, numbers = roofed(TURNS[0])
    splats.means[numbers["chimney"]] = np.nan
    splats.means[far[5]] = np.inf
    assert numbers["over the roof"] in sky_rows(splats, far, TURNS[0], EYES)


def test_it_counts_in_places_that_know_where_they_were_captured_from():
    splats, far, _, numbers = roofed(TURNS[0])
    look = SimpleNamespace(room=None, as_captured=False)
    for place, expected in ((True, True), (False, False)):
        scene = SimpleNamespace(background_splats=far, scene_from_splat=np.eye(4), is_place=place)
        scene.capture = {"eyes": EYES.tolist()}
        assert (numbers["over the roof"] in shown_as_sky(splats, scene, look)) == expected
