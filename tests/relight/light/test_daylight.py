"""The light of a date: where its sun stands in the scene, that no energy is lost, and that a day gets dark."""

import itertools
import subprocess
import sys
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from relight.light import daylight as module
from relight.light import sun_split
from relight.light.daylight import DaylightRequest, day_times, reference_luminance, sky_of
from relight.light.environment import Environment
from relight.light.projections import row_solid_angles, texel_directions
from relight.light.sun_position import sun_position
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import luminance

AREAS, DIRECTIONS = row_solid_angles(module.HEIGHT, module.WIDTH), texel_directions(module.HEIGHT, module.WIDTH)
LEVEL = AREAS * np.maximum(DIRECTIONS[..., 1], 0.0)
PARIS = 48.0, 2.35
ZONE = timezone(timedelta(hours=2))
NOON = datetime(2026, 6, 21, 13, 52, 30, tzinfo=ZONE)  # the sun in the south on 2.35 degrees east


def request(clock, **other):
    return DaylightRequest(datetime.fromisoformat(f"2026-06-21T{clock}+02:00"), *PARIS, **other)


def bright_center(environment, share=0.2):
    """Direction to the centroid of the brightest texels, the light turned as the environment is."""
    bright = luminance(environment.radiance)
    weights = np.where(bright > share * bright.max(), bright, 0.0) * AREAS
    x, y, z = np.einsum("hw,hwc->c", weights, DIRECTIONS)
    angle = np.radians(environment.rotation_deg)
    turned = np.array([np.cos(angle) * x + np.sin(angle) * z, y, np.cos(angle) * z - np.sin(angle) * x])
    return turned / np.linalg.norm(turned)


def test_a_sun_in_the_south_shines_from_plus_z():
    x, y, z = bright_center(DaylightRequest(NOON, *PARIS).environment())
    assert z == pytest.approx(np.cos(np.radians(65.45)), abs=2e-3)
    assert y == pytest.approx(np.sin(np.radians(65.45)), abs=2e-3)
    assert abs(x) < 5e-3  # the azimuth is 180 within .2 degrees


@pytest.mark.parametrize("clock", ["07:10", "10:00", "16:30", "20:45"])
@pytest.mark.parametrize("north_deg", [0.0, 90.0, -20.0])
def test_the_sun_shines_from_its_azimuth_and_elevation_with_north_where_it_is(clock, north_deg):
    asked = request(clock, north_deg=north_deg)
    azimuth, elevation = np.radians(sun_position(asked.time, *PARIS))
    azimuth -= np.radians(north_deg)  # azimuths go clockwise, north is turned counter-clockwise
    level = np.cos(elevation)
    expected = [np.sin(azimuth) * level, np.sin(elevation), -np.cos(azimuth) * level]
    environment = asked.environment()
    assert bright_center(environment) == pytest.approx(expected, abs=4e-3)
    seen = luminance(environment.lookup(np.array([expected])))[0]
    assert seen > 0.3 * luminance(environment.radiance).max()  # between the middles of texels it is a mean of them


def test_north_turns_the_light_as_rotating_it_does():
    plain, turned = request("16:30").environment(), request("16:30", north_deg=35.0).environment()
    np.testing.assert_array_equal(plain.radiance, turned.radiance)
    np.testing.assert_array_equal(plain.rotated(35.0).sh(4), turned.sh(4))


CLOCKS = ["05:52", "06:00", "06:30", "09:00", "13:52", "18:00", "21:30", "21:50", "22:20", "23:40"]


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("air", [{}, {"turbidity": 7.5, "ground_albedo": 0.8}])
def test_the_map_brings_the_models_light_onto_level_ground_split_or_not(clock, air):
    asked = request(clock, **air)
    environment, sky = asked.environment(), sky_of(asked)
    expected = sky.level_irradiance / reference_luminance()
    tolerance = 0.01 * luminance(expected)
    found = np.einsum("hwc,hw->c", environment.radiance.astype(float), LEVEL)
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=0.1 * tolerance)
    rest, suns = sun_split.split(environment)
    found = np.einsum("hwc,hw->c", rest.radiance.astype(float), LEVEL)
    found += np.maximum(suns.directions[:, 1], 0.0) @ suns.weights
    np.testing.assert_allclose(found, expected, rtol=0.01, atol=0.1 * tolerance)
    assert environment.mean_luminance == pytest.approx(sky.mean_luminance / reference_luminance(), rel=3e-3)


