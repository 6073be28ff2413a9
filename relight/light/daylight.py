"""The light of a date and a place: the sky's model as an environment, with north as the scene has it.

    request = DaylightRequest.parse("2026-06-21T19:30+02:00", "48.85,2.35", north_deg=20)
    environment = request.environment()

One scale for all: radiance 1 is the mean luminance of a clear noon in June at 48 degrees, as the built-in sky `noon`
has it, so dawn, dusk and night have their true relative darkness.
"""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone
from functools import lru_cache
from typing import TYPE_CHECKING, NoReturn

from splat2mesh.base.choices import MOST_STEPS
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import parse_spec, plain

from . import HEIGHT, WIDTH
from .sun_position import check_place, check_time, parse_place, parse_time, sun_position, toward

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .environment import Environment
    from .sky_model import ClearSky

TURBIDITY, GROUND_ALBEDO = 3.0, 0.3
"""A clear day; dry grass, soil and stone mixed."""

_REFERENCE_ELEVATION_DEG = 65.4  # of the sun at noon of the longest day at 48 degrees: 90 - 48 + 23.4

_PARTS = 2  # a side of each texel, over which the sky is averaged

_DAY = re.compile(r"\s*(\d{1,2}):(\d\d)\s*-\s*(\d{1,2}):(\d\d)\s*/\s*(\d+(?:\.\d+)?)\s*(s|min|h)\s*")

_SECONDS = {"s": 1.0, "min": 60.0, "h": 3600.0}

_EXPECTED = "expected a time with its zone and a place, or azimuth and height, such as 210,35"


@dataclass(frozen=True)
class DaylightRequest:
    """A requested daylight: date, location, direction of north, and the air.

    time: with a zone.
    latitude_deg, longitude_deg: north and east positive.
    north_deg: by how much north is turned about +y from -z, counter-clockwise seen from above.
    turbidity: haze, from 1 to 10. ground_albedo: from 0 to 1.
    """

    time: datetime
    latitude_deg: float
    longitude_deg: float
    north_deg: float = 0.0
    turbidity: float = TURBIDITY
    ground_albedo: float = GROUND_ALBEDO

    def __post_init__(self) -> None:
        """Raise InputError for what is no time, place, angle or air."""
        check_time(self.time)
        check_place(self.latitude_deg, self.longitude_deg)
        if not abs(self.north_deg) < float("inf"):
            raise InputError(f"`north_deg` must be a finite number of degrees, found {self.north_deg}")
        if not 1.0 <= self.turbidity <= 10.0:
            raise InputError(f"`turbidity` must be from 1 (pure air) to 10 (dense haze), found {self.turbidity:g}")
        if not 0.0 <= self.ground_albedo <= 1.0:
            raise InputError(f"`ground_albedo` must be from 0 to 1, found {self.ground_albedo:g}")

    @classmethod
    def parse(cls, sun: str, at: str, north_deg: float = 0.0) -> "DaylightRequest":
        """Read a date such as 2026-06-21T19:30+02:00 and a place such as 48.85,2.35; the air is clear. Raises
        InputError."""
        return cls(parse_time(sun), *parse_place(at), north_deg)

    @property
    def name(self) -> str:
        """For file names and reports, such as sun-2026-06-21T1930; with seconds where there are any."""
        return self.time.strftime("sun-%Y-%m-%dT%H%M%S" if self.time.second else "sun-%Y-%m-%dT%H%M")

    def at_time(self, time: datetime) -> "DaylightRequest":
        """Return the same place and air at another time, such as one of `day_times`."""
        return replace(self, time=time)

    def environment(self) -> "Environment":
        """Return the light of the clear sky, (HEIGHT, WIDTH, 3) in units of `reference_luminance`, turned by the north.

        At `north_deg` 0 north is -z, east +x, south +z.
        """
        from .environment import Environment

        image = sky_image(sky_of(self)) / reference_luminance()
        return Environment(image, self.name).rotated(self.north_deg)


def sky_of(request: DaylightRequest) -> "ClearSky":
    """Return the sky's model at a date and a place, in cd/m^2, with north at -z."""
    import numpy as np

    from .sky_model import ClearSky

    direction = np.array(toward(*sun_position(request.time, request.latitude_deg, request.longitude_deg)))
    return ClearSky(direction, request.turbidity, request.ground_albedo)


@lru_cache(1)
def reference_luminance() -> float:
    """Return the luminance, cd/m^2, that radiance 1 of every daylight stands for.

    It is the mean over the sphere at a clear noon in June at 48 degrees. Expose a whole day by one number: what shows
    light of mean luminance 1 well shows that noon well.
    """
    import numpy as np

    from .sky_model import ClearSky

    return ClearSky(np.array(toward(180.0, _REFERENCE_ELEVATION_DEG)), TURBIDITY, GROUND_ALBEDO).mean_luminance


