"""Where the sun stands: against the almanac's formulas, published places and what holds at poles and on the equator."""

import math
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from relight.light.sun_position import parse_place, parse_time, sun_position
from splat2mesh.base.errors import InputError

UTC = timezone.utc


def unit(azimuth_deg, elevation_deg):
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    level = math.cos(elevation)
    return np.array([math.sin(azimuth) * level, math.cos(azimuth) * level, math.sin(elevation)])


def apart_deg(a, b):
    return math.degrees(2.0 * math.asin(np.linalg.norm(unit(*a) - unit(*b)) / 2.0))


def without_refraction(position):
    """The geometric elevation by bisection of Bennett's formula (1982), which the module does not use."""
    low, high = position.elevation_deg - 1.0, position.elevation_deg + 0.1
    for _ in range(60):
        middle = 0.5 * (low + high)
        seen = middle + 1.02 / 60.0 / math.tan(math.radians(middle + 10.3 / (middle + 5.11)))
        low, high = (middle, high) if seen < position.elevation_deg else (low, middle)
    return position.azimuth_deg, middle


def almanac(time, latitude_deg, longitude_deg):
    """Low-precision formulas of the Astronomical Almanac, .01 degrees from 1950 to 2050, without refraction.

    Through right ascension and sidereal time, where the module goes through the equation of time.
    """
    days = (time - datetime(2000, 1, 1, 12, tzinfo=UTC)) / timedelta(days=1)
    anomaly = math.radians(357.528 + 0.9856003 * days)
    longitude = 280.460 + 0.9856474 * days + 1.915 * math.sin(anomaly) + 0.020 * math.sin(2.0 * anomaly)
    longitude, obliquity = math.radians(longitude), math.radians(23.439 - 4e-7 * days)
    ascension = math.atan2(math.cos(obliquity) * math.sin(longitude), math.cos(longitude))
    declination = math.asin(math.sin(obliquity) * math.sin(longitude))
    sidereal = math.radians(280.46062 + 360.98564737 * days + longitude_deg)
    hour, latitude = sidereal - ascension, math.radians(latitude_deg)
    up = math.sin(latitude) * math.sin(declination) + math.cos(latitude) * math.cos(declination) * math.cos(hour)
    south = math.cos(hour) * math.sin(latitude) - math.tan(declination) * math.cos(latitude)
    azimuth = 180.0 + math.degrees(math.atan2(math.sin(hour), south))
    return azimuth % 360.0, math.degrees(math.asin(up))


def test_it_agrees_with_the_almanac_anywhere_at_any_time():
    rng = np.random.default_rng(0)
    compared = 0
    for _ in range(500):
        time = datetime(1950, 1, 1, tzinfo=UTC) + timedelta(days=rng.uniform(0, 36524))
        place = rng.uniform(-90, 90), rng.uniform(-180, 180)
        found = sun_position(time, *place)
        if found.elevation_deg < 3.0:  # below, two formulas of refraction differ by more than the places
            continue
        compared += 1
        # .01 of the almanac, .02 of the module, .003 between Bennett's refraction and NOAA's.
        assert apart_deg(without_refraction(found), almanac(time, *place)) < 0.033
    assert compared > 150


@pytest.mark.parametrize(
    ("time", "place", "azimuth_deg", "elevation_deg"),
    [
        ("2026-06-21T19:30+02:00", (48.85, 2.35), 282.0017, 21.0113),
        ("1875-01-10T09:00Z", (-33.92, 18.42), 71.9889, 62.2739),
        ("2100-03-20T12:00+00:00", (0.0, 0.5), 90.7641, 88.6530),
        ("2026-09-01T03:00Z", (90.0, 0.0), 44.9682, 8.3001),
    ],
)
def test_it_agrees_with_astropy(time, place, azimuth_deg, elevation_deg):
    """Apparent places of astropy 8.0.2 (get_sun, AltAz without pressure)."""
    found = without_refraction(sun_position(parse_time(time), *place))
    assert apart_deg(found, (azimuth_deg, elevation_deg)) < 0.02


def test_it_agrees_with_the_published_example_of_the_solar_position_algorithm():
    """Reda and Andreas 2004, NREL/TP-560-34302, table A5.1, refraction included."""
    found = sun_position(parse_time("2003-10-17T12:30:30-07:00"), 39.742476, -105.1786)
    assert apart_deg(found, (194.34024, 90.0 - 50.11162)) < 0.02


def test_zones_are_other_names_for_the_same_moment():
    first = sun_position(parse_time("2026-06-21T19:30+02:00"), 48.85, 2.35)
    assert first == sun_position(parse_time("2026-06-21T17:30Z"), 48.85, 2.35)
    assert first == sun_position(parse_time("2026-06-22T02:30:00+0900"), 48.85, 2.35)
    assert first == sun_position(parse_time(" 2026-06-21 12:30-05 "), 48.85, 2.35)