@pytest.mark.parametrize("clock", ["05:52", "06:10", "13:52", "19:00"])
def test_the_disc_keeps_its_energy_and_its_place(clock, monkeypatch):
    sky = sky_of(request(clock))
    whole = module.sky_image(sky)
    toward, weights = sky.disc()
    monkeypatch.setattr(type(sky), "disc", lambda self: (np.zeros((0, 3)), np.zeros((0, 3))))
    disc = whole - module.sky_image(sky)  # its ground was computed before
    energy = np.einsum("hwc,hw->c", disc, np.broadcast_to(AREAS, disc.shape[:2]))
    np.testing.assert_allclose(energy, weights.sum(axis=0), rtol=1e-9)
    assert (disc[module.HEIGHT // 2 :] == 0.0).all()
    # Half a degree across, shared by texels of .7 degrees: three in height, as many in width times 1 / cos(elevation).
    lit = np.argwhere(luminance(disc) > 1e-6 * luminance(disc).max())
    assert np.ptp(lit[:, 0]) <= 2 and len(lit) <= 3 * (3 + 2 / np.cos(np.radians(sky.elevation_deg)))
    center = np.einsum("hwc,hw->c", DIRECTIONS, luminance(disc) * AREAS)
    expected = luminance(weights) @ toward
    cosine = float(center @ expected / np.linalg.norm(center) / np.linalg.norm(expected))
    # On the horizon, where nothing may go below, up to half a texel too high.
    assert np.degrees(np.arccos(min(1.0, cosine))) < (0.01 if sky.elevation_deg > 1.0 else 0.36)


def test_a_clear_noon_in_june_is_as_bright_as_the_built_in_noon():
    built_in, found = (
        Environment.load("noon").mean_luminance,
        DaylightRequest(NOON, *PARIS).environment().mean_luminance,
    )
    assert built_in == pytest.approx(1.0, rel=1e-5)
    assert found == pytest.approx(1.0, rel=2e-3)  # the reference's sun is at 65.4, this one at 65.45 degrees
    assert 1.4e4 < reference_luminance() < 1.7e4  # cd/m^2


def test_a_day_gets_light_and_dark_in_true_ratio():
    times = day_times("05:00-24:00/60min", NOON)
    means = np.array([DaylightRequest(time, *PARIS).environment().mean_luminance for time in times])
    elevations = np.array([sun_position(time, *PARIS).elevation_deg for time in times])
    order = np.argsort(elevations)
    assert (np.diff(means[order]) > 0.0).all()
    assert means.max() == pytest.approx(1.0, rel=0.01)
    assert 0.0 < means.min() < 1e-6  # the sun is 15 degrees down at midnight
    setting = np.interp(0.0, elevations[order], means[order])
    assert 0.02 < setting < 0.1


def test_the_night_is_a_finite_dim_blue_everywhere():
    image = DaylightRequest(datetime(2026, 12, 21, 23, tzinfo=timezone.utc), *PARIS).environment().radiance
    assert np.isfinite(image).all() and image.min() > 0.0
    assert luminance(image).max() < 1e-7
    assert (image[..., 2] > 2.0 * image[..., 0]).all()


def test_every_hour_of_the_year_everywhere_gives_light_that_can_be_used(monkeypatch):
    monkeypatch.setattr(module, "HEIGHT", 32)
    monkeypatch.setattr(module, "WIDTH", 64)
    rng = np.random.default_rng(3)
    for _ in range(150):
        time = datetime(2026, 1, 1, tzinfo=timezone.utc) + timedelta(hours=rng.uniform(0, 8760))
        place = rng.uniform(-90, 90), rng.uniform(-180, 180)
        asked = DaylightRequest(time, *place, 0.0, rng.uniform(1, 10), rng.uniform(0, 1))
        image = asked.environment().radiance  # a repair would warn
        assert np.isfinite(image).all() and image.max() > 0.0


def test_the_same_request_gives_the_same_bytes():
    first, second = request("19:30").environment(), request("19:30").environment()
    assert first.radiance.tobytes() == second.radiance.tobytes()
    assert first.radiance.dtype == np.float32 and first.radiance.shape == (256, 512, 3) == (*AREAS.shape[:1], 512, 3)


def test_requests_are_read_from_what_people_type():
    asked = DaylightRequest.parse("2026-06-21T19:30+02:00", "48.85,2.35", 20)
    assert asked == DaylightRequest(datetime(2026, 6, 21, 19, 30, tzinfo=ZONE), 48.85, 2.35, 20.0, 3.0, 0.3)
    assert asked.name == asked.environment().name == "sun-2026-06-21T1930"
    assert asked.environment().rotation_deg == 20.0
    later = asked.at_time(asked.time + timedelta(seconds=5))
    assert later.name == "sun-2026-06-21T193005" and later.north_deg == 20.0


@pytest.mark.parametrize(
    ("sun", "at", "north", "says"),
    [
        ("2026-06-21T19:30", "48.85,2.35", 0.0, "has no zone"),
        ("2026-06-21T19:30Z", "98.85,2.35", 0.0, "latitude"),
        ("2026-06-21T19:30Z", "48.85,2.35", float("nan"), "`north_deg`"),
    ],
)
def test_requests_that_cannot_be_met_are_refused(sun, at, north, says):
    with pytest.raises(InputError, match=says):
        DaylightRequest.parse(sun, at, north)


@pytest.mark.parametrize(
    ("air", "says"),
    [
        ({"turbidity": 0.5}, "`turbidity`"),
        ({"turbidity": float("nan")}, "`turbidity`"),
        ({"ground_albedo": 1.5}, "`ground_albedo`"),
    ],
)
def test_air_that_is_none_is_refused(air, says):
    with pytest.raises(InputError, match=says):
        request("12:00", **air)


def test_reading_a_request_loads_nothing_heavy():
    code = (
        "import sys; from relight.light.daylight import DaylightRequest as R, day_times\n"
        "day_times('05:00-21:30/15min', R.parse('2026-06-21T19:30+02:00', '48.85,2.35').time)\n"
        "print({'numpy', 'scipy', 'numba', 'open3d', 'astral'} & sys.modules.keys())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_day_runs_from_its_first_to_its_last_time():
    times = day_times("05:00-21:30/15min", NOON)
    assert len(times) == 67
    assert times[0] == datetime(2026, 6, 21, 5, tzinfo=ZONE) and times[-1] == datetime(2026, 6, 21, 21, 30, tzinfo=ZONE)
    assert {late - early for early, late in itertools.pairwise(times)} == {timedelta(minutes=15)}
    assert all(time.utcoffset() == timedelta(hours=2) for time in times)


@pytest.mark.parametrize(
    ("text", "count", "last"),
    [
        ("5:00-6:10/30min", 3, "06:00"),
        (" 05:00 - 06:00 / 0.5h ", 3, "06:00"),
        ("00:00-24:00/8s", None, None),
        ("00:00-23:59/24s", 3598, "23:58:48"),
        ("00:00-24:00/12h", 3, "00:00"),
    ],
)
def test_days_are_read(text, count, last):
    if count is None:
        with pytest.raises(InputError, match="10801 steps"):
            day_times(text, NOON)
        return
    times = day_times(text, NOON)
    assert len(times) == count and times[-1].time().isoformat("seconds").startswith(last)


def test_a_day_on_which_clocks_change_has_even_steps():
    zoneinfo = pytest.importorskip("zoneinfo")
    try:
        paris = zoneinfo.ZoneInfo("Europe/Paris")
    except zoneinfo.ZoneInfoNotFoundError:
        pytest.skip("no table of time zones here")
    times = day_times("00:00-06:00/1h", datetime(2026, 3, 29, 12, tzinfo=paris))
    assert [time.hour for time in times] == [0, 1, 3, 4, 5, 6]  # the hour after two is left out


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("21:30-05:00/15min", "ends before it begins"),
        ("05:00-05:00/15min", "ends before it begins"),
        ("05:00-21:30/0min", "below a second"),
        ("05:00-21:30/0.5s", "below a second"),
        ("00:00-23:00/1s", "82801 steps"),
        ("25:00-26:00/15min", "not a time of day"),
        ("05:60-06:00/15min", "not a time of day"),
        ("24:01-24:02/15min", "not a time of day"),
        ("05:00-21:30", "is not a range of times"),
        ("05:00-21:30/15", "is not a range of times"),
        ("", "is not a range of times"),
    ],
)
def test_days_that_are_none_are_refused(text, says):
    with pytest.raises(InputError, match=says) as caught:
        day_times(text, NOON)
    assert "\n" not in str(caught.value)


def test_a_day_without_a_zone_is_refused():
    with pytest.raises(InputError, match="has no zone"):
        day_times("05:00-21:30/15min", datetime(2026, 6, 21))
