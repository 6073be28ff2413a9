"""The sun of a capture as a person knows it: by the time and the place, by its angles, or as a direction.

captured_sun("2026-06-21T15:00+02:00 at=48.85,2.35 north=20")
captured_sun("210,35 north=20")      azimuth and height in degrees
"""

import math
from collections.abc import Sequence
from typing import NoReturn

from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import parse_spec, plain

from .daylight import DaylightRequest
from .sun_position import sun_position, toward

_EXPECTED = "expected a time with its zone and a place, or azimuth and height, such as 210,35"


def captured_sun(said: DaylightRequest | str | Sequence[float]) -> tuple[float, float, float]:
    """Return the unit direction toward the captured sun, scene frame.

    said: a time and a place with its north; a text, as above; (azimuth, height) in degrees, of a scene whose north is
    -z; or a direction (x, y, z) of any length. Raises InputError for another form, a time without a zone or a place, a
    place that is not on the Earth, and a sun that is not above the horizon.
    """
    if isinstance(said, DaylightRequest):
        return _of_date(said, said.time.isoformat(timespec="minutes"))
    if isinstance(said, str):
        return _of_text(said.strip())
    try:
        values = [float(each) for each in said]
    except (TypeError, ValueError):
        values = []
    if len(values) == 2:
        return _of_angles(values[0], values[1], 0.0, f"{values[0]:g},{values[1]:g}")
    length = math.hypot(*values) if len(values) == 3 else math.nan
    if not 0.0 < length < math.inf:
        _refuse(str(said), _EXPECTED)
    if values[1] <= 0.0:
        _refuse(str(said), "the sun must be above the horizon, y above 0")
    x, y, z = values if math.isclose(length, 1.0) else (each / length for each in values)
    return x, y, z


def _of_text(text: str) -> tuple[float, float, float]:
    try:
        value, given = parse_spec(text)
    except InputError as error:
        _refuse(text, plain(error))
    if given.keys() - {"at", "north"}:
        _refuse(text, _EXPECTED)
    try:
        north_deg = float(given.get("north", 0.0))
    except ValueError:
        north_deg = math.nan
    if not math.isfinite(north_deg):
        _refuse(value, f"expected degrees as its north, found {given['north']}")
    if "," in value:
        if "at" in given:
            _refuse(value, "an azimuth and a height need no `at`; leave it out")
        try:
            azimuth, height = (float(each) for each in value.split(","))
        except ValueError:
            _refuse(value, _EXPECTED)
        return _of_angles(azimuth, height, north_deg, value)
    if ":" not in value:
        _refuse(value, _EXPECTED)
    if "at" not in given:
        _refuse(value, "give the latitude and longitude too, as `at`, such as 48.85,2.35")
    try:
        asked = DaylightRequest.parse(value, given["at"], north_deg)
    except InputError as error:
        raise InputError(f"`captured_sun`: {error}") from None
    return _of_date(asked, value)


def _of_date(asked: DaylightRequest, shown: str) -> tuple[float, float, float]:
    azimuth, height = sun_position(asked.time, asked.latitude_deg, asked.longitude_deg)
    if height <= 0.0:
        problem = f"the sun was {-height:.1f} degrees below the horizon there"
        _refuse(shown, f"{problem}; check the time, its zone and the place")
    return toward(azimuth, height, asked.north_deg)


def _of_angles(azimuth_deg: float, height_deg: float, north_deg: float, shown: str) -> tuple[float, float, float]:
    if not math.isfinite(azimuth_deg):
        _refuse(shown, _EXPECTED)
    if not 0.0 < height_deg <= 90.0:
        _refuse(shown, "expected a height above the horizon, up to 90 degrees")
    return toward(azimuth_deg, height_deg, north_deg)


def _refuse(shown: str, problem: str) -> NoReturn:
    raise InputError(f"`captured_sun` {shown}: {problem}")
