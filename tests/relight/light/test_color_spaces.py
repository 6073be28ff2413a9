"""Primaries become matrices, white to white; pictures keep their light, and what lies outside sRGB is counted."""

import numpy as np
import pytest
from color_primaries import PRIMARIES, expected_matrix

from relight.light.color_spaces import REC709, SPACES, as_rec709, converted, from_rec709
from splat2mesh.base.errors import DataWarning

COLORS = np.random.default_rng(0).random((5, 7, 3)).astype(np.float32)


@pytest.mark.parametrize("space", PRIMARIES)
def test_a_matrix_is_what_its_primaries_say_and_keeps_grey(space):
    matrix = from_rec709(PRIMARIES[space])
    np.testing.assert_allclose(matrix, expected_matrix(PRIMARIES[space]), atol=1e-12)
    np.testing.assert_allclose(matrix.sum(axis=1), 1.0, atol=1e-12)


def test_acescg_has_the_published_matrix():
    """Of the Academy's transforms, ten digits."""
    published = [
        [0.6130974024, 0.3395231462, 0.0473794514],
        [0.0701937225, 0.9163538791, 0.0134523985],
        [0.0206155929, 0.1095697729, 0.8698146342],
    ]
    np.testing.assert_allclose(SPACES["acescg"].matrix, published, atol=1e-10)


def test_srgb_keeps_its_bits_also_as_files_round_its_primaries():
    np.testing.assert_array_equal(converted(COLORS, SPACES["srgb"]), COLORS)
    assert as_rec709(COLORS, np.float32(REC709).tolist(), "a") is COLORS


def test_colours_come_back():
    np.testing.assert_allclose(as_rec709(converted(COLORS, SPACES["acescg"]), PRIMARIES["AP1"], "a"), COLORS, atol=1e-6)


def test_colours_outside_are_clipped_and_counted():
    image = COLORS.copy()
    image[1, 2], image[3, 3] = [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]
    image[0, 0] = [0.5, 0.5, 0.5]
    with pytest.warns(DataWarning, match=r"clipped the colours of \d+ of 35 pixels") as seen:
        found = as_rec709(image, PRIMARIES["Rec.2020"], "a")
    exact = image.astype(np.float64) @ np.linalg.inv(expected_matrix(PRIMARIES["Rec.2020"])).T
    np.testing.assert_allclose(found, np.maximum(exact, 0.0), atol=1e-6)
    assert f"of {(exact.min(axis=2) < -1e-3 * exact.max(axis=2)).sum()} of" in str(seen[0].message)


def test_pixels_that_are_no_numbers_stay_what_a_repair_can_find():
    image = converted(COLORS, SPACES["acescg"])
    image[0, 0, 1], image[1, 1], image[2, 2] = np.nan, np.inf, -1.0
    found = as_rec709(image, PRIMARIES["AP1"], "a")
    assert np.isnan(found[0, 0]).all() and (found[1, 1] > 1e38).all() and (found[2, 2] < 0.0).all()
