"""The captured sun as a person says it: every form gives one direction, and what means none is refused in one line."""

from datetime import datetime

import numpy as np
import pytest

from relight.light.daylight import DaylightRequest, captured_sun, sky_of
from relight.light.sun_position import sun_position, toward
from splat2mesh.base.errors import InputError

TIME, PARIS = "2026-06-21T15:00+02:00", "48.85,2.35"


def test_a_time_gives_the_sun_that_the_sky_of_that_date_has():
    asked = DaylightRequest.parse(TIME, PARIS)
    sky = sky_of(asked).disc()[0].mean(axis=0)  # of a disc, so its middle
    found = captured_sun(f"{TIME} at={PARIS}")
    np.testing.assert_allclose(found, sky / np.linalg.norm(sky), atol=1e-4)
    assert captured_sun(asked) == found
    azimuth, height = sun_position(datetime.fromisoformat(TIME), 48.85, 2.35)
    assert captured_sun((azimuth, height)) == found


def test_north_turns_the_sun_as_it_turns_the_sky_of_a_date():
    asked = DaylightRequest.parse(TIME, PARIS, 20.0)
    light = asked.environment()
    x, y, z = captured_sun(f"{TIME} at={PARIS} north=20")
    assert captured_sun(asked) == (x, y, z)
    # A texel is 0.7 degrees: where the sun is said to be the sky is bright, and five degrees beside it is not.
    at, beside = light.lookup([[x, y, z], [x + 0.09, y, z]]).mean(axis=1)
    assert at > 50.0 * beside


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ("0,45", (0.0, 0.5**0.5, -(0.5**0.5))),  # north is -z
        ("90,30", (0.75**0.5, 0.5, 0.0)),  # east is +x: clockwise from above
        ("-90,30", (-(0.75**0.5), 0.5, 0.0)),
        ("0,30 north=90", (-(0.75**0.5), 0.5, 0.0)),  # turned counter-clockwise from above, north is -x
        ((180.0, 90.0), (0.0, 1.0, 0.0)),
        ((0.0, 2.0, 2.0), (0.0, 0.5**0.5, 0.5**0.5)),
    ],
)
def test_angles_and_directions(said, expected):
    np.testing.assert_allclose(captured_sun(said), expected, atol=1e-12)


def test_a_direction_that_was_kept_stays_to_the_bit():
    found = captured_sun("211.3,34.7 north=12")
    assert captured_sun(found) == found
    np.testing.assert_allclose(found, toward(199.3, 34.7), atol=1e-12)


@pytest.mark.parametrize(
    ("said", "problem"),
    [
        ("noon", "expected a time with its zone and a place, or azimuth and height"),
        ("2026-06-21T25:00+02:00 at=48,2", "is not a date with a time and a zone"),
        ("2026-06-21T15:00 at=48,2", "has no zone"),
        (TIME, "give the latitude and longitude too, as `at`"),
        (f"{TIME} at=98,2", "a latitude must be from -90 to 90 degrees, found 98"),
        (f"{TIME} at=48", "is not a place"),
        (f"{TIME} at=48,2 north=up", "expected degrees as its north, found up"),
        (f"{TIME} at=48,2 at=49,2", "at: given twice"),
        ("2026-06-21T01:00+02:00 at=48,2", "17.5 degrees below the horizon"),
        ("210,35 at=48,2", "need no `at`"),
        ("210,-3", "expected a height above the horizon"),
        ("210,91", "expected a height above the horizon"),
        ("nan,3", "expected a time"),
        ("1,2,3", "expected a time"),
        ((1.0, -1.0, 0.0), "above the horizon"),
        ((0.0, 0.0, 0.0), "expected a time"),
        (7, "expected a time"),
    ],
)
def test_what_means_no_sun_is_refused_in_one_line(said, problem):
    with pytest.raises(InputError, match="`captured_sun`") as caught:
        captured_sun(said)
    assert problem in str(caught.value) and "\n" not in str(caught.value)
