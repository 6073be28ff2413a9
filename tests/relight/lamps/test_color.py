"""relight.lamps.asked: published chromaticities, and texts that mean the same."""

import numpy as np
import pytest

from relight.lamps.asked import NAMES, TEMPERATURES, WHITE, blackbody, luminance, parse_color
from splat2mesh.base.errors import InputError

XYZ_FROM_RGB = np.array(  # IEC 61966-2-1
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)


def chromaticity(color):
    xyz = XYZ_FROM_RGB @ np.asarray(color)
    return xyz[:2] / xyz.sum()


@pytest.mark.parametrize(
    "text", [*TEMPERATURES, *NAMES, "1000K", "1850 k", "25000K", "#010203", "ffcc88", "1,2,3", "0,0,1e-9"]
)
def test_every_colour_has_luminance_1(text):
    color = parse_color(text)
    assert luminance(color) == pytest.approx(1.0, abs=1e-12) and min(color) >= 0.0


# x, y of the CIE: illuminant A (a black body of 2856 K), and of other black bodies. The formula is within 4e-4 of them,
# the rounded matrix adds 1e-4.
@pytest.mark.parametrize(
    ("kelvin", "x", "y"), [(2856, 0.44757, 0.40745), (4000, 0.3805, 0.3768), (6500, 0.3135, 0.3237)]
)
def test_published_chromaticities(kelvin, x, y):
    assert chromaticity(blackbody(kelvin)) == pytest.approx((x, y), abs=5e-4)


def test_the_locus_of_planck_by_the_observer_of_the_cie():
    mi = pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    mi.set_variant("scalar_rgb")
    length_nm = np.arange(360.0, 831.0, 5.0)
    observer = np.array([np.ravel(mi.cie1931_xyz(float(each))) for each in length_nm])
    for kelvin, most in [(2000, 5e-4), (3000, 5e-4), (5000, 5e-4), (10000, 5e-4), (15000, 5e-4), (25000, 2e-3)]:
        x, y, z = length_nm**-5.0 / np.expm1(1.438776877e7 / (length_nm * kelvin)) @ observer
        assert chromaticity(blackbody(kelvin)) == pytest.approx((x / (x + y + z), y / (x + y + z)), abs=most), kelvin


def test_hotter_is_bluer_and_cold_ones_lie_within_the_gamut():
    ratios = [blackbody(kelvin)[2] / blackbody(kelvin)[0] for kelvin in range(2000, 25001, 500)]
    assert (np.diff(ratios) > 0).all()
    assert blackbody(1000.0)[2] == 0.0


def test_texts_that_mean_the_same():
    assert parse_color("warm") == parse_color("2700K") == parse_color(" 2700 k ") == blackbody(2700.0)
    assert parse_color("#FFCC88") == parse_color("ffcc88")
    assert parse_color("red") == parse_color("#ff0000") == parse_color((2.0, 0.0, 0.0))
    assert parse_color("70,55,38") == parse_color([70, 55, 38]) == pytest.approx(parse_color("1.4,1.1,.76"))
    assert parse_color("white") == pytest.approx(WHITE) and parse_color("#808080") == pytest.approx(WHITE)


def test_hexadecimal_colours_are_decoded_from_srgb():
    # 0.5 in sRGB is 0.21404 of the light.
    red, green, blue = parse_color("#ff8000")
    assert green / red == pytest.approx(0.21586, abs=1e-5) and blue == 0.0


@pytest.mark.parametrize(
    "text",
    [
        *("", "999K", "25001K", "infK", "-3000K", "K", "3000C", "#fff", "#gggggg", "#000000", "black", "a\nb"),
        *("1,2", "1,2,3,4", "1,nan,2", "-1,1,1", "1e13,0,0", "0,0,0"),
    ],
)
def test_what_is_no_colour_is_refused_in_one_line(text):
    with pytest.raises(InputError, match=r"^`color`") as caught:
        parse_color(text)
    assert "\n" not in str(caught.value)


def test_a_name_that_is_nearly_right_is_guessed():
    with pytest.raises(InputError, match="did you mean orange"):
        parse_color("ornage")