def test_a_day_at_an_equinox_lasts_from_east_over_the_zenith_to_west():
    day = datetime(2026, 3, 20, tzinfo=UTC)
    morning, noon, evening = (sun_position(day + timedelta(hours=hour), 0.0, 1.85) for hour in (7, 12, 17))
    # The equation of time is -7.4 minutes: noon is at 12:00 on 1.85 degrees east. The sun goes 15 degrees an hour.
    assert morning.azimuth_deg == pytest.approx(90.0, abs=0.2)
    assert evening.azimuth_deg == pytest.approx(270.0, abs=0.2)
    assert morning.elevation_deg == pytest.approx(15.0, abs=0.2)
    assert noon.elevation_deg > 89.5


@pytest.mark.parametrize(("latitude_deg", "south_or_north"), [(48.0, 180.0), (-48.0, 0.0)])
def test_the_sun_stands_highest_in_the_south_or_in_the_north(latitude_deg, south_or_north):
    day = [datetime(2026, 6, 21, tzinfo=UTC) + timedelta(minutes=each) for each in range(1440)]
    positions = [sun_position(time, latitude_deg, 0.0) for time in day]
    highest = max(positions, key=lambda position: position.elevation_deg)
    assert abs((highest.azimuth_deg - south_or_north + 180.0) % 360.0 - 180.0) < 0.5  # a minute moves it .5 at most
    above = highest.elevation_deg - (90.0 - abs(latitude_deg - 23.44))
    assert 0.0 < above < 0.06  # refraction lifts it by .05 degrees at 18.6, by .007 at 65.4


def test_polar_night_and_polar_day_last_all_day():
    for day, up in ((datetime(2026, 12, 21, tzinfo=UTC), False), (datetime(2026, 6, 21, tzinfo=UTC), True)):
        found = [sun_position(day + timedelta(minutes=20 * step), 78.22, 15.65).elevation_deg for step in range(72)]
        assert all((elevation > 0.0) == up for elevation in found)
    assert min(found) == pytest.approx(78.22 + 23.44 - 90.0, abs=0.1)  # refraction at 12 degrees: .075


@pytest.mark.parametrize("latitude_deg", [-90.0, 90.0])
def test_at_a_pole_the_sun_goes_round_at_one_height(latitude_deg):
    day = datetime(2026, 6, 21, tzinfo=UTC)
    found = [sun_position(day + timedelta(hours=hour), latitude_deg, 0.0) for hour in range(25)]
    assert np.ptp([each.elevation_deg for each in found]) < 0.01
    turned = np.diff([each.azimuth_deg for each in found]) % 360.0
    assert turned == pytest.approx(np.full(24, 15.0 if latitude_deg > 0 else 345.0), abs=0.01)


def test_places_are_read():
    assert parse_place("48.85,2.35") == (48.85, 2.35)
    assert parse_place(" -33.9 , -70.7 ") == (-33.9, -70.7)
    assert parse_place("90,-180") == (90.0, -180.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("2026-06-21T19:30", "has no zone"),
        ("2026-06-21", "no time of day"),
        ("2026-13-21T19:30Z", "is not a date"),
        ("noon", "is not a date"),
        ("", "is not a date"),
        ("19:30", "is not a date"),
        ("2026-06-21T19:30+99", "is not a date"),
        ("1066-10-14T09:00Z", "years 1600 to 2399"),
    ],
)
def test_dates_that_are_none_are_refused_in_one_line(text, says):
    with pytest.raises(InputError, match=says) as caught:
        parse_time(text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("90.1,0", "latitude"),
        ("-91,0", "latitude"),
        ("0,180.5", "longitude"),
        ("0,-181", "longitude"),
        ("nan,0", "latitude"),
        ("0,inf", "longitude"),
        ("48.85", "is not a place"),
        ("48.85,2.35,0", "is not a place"),
        ("Paris", "is not a place"),
    ],
)
def test_places_that_are_none_are_refused_in_one_line(text, says):
    with pytest.raises(InputError, match=says) as caught:
        parse_place(text)
    assert "\n" not in str(caught.value)


def test_a_time_without_a_zone_is_refused_by_the_position_too():
    with pytest.raises(InputError, match="has no zone"):
        sun_position(datetime(2026, 6, 21, 12), 48.0, 2.0)
    with pytest.raises(InputError, match="latitude"):
        sun_position(datetime(2026, 6, 21, 12, tzinfo=UTC), math.nan, 2.0)
