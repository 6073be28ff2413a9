"""Gaussians finer than the pixels of the fit: drawn as groups, corrected as groups, and nothing is lost by it."""

from dataclasses import replace

import numpy as np
import pytest
from coloured_ball import ball_splats, irradiances, sphere_scene

from relight.splats import Binding, binding, sketch
from relight.splats.sketch import Sketch
from relight.transfer.store import Cache
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.splats.merging import covers


@pytest.fixture
def coarse(monkeypatch):
    """Pictures of few pixels, several Gaussians in each."""
    monkeypatch.setattr(binding, "PIXELS", 24)


def test_groups_correct_a_fit_as_their_gaussians_do(coarse, monkeypatch):
    scene, splats = sphere_scene(), ball_splats()
    before, after = irradiances(scene)
    merged = Binding(splats, scene)
    monkeypatch.setattr(sketch, "merged_count", lambda splats, pixels: 1)
    single = Binding(splats, scene)
    assert len(merged.sketch) < 0.7 * len(splats) and len(single.sketch) == len(splats)
    view = View.look_at([-0.5, 0.25, 3.0], [-0.5, 0.25, -2.0], [0, -1, 0], 30, 96)
    shown = [rasterize(each, view).color for each in (splats, *(b.relit(before, after) for b in (merged, single)))]
    apart, changed = (np.sqrt(np.mean((each - shown[1]) ** 2)) for each in (shown[2], shown[0]))
    assert apart < 0.06 * changed  # though colours of neighbours are drawn at random, and pictures are 24 pixels wide


def test_equal_light_changes_no_bit_of_merged_gaussians(coarse):
    scene, splats = sphere_scene(), ball_splats()
    before, _ = irradiances(scene)
    np.testing.assert_array_equal(Binding(splats, scene).relit(before, before).sh, splats.sh)


def test_kept_groups_are_those_that_were_made(coarse, tmp_path):
    scene, splats = sphere_scene(), ball_splats()
    before, after = irradiances(scene)
    made, kept = (Binding(splats, scene, cache=Cache(tmp_path)) for _ in range(2))
    np.testing.assert_array_equal(made.relit(before, after).sh, kept.relit(before, after).sh)


def test_a_group_has_the_mean_of_its_gaussians():
    splats = ball_splats()
    made, values = Sketch(splats, 8, 2.5), np.random.default_rng(0).random((len(splats), 2)).astype(np.float32)
    weight = covers(splats)
    sums = np.stack([np.bincount(made.group, weight * column) for column in values.T], axis=1)
    expected = sums / np.bincount(made.group, weight)[:, None]
    np.testing.assert_allclose(made.mean(values), expected, rtol=1e-5)
    np.testing.assert_array_equal(made.members(expected), expected[made.group])
    assert len(made.splats) == len(made) == made.group.max() + 1


def test_eyes_that_may_come_close_see_each():
    splats = ball_splats()
    assert Sketch(splats, None).group is None
    assert Sketch(splats, 256, 2.5).group is None  # no finer than pixels


def test_what_is_wider_than_a_pixel_stays_alone():
    splats = ball_splats()
    wide = replace(splats, scales=np.where(np.arange(len(splats))[:, None] < 100, splats.scales * 8, splats.scales))
    made = Sketch(wide, 8, 2.5)
    assert (np.bincount(made.group)[made.group[:100]] == 1).all() and len(made) < 0.5 * len(splats)
