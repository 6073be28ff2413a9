"""relight.lamps.asked: what is asked for in any unit is what comes of it."""

from dataclasses import replace

import numpy as np
import pytest

from relight.lamps.asked import (
    BULB_M,
    TUBE_M,
    AskedLamp,
    Brightness,
    LampScale,
    in_words,
    luminance,
    parse_brightness,
    parse_color,
    resolve,
)
from relight.lamps.photometry import axis_intensity, flux
from relight.lamps.shapes import MeshLamp, ProfileLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp, shifted
from splat2mesh.base.errors import InputError

ONE = (1.0, 1.0, 1.0)
SHAPES = [
    SphereLamp((1.0, 2.0, 3.0), 0.1, ONE),
    SphereLamp((1.0, 2.0, 3.0), intensity=ONE),
    SpotLamp((0.0, 1.0, 0.0), (0.0, 0.0, 0.0), ONE, 25.0, 20.0),
    RectangleLamp((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.5, 0.5), ONE),
    TubeLamp((0.0, 0.0, 0.0), (1.0, 1.0, 0.0), 0.02, ONE),
    MeshLamp(np.eye(3), np.array([[0, 1, 2]]), np.array([0.2, 0.4, 0.1]), two_sided=True),
    ProfileLamp(
        (0.0, 0.0, 0.0),
        (0.0, -1.0, 0.0),
        ONE,
        np.array([0.0, 90.0]),
        np.array([0.0, 360.0]),
        np.array([[1, 1], [0, 3]]),
    ),
]
SCALES = [LampScale(1.0, 2.0, 0.01), LampScale(0.37, 0.4, 1e-4)]


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shape", SHAPES)
def test_ev_is_the_irradiance_at_a_metre_against_the_median(shape, scale):
    for ev in (-3.0, 0.0, 2.5):
        lamp = resolve(AskedLamp(shape, Brightness(ev, "EV"), parse_color("3000K")), scale)
        at_a_metre = luminance(axis_intensity(lamp)) / scale.metre**2
        assert at_a_metre == pytest.approx(2.0**ev * scale.irradiance)


@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("shape", SHAPES)
def test_lumens_and_candela_are_kept(shape, scale):
    unit = scale.candela * scale.metre**2
    lamp = resolve(AskedLamp(shape, Brightness(800.0, "lumen"), parse_color("warm")), scale)
    assert luminance(flux(lamp)) / unit == pytest.approx(800.0)
    lamp = resolve(AskedLamp(shape, Brightness(50.0, "candela"), parse_color("warm")), scale)
    assert luminance(axis_intensity(lamp)) / unit == pytest.approx(50.0)


def test_a_bulb_of_800_lumens_has_64_candela():
    bulb = AskedLamp(SHAPES[0], Brightness(800.0, "lumen"))
    same = AskedLamp(SHAPES[0], Brightness(800.0 / (4.0 * np.pi), "candela"))
    assert resolve(bulb, SCALES[0]).radiance == pytest.approx(resolve(same, SCALES[0]).radiance)


@pytest.mark.parametrize("shape", SHAPES)
def test_units_of_the_picture_are_taken_as_they_are(shape):
    for scale in SCALES:
        lamp = resolve(AskedLamp(shape, Brightness(2.0, "picture"), (3.0, 2.0, 1.0)), scale)
        assert axis_intensity(lamp) == pytest.approx(axis_intensity(shape) * [6.0, 4.0, 2.0])


def test_the_color_is_that_of_the_light_and_no_brighter():
    color = parse_color("#ff8000")
    lamp = resolve(AskedLamp(SHAPES[0], Brightness(1.0), color), SCALES[0])
    assert np.array(lamp.radiance) / luminance(lamp.radiance) == pytest.approx(color)
    white = resolve(AskedLamp(SHAPES[0], Brightness(1.0)), SCALES[0])
    assert luminance(white.radiance) == pytest.approx(luminance(lamp.radiance))


def test_radii_that_nobody_named_are_in_metres():
    scale = LampScale(0.2, 1.0)
    bulb = AskedLamp(SphereLamp((0.0, 0.0, 0.0), BULB_M, ONE), radius_in_metres=True)
    assert resolve(bulb, scale).radius == pytest.approx(0.01)
    tube = AskedLamp(TubeLamp((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), TUBE_M, ONE), radius_in_metres=True)
    assert resolve(tube, scale).radius == pytest.approx(0.0026)
    assert resolve(replace(bulb, radius_in_metres=False), scale).radius == BULB_M


