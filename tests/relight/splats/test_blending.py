"""The kept shares of Gaussians in pictures: what they draw against the rasterizer, their transpose, what was kept."""

import numpy as np
import pytest
from ball_splats import solid_ball

from relight.splats.blend_lists import LEAST_SHARE, in_tiles
from relight.splats.blending import blending_of
from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View


@pytest.fixture(scope="module")
def drawn():
    splats = solid_ball(800)
    views = [
        View.look_at(eye, [0.0, 0.0, 0.0], [0, -1, 0], 30, *size)
        for eye, size in (([1.0, 0.0, -7.0], (70, 50)), ([0.5, 1.0, 6.0], (64, 48)))  # full tiles in the second alone
    ]
    looks = []
    blending = blending_of(splats, views, 0.01, lambda number, alpha, depth: looks.append((number, alpha, depth)))
    return splats, views, blending, looks


def test_pictures_are_those_of_the_rasterizer(drawn):
    splats, views, blending, looks = drawn
    found = blending.drawn(splats.colors_diffuse.astype(np.float32))
    renderings = [rasterize(splats, view) for view in views]
    expected = np.concatenate([in_tiles(each.color) for each in renderings])
    # Each share is rounded to one of SHARES, and up to a few dozen below LEAST_SHARE are left out.
    np.testing.assert_allclose(found, expected, atol=30 * float(LEAST_SHARE))
    assert np.abs(found - expected).mean() < float(LEAST_SHARE)
    for number, (index, alpha, depth) in enumerate(looks):
        assert index == number
        np.testing.assert_array_equal(alpha, renderings[number].alpha)
        np.testing.assert_array_equal(depth, renderings[number].depth_median)


def test_spreading_is_the_transpose_of_drawing(drawn):
    """<picture, drawn(colours)> = <spread(picture), colours> for any picture and colours."""
    splats, _, blending, _ = drawn
    rng = np.random.default_rng(3)
    colors = rng.normal(size=(len(splats), 3)).astype(np.float32)
    picture = blending.drawn(colors)
    values = rng.normal(size=(len(picture), 3)).astype(np.float32)
    sums = np.zeros((len(splats), 3), np.float32)
    blending.spread(values, sums)
    expected, found = (values * picture).sum(dtype=np.float64), (sums * colors).sum(dtype=np.float64)
    assert abs(found - expected) < 1e-5 * np.abs(values * picture).sum()  # float32 sums of some thousand terms


def test_no_pixel_is_made_of_more_than_itself(drawn):
    splats, _, blending, _ = drawn
    ones = blending.drawn(np.ones((len(splats), 3), np.float32))
    assert ones.max() <= 1.01
    assert ones.max() > 0.98


def test_only_what_is_wanted_is_kept(drawn):
    """The same bits in the pixels wanted and nothing in the others, in pictures and on the way back."""
    splats, views, blending, _ = drawn
    rng = np.random.default_rng(5)
    masks = [rng.random((view.height, view.width)) < 0.4 for view in views]
    masks[0][:20] = False  # whole tiles among them
    some = blending_of(splats, views, 0.01, lambda number, alpha, depth: masks[number]).checked(len(splats))
    wanted = np.concatenate([in_tiles(mask) for mask in masks])
    colors = rng.normal(size=(len(splats), 3)).astype(np.float32)
    picture, found = blending.drawn(colors), some.drawn(colors)
    np.testing.assert_array_equal(found, np.where(wanted[:, None], picture, 0.0))
    values = np.where(wanted[:, None], picture, np.float32(0.0))
    sums, again = np.zeros((2, len(splats), 3), np.float32)
    blending.spread(values, sums)
    some.spread(values, again)
    np.testing.assert_array_equal(again, sums)
    assert 0 < len(some.pixels) < 0.5 * len(blending.pixels) and len(some.splats) < len(blending.splats)


def test_what_was_kept_is_checked(drawn):
    splats, _, blending, _ = drawn
    assert blending.checked(len(splats)) is blending
    with pytest.raises(InputError, match="others than 5"):
        blending.checked(5)
    for name, broken in {
        "runs": blending.runs[::-1].copy(),
        "items": blending.items + 1,
        "counts": blending.counts + np.uint16(1),
        "pixels": blending.pixels[:-1],
        "shares": blending.shares.astype(np.float32),
        "tiles": np.array([0, 1], np.int64),
    }.items():
        with pytest.raises(InputError, match="kept pictures"):
            blending._replace(**{name: broken}).checked(len(splats))
