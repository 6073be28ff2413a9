"""sRGB and linear light: the standard's own numbers, exact inverses, types kept."""

import numpy as np
import pytest

from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, luminance, srgb_from_linear


def test_the_curve_is_that_of_iec_61966_2_1():
    srgb = np.array([0.0, 0.02, 0.04045, 0.2, 0.5, 0.735357, 1.0])
    by_definition = [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in srgb]
    np.testing.assert_allclose(linear_from_srgb(srgb), by_definition, rtol=1e-14)
    assert linear_from_srgb(1.0) == 1.0 and linear_from_srgb(0.0) == 0.0
    # The eight-bit code 188 is known as half the light.
    assert linear_from_srgb(188 / 255) == pytest.approx(0.5, abs=0.003)


def test_the_two_directions_undo_one_another():
    values = np.linspace(0.0, 4.0, 4001)
    # The standard's rounded constants leave a step of 3e-8 where the two pieces of the curve meet.
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(values)), values, atol=1e-7)
    np.testing.assert_allclose(linear_from_srgb(srgb_from_linear(values)), values, atol=1e-7)


def test_every_byte_survives_the_way_to_linear_light_and_back():
    codes = np.arange(256, dtype=np.uint8)
    for dtype in (np.float32, np.float64):
        linear = linear_from_srgb(codes / dtype(255))
        np.testing.assert_array_equal(bytes_from_unit(srgb_from_linear(linear)), codes)


def test_both_curves_rise_and_keep_shape_and_type():
    values = np.linspace(-0.1, 2.0, 5000, dtype=np.float32).reshape(50, 100)
    for curve in (linear_from_srgb, srgb_from_linear):
        result = curve(values)
        assert result.shape == values.shape and result.dtype == np.float32
        assert curve(values.astype(np.float64)).dtype == np.float64
        assert (np.diff(result.ravel()) > 0).all()


def test_luminance_of_white_is_one_and_it_is_linear():
    assert luminance([1.0, 1.0, 1.0]) == pytest.approx(1.0, abs=1e-15)
    a, b = np.random.default_rng(0).uniform(0, 5, (2, 7, 4, 3))
    assert luminance(a).shape == (7, 4)
    np.testing.assert_allclose(luminance(2 * a + b), 2 * luminance(a) + luminance(b), rtol=1e-13)
    np.testing.assert_array_equal(luminance(np.eye(3)), [0.2126, 0.7152, 0.0722])  # ITU-R BT.709


def test_bytes_are_the_nearest_code_and_are_clipped():
    codes = np.arange(256)
    exact = codes / 255.0
    np.testing.assert_array_equal(bytes_from_unit(exact), codes)
    np.testing.assert_array_equal(bytes_from_unit(exact + 0.49 / 255), codes)
    np.testing.assert_array_equal(bytes_from_unit(exact - 0.49 / 255), codes)
    np.testing.assert_array_equal(bytes_from_unit(np.array([-1.0, 1.5, np.inf])), [0, 255, 255])
    assert bytes_from_unit(exact).dtype == np.uint8