@pytest.mark.parametrize("shape", SHAPES)
def test_words_state_where_the_lamp_is_as_bright_as_the_room(shape):
    for scale in SCALES:
        lamp = resolve(AskedLamp(shape, Brightness(2.0)), scale)  # four times at 1 m: once at 2 m
        assert in_words(lamp, replace(scale, candela=None)) == "as bright as the room at 2 m"
        assert in_words(resolve(AskedLamp(shape, Brightness(800.0, "lumen")), scale), scale).endswith(" m, 800 lm")
        assert in_words(resolve(AskedLamp(shape, Brightness(0.0, "picture")), scale), scale) == "dark"
    lamp = resolve(AskedLamp(shape, Brightness(np.log2(1.3**2))), scale)
    assert in_words(lamp, replace(scale, candela=None), "garden") == "as bright as the garden at 1.3 m"


@pytest.mark.parametrize("shape", SHAPES)
def test_moving_there_and_back(shape):
    there = shifted(shape, (1.0, -2.0, 0.5))
    assert luminance(flux(there)) == pytest.approx(luminance(flux(shape)))
    back = shifted(there, (-1.0, 2.0, -0.5))
    for name in ("position", "target", "center", "start", "end", "vertices"):
        if hasattr(shape, name):
            assert np.allclose(getattr(there, name), np.add(getattr(shape, name), (1.0, -2.0, 0.5)))
            assert np.allclose(getattr(back, name), getattr(shape, name))


@pytest.mark.parametrize(
    ("text", "value", "unit"),
    [
        *(("+1EV", 1.0, "EV"), ("-0.5 ev", -0.5, "EV"), ("2EV", 2.0, "EV")),
        *(("800lm", 800.0, "lumen"), ("1e3 lumen", 1000.0, "lumen"), ("50cd", 50.0, "candela")),
        *(("50 candela", 50.0, "candela"), ("0lm", 0.0, "lumen")),
    ],
)
def test_brightness_as_people_write_it(text, value, unit):
    assert parse_brightness(text) == Brightness(value, unit)


@pytest.mark.parametrize(
    "text", ["", "5", "EV", "1.2.3EV", "5 W", "nanEV", "-5lm", "1e999cd", "41EV", "1e13lm", "1\n2"]
)
def test_what_is_no_brightness_is_refused_in_one_line(text):
    with pytest.raises(InputError, match=r"^`brightness`") as caught:
        parse_brightness(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("unit", ["lumen", "candela"])
def test_lumens_need_a_scale(unit):
    with pytest.raises(InputError, match=r"nothing says how many candela .* give the brightness in EV"):
        resolve(AskedLamp(SHAPES[0], Brightness(8.0, unit)), LampScale(1.0, 2.0))


def test_a_lamp_without_light_is_not_made_bright():
    dark = AskedLamp(SphereLamp((0.0, 0.0, 0.0), 0.1, (0.0, 0.0, 0.0)))
    with pytest.raises(InputError, match="no light to scale"):
        resolve(dark, SCALES[0])
    assert resolve(replace(dark, brightness=Brightness(0.0, "lumen")), SCALES[0]).radiance == (0.0, 0.0, 0.0)


def test_too_bright_is_refused():
    tiny = AskedLamp(SphereLamp((0.0, 0.0, 0.0), 1e-9, ONE), Brightness(1.0))
    with pytest.raises(InputError, match="expected numbers from 0 to 1e"):
        resolve(tiny, SCALES[0])


@pytest.mark.parametrize("bad", [{"metre": 0.0}, {"irradiance": np.nan}, {"candela": -1.0}])
def test_scales_are_positive(bad):
    with pytest.raises(InputError, match=f"`{next(iter(bad))}`"):
        LampScale(**({"metre": 1.0, "irradiance": 1.0} | bad))


def test_units_are_known():
    with pytest.raises(InputError, match="expected one of picture, EV, lumen, candela"):
        Brightness(1.0, "watt")
