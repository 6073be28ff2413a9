"""The position of the sun: from a date with its zone and a place on the Earth to azimuth and elevation.

The sun's declination and the equation of time are those of astral, which has them from NOAA. All else is geometry.
"""

import math
import re
from datetime import datetime, timedelta, timezone
from typing import NamedTuple

from splat2mesh.base.errors import InputError

FIRST_YEAR, LAST_YEAR = 1600, 2399
"""Years for which positions were compared with those of astropy."""

_NOON_OF_2000 = datetime(2000, 1, 1, 12, tzinfo=timezone.utc)  # J2000
_DAYS_PER_CENTURY = 36525.0
_ZONE = re.compile(r"^(.*\d)([+-]\d\d)(\d\d)?$")  # +02 and +0200, which Python 3.10 does not read


class SunPosition(NamedTuple):
    """Direction toward the middle of the sun's disc, as a person sees it.

    azimuth_deg: from true north, clockwise seen from above, in [0, 360).
    elevation_deg: above the horizon, raised by the refraction of the air; below 0 the sun is down.
    """

    azimuth_deg: float
    elevation_deg: float


def sun_position(time: datetime, latitude_deg: float, longitude_deg: float) -> SunPosition:
    """Return where the sun stands; at a zenith or a pole, where the azimuth means nothing, it is still a number.

    time: with a zone. latitude_deg, longitude_deg: north and east positive. Raises InputError for a time without a zone
    or beyond `FIRST_YEAR` to `LAST_YEAR`, and for a place that is not on the Earth.

    Within .02 degrees of astropy's apparent places, refraction aside (docs/daylight.md). Refraction is NOAA's fit for
    the standard atmosphere at sea level, which true air leaves by tenths of a degree near the horizon.
    """
    from astral import refraction_at_zenith
    from astral.sun import eq_of_time, sun_declination

    check_time(time)
    check_place(latitude_deg, longitude_deg)
    days = (time - _NOON_OF_2000) / timedelta(days=1)
    centuries = days / _DAYS_PER_CENTURY
    declination, latitude = math.radians(sun_declination(centuries)), math.radians(latitude_deg)
    turned_deg = 360.0 * (days % 1.0) + longitude_deg + eq_of_time(centuries) / 4.0  # a degree in four minutes
    hour_angle = math.radians(turned_deg)  # 0 where the sun stands highest
    east = -math.cos(declination) * math.sin(hour_angle)
    toward_equator = math.cos(declination) * math.cos(hour_angle)
    north = math.sin(declination) * math.cos(latitude) - toward_equator * math.sin(latitude)
    up = math.sin(declination) * math.sin(latitude) + toward_equator * math.cos(latitude)
    elevation_deg = math.degrees(math.atan2(up, math.hypot(east, north)))
    azimuth_deg = math.degrees(math.atan2(east, north)) % 360.0
    return SunPosition(azimuth_deg % 360.0, elevation_deg + refraction_at_zenith(90.0 - elevation_deg))


def toward(azimuth_deg: float, elevation_deg: float, north_deg: float = 0.0) -> tuple[float, float, float]:
    """Return the unit direction toward a sun in a frame whose +y is up.

    azimuth_deg: from north, clockwise seen from above. elevation_deg: above the horizon. north_deg: by how much north
    is turned about +y from -z, counter-clockwise seen from above; at 0 east is +x.
    """
    azimuth, elevation = math.radians(azimuth_deg - north_deg), math.radians(elevation_deg)
    level = math.cos(elevation)
    return math.sin(azimuth) * level, math.sin(elevation), -math.cos(azimuth) * level


def parse_time(text: str) -> datetime:
    """Read a date with its time and zone, such as 2026-06-21T19:30+02:00; the zone may also be +0200, +02 or Z.

    Raises InputError for another form, a date without a time or a zone, and a year beyond `FIRST_YEAR` to `LAST_YEAR`.
    """
    example = "2026-06-21T19:30+02:00"
    plain = text.strip()
    if plain[-1:] in ("Z", "z"):
        plain = plain[:-1] + "+00:00"
    zone = _ZONE.match(plain) if ":" in plain else None
    if zone is not None:
        plain = f"{zone[1]}{zone[2]}:{zone[3] or '00'}"
    try:
        time = datetime.fromisoformat(plain)
    except ValueError:
        raise InputError(f"{text!r} is not a date with a time and a zone: write it as {example}") from None
    if ":" not in plain:
        raise InputError(f"{text!r} has no time of day: write it as {example}")
    check_time(time)
    return time


def parse_place(text: str) -> tuple[float, float]:
    """Read (latitude_deg, longitude_deg), north and east positive, of a text such as 48.85,2.35.

    Raises InputError for another form, a latitude beyond 90 and a longitude beyond 180 degrees.
    """
    try:
        latitude, longitude = (float(part) for part in text.split(","))
    except ValueError:
        message = f"{text!r} is not a place: write latitude and longitude in degrees, such as 48.85,2.35"
        raise InputError(message) from None
    check_place(latitude, longitude)
    return latitude, longitude


def check_time(time: datetime) -> None:
    """Raise InputError for a time without a zone, and for a year for which positions were not verified."""
    if time.utcoffset() is None:
        raise InputError(
            f"{time.isoformat(timespec='minutes')} has no zone: add it, such as +02:00, or Z for universal time"
        )
    if not FIRST_YEAR <= time.year <= LAST_YEAR:
        raise InputError(f"the sun is known for the years {FIRST_YEAR} to {LAST_YEAR}, found {time.year}")


def check_place(latitude_deg: float, longitude_deg: float) -> None:
    """Raise InputError for a latitude beyond 90, a longitude beyond 180, or what is no number."""
    if not abs(latitude_deg) <= 90.0:
        raise InputError(f"a latitude must be from -90 to 90 degrees, found {latitude_deg:g}: is it the longitude?")
    if not abs(longitude_deg) <= 180.0:
        raise InputError(f"a longitude must be from -180 to 180 degrees, found {longitude_deg:g}")