def sky_image(sky: "ClearSky") -> "NDArray[np.float64]":
    """Return a sky with its sun and its ground, cd/m^2, as a lat-long image (HEIGHT, WIDTH, 3) float64.

    The disc's parts are shared among the four texels whose middles are around them, by bilinear weights, which keeps
    energy and centroid; none goes below the horizon.
    """
    import numpy as np

    from .projections import row_solid_angles, texel_directions

    fine = texel_directions(HEIGHT * _PARTS, WIDTH * _PARTS, slice(0, HEIGHT * _PARTS // 2))
    values = sky.radiance(fine).reshape(HEIGHT // 2, _PARTS, WIDTH, _PARTS, 3)
    weights = row_solid_angles(HEIGHT * _PARTS, WIDTH * _PARTS)[: HEIGHT * _PARTS // 2].reshape(-1, _PARTS)
    weights = weights / weights.sum(axis=1, keepdims=True) / _PARTS
    image = np.empty((HEIGHT, WIDTH, 3))
    image[: HEIGHT // 2] = np.einsum("rpcqk,rp->rck", values, weights)
    image[HEIGHT // 2 :] = sky.ground_radiance
    toward, energy = sky.disc()
    column = (0.5 - np.arctan2(toward[:, 0], toward[:, 2]) / (2.0 * np.pi)) * WIDTH - 0.5
    row = (0.5 - np.arctan2(toward[:, 1], np.hypot(toward[:, 0], toward[:, 2])) / np.pi) * HEIGHT - 0.5
    row = np.clip(row, 0.0, HEIGHT // 2 - 1.0)
    left, above = np.floor(column), np.floor(row)
    received = np.zeros((HEIGHT, WIDTH, 3))
    for down in (0, 1):
        for right in (0, 1):
            share = np.abs(1 - down - (row - above)) * np.abs(1 - right - (column - left))
            texel = np.minimum(above + down, HEIGHT // 2 - 1).astype(int), (left + right).astype(int) % WIDTH
            np.add.at(received, texel, energy * share[:, None])
    return image + received / row_solid_angles(HEIGHT, WIDTH)[..., None]


def day_times(text: str, day: datetime) -> list[datetime]:
    """Return the times of a day, such as those of 05:00-21:30/15min, the last too where the steps meet it.

    text: first and last time as hours and minutes, up to 24:00, and the step in s, min or h. day: any time of the day,
    with the zone that the text is in. Raises InputError for another form, an end that is not after the start, a step
    below a second, and more than `MOST_STEPS` steps.
    """
    check_time(day)
    found = _DAY.fullmatch(text)
    if found is None:
        raise InputError(f"{text!r} is not a range of times: write it as 05:00-21:30/15min, in s, min or h")
    first, last = (_clock(day, text, *found.group(at, at + 1)) for at in (1, 3))
    step = float(found[5]) * _SECONDS[found[6]]
    seconds = (last - first).total_seconds()
    if seconds <= 0.0:
        raise InputError(f"{text!r} ends before it begins: write the earlier time first, such as 05:00-21:30/15min")
    if step < 1.0:
        raise InputError(f"{text!r} has a step below a second: write such as 15min")
    count = int(seconds / step + 1e-9) + 1
    if count > MOST_STEPS:
        raise InputError(f"{text!r} has {count} steps: at most {MOST_STEPS} are made; take a longer step")
    return [(first + timedelta(seconds=step * each)).astimezone(day.tzinfo) for each in range(count)]


def _clock(day: datetime, text: str, hour: str, minute: str) -> datetime:
    """A time of the day in universal time, in which steps are as long as they are where clocks change."""
    if int(minute) > 59 or int(hour) * 60 + int(minute) > 24 * 60:
        raise InputError(f"{text!r} holds {hour}:{minute}, which is not a time of day")
    midnight = day.replace(hour=0, minute=0, second=0, microsecond=0)
    at = midnight + timedelta(hours=int(hour), minutes=int(minute))
    return at.astimezone(timezone.utc)


def captured_sun(said: DaylightRequest | str | Sequence[float]) -> tuple[float, float, float]:
    """Return the unit direction toward the captured sun, scene frame.

    said: a time and a place with its north; a text such as "2026-06-21T15:00+02:00 at=48.85,2.35 north=20", or with
    azimuth and height "210,35 north=20"; (azimuth, height) in degrees, of a scene whose north is -z; or a direction
    (x, y, z) of any length. Raises InputError for another form, a time without a zone or a place, a place that is not
    on the Earth, and a sun that is not above the horizon.
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
