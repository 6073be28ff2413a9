"""The Z-order curve: bits by hand, and the corners of a cube."""

from itertools import product

import numpy as np

from splat2mesh.splats.zorder import bits_apart, rows_along_curve


def test_two_zeros_stand_before_each_bit():
    values = np.arange(1024, dtype=np.uint64)
    expected = [int("".join(f"00{bit}" for bit in f"{value:010b}"), 2) for value in range(1024)]
    assert bits_apart(values).tolist() == expected


def test_the_corners_of_a_cube_are_gone_through_with_z_fastest():
    corners = np.array(list(product([0.0, 1.0], repeat=3)), np.float32)
    shuffled = np.random.default_rng(0).permutation(8)
    rows = rows_along_curve(corners[shuffled])
    np.testing.assert_array_equal(corners[shuffled][rows], corners)


def test_points_of_one_cell_stay_in_their_order():
    assert rows_along_curve(np.zeros((5, 3), np.float32)).tolist() == [0, 1, 2, 3, 4]


def test_no_points_have_an_order_too():
    assert rows_along_curve(np.zeros((0, 3), np.float32)).shape == (0,)
