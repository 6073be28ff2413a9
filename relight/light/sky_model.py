"""The clear sky of Hosek and Wilkie with the sun's disc, twilight and the ground, in candela per square metre.

Colours are linear Rec. 709, scaled so that their luminance is in cd/m^2, and that of an irradiance in lux.
"""

import math
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrayfiles import load_arrays
from splat2mesh.base.arrays import Directions, Floats, Vector
from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import GIB
from splat2mesh.scene.color import luminance
from splat2mesh.scene.measured import SKY_HEIGHT, SKY_WIDTH

SUN_RADIUS_DEG = 0.2666
"""Half the apparent diameter of the sun at its mean distance: 959.6 seconds of arc."""

LUMINOUS_EFFICACY = 683.0
"""Lumens per watt: the data are integrals of spectral radiance over the CIE 1931 curves, in watts."""

LEAST_TURBIDITY, MOST_TURBIDITY = 1.0, 10.0
"""Range that the model was fitted to: 1 is pure air, 3 a clear day, 10 dense haze."""

_DATA = Path(__file__).parent / "data" / "hosek_wilkie_rgb.npz"

_DISC_RINGS = 16
_DISC_SPOKES = 2 * _DISC_RINGS  # parts of the disc, of equal solid angle

_QUADRATURE = SKY_HEIGHT, SKY_WIDTH  # elevations and azimuths of the irradiance: within 1e-5 of 400 x 1,000 of them

_TWILIGHT_BLUE = np.array([0.694, 1.008, 1.823])
"""CIE daylight of 20,000 K, of luminance 1: the sun below the horizon lights air that ozone has turned blue."""

_ALL_BLUE_DEG = -8.0  # glow along the horizon has gone, as seen: in the middle of nautical twilight

_ALMANAC_DEG = -6.0  # the end of civil twilight: from here on the illuminance is that of the almanac

NIGHT_DEG = -18.0
"""Elevation of the sun at which the night begins; below it the light stays constant: 0.0006 lux."""

_ALMANAC_FITS = (  # lowest elevation in degrees, coefficients of its powers
    (-0.8, (2.88, 22.26, -207.64, 1034.30)),
    (-5.0, (2.88, 21.81, -258.11, -858.36)),
    (-12.0, (2.70, 12.17, -431.69, -1899.83)),
    (NIGHT_DEG, (13.84, 262.72, 1447.42, 2797.93)),
)
"""Decimal logarithm of the illuminance of level ground in lux, as a polynomial of elevation over 90 degrees: the
Explanatory Supplement to the Astronomical Almanac (Seidelmann), 1992, section 9.3."""


class ClearSky:
    """Radiance of a cloudless sky, of the ground below it, and of the sun's disc.

    sun: (3,) unit vector toward the middle of the disc, +y up; it may be below the horizon. turbidity: haze, from 1 to
    10. ground_albedo: from 0 to 1, grey.
    """

    def __init__(self, sun: ArrayLike, turbidity: float = 3.0, ground_albedo: float = 0.3) -> None:
        """Make it for a sun in a direction (3,) of any length, +y up. The ground brightens the sky, too.

        Raises InputError for a turbidity or an albedo outside its range, and for a direction that is none.

        Sky: Hosek and Wilkie, An Analytic Model for Full Spectral Sky-Dome Radiance, 2012, its RGB version. Sun: by the
        same, Adding a Solar-Radiance Function to the Hosek-Wilkie Skylight Model, 2013, its spectra taken through the
        CIE 1931 curves.

        The model ends at sunset. Twilight is its sky for a sun on the horizon, dimmed to the illuminance of the almanac
        (from -6 degrees on; before, along a smooth way there) and turned to one blue. The night, from -18 degrees on,
        is the last of it: 0.0006 lux of air and stars, without moon and lamps.
        """
        vector = np.asarray(sun, np.float64)
        length = float(np.linalg.norm(vector))
        if vector.shape != (3,) or not 0.0 < length < math.inf:
            raise InputError(f"the direction of the sun must be three finite numbers that are not all 0, found {sun!r}")
        if not LEAST_TURBIDITY <= turbidity <= MOST_TURBIDITY:
            raise InputError(f"`turbidity` must be from 1 (pure air) to 10 (dense haze), found {turbidity:g}")
        if not 0.0 <= ground_albedo <= 1.0:
            raise InputError(f"`ground_albedo` must be from 0 to 1, found {ground_albedo:g}")
        self.sun: NDArray[np.float64] = vector / length
        self.turbidity, self.ground_albedo = float(turbidity), float(ground_albedo)

    @property
    def elevation_deg(self) -> float:
        """Elevation of the middle of the sun's disc, degrees."""
        return math.degrees(math.atan2(self.sun[1], math.hypot(self.sun[0], self.sun[2])))

    def radiance(self, directions: Directions) -> NDArray[np.float64]:
        """Return the radiance (..., 3), cd/m^2, of unit directions (..., 3): of the sky without the sun's disc, and
        below the horizon of a matt, level ground."""
        directions = np.asarray(directions, np.float64)
        result = np.empty(directions.shape)
        above = directions[..., 1] >= 0.0
        result[above] = self._sky(directions[above])
        result[~above] = self.ground_radiance
        return result

    def disc(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the parts of the sun's disc that are above the horizon: unit vectors (P, 3) toward them, and weights
        (P, 3), radiance times solid angle: lux on a surface that faces them."""
        toward, solid_angle = self._disc_parts()
        toward = toward[toward[:, 1] > 0.0]
        return toward, _sun_radiance(np.arcsin(toward[:, 1]), self.turbidity) * solid_angle

    @cached_property
    def sun_irradiance(self) -> NDArray[np.float64]:
        """(3,) lux of the sun's disc on a surface that faces it."""
        return self.disc()[1].sum(axis=0)

    @cached_property
    def sky_irradiance(self) -> NDArray[np.float64]:
        """(3,) lux of the sky, without the sun's disc, on level ground."""
        directions, weights = _hemisphere()
        return np.einsum("pc,p->c", self._sky(directions), weights * directions[:, 1])

    @cached_property
    def level_irradiance(self) -> NDArray[np.float64]:
        """(3,) lux of sky and sun on level ground."""
        toward, weights = self.disc()
        return self.sky_irradiance + np.asarray(toward[:, 1] @ weights)

    @property
    def ground_radiance(self) -> NDArray[np.float64]:
        """(3,) cd/m^2 of the ground: albedo x irradiance / pi."""
        return self.ground_albedo * self.level_irradiance / np.pi

    @cached_property
    def mean_luminance(self) -> float:
        """Luminance averaged over the sphere, cd/m^2: sky, disc and ground."""
        directions, weights = _hemisphere()
        above = luminance(weights @ self._sky(directions)) + luminance(self.sun_irradiance)
        return float(above / (4.0 * np.pi) + luminance(self.ground_radiance) / 2.0)

    def _sky(self, directions: Directions) -> NDArray[np.float64]:
        """Radiance (P, 3) of the sky, for directions (P, 3) that are not below the horizon."""
        if self.elevation_deg >= 0.0:
            return self._modelled(directions)
        pattern, dimmed, blue, share = self._twilight
        glow = pattern._modelled(directions)
        return dimmed * ((1.0 - share) * glow + share * blue)

    @cached_property
    def _twilight(self) -> tuple["ClearSky", float, NDArray[np.float64], float]:
        """The sky of a sun on the horizon, what is left of it, a blue (3,) as bright as it on the ground, its share."""
        level = self.sun * [1.0, 0.0, 1.0]
        if not level.any():  # straight below: any direction will do, as all is blue
            level = np.array([0.0, 0.0, 1.0])
        horizon = ClearSky(level, self.turbidity, self.ground_albedo)
        lux = float(luminance(horizon.sky_irradiance))
        toward_almanac = _smooth(self.elevation_deg / _ALMANAC_DEG)
        excess = (lux / _almanac_lux(0.0)) ** (1.0 - toward_almanac)
        blue = _TWILIGHT_BLUE / luminance(_TWILIGHT_BLUE) * lux / np.pi
        dimmed = _almanac_lux(self.elevation_deg) * excess / lux
        return horizon, dimmed, blue, _smooth(self.elevation_deg / _ALL_BLUE_DEG)

    def _modelled(self, directions: Directions) -> NDArray[np.float64]:
        """Radiance (P, 3) by equations 8 and 9 of the paper; 0 where the fit falls below."""
        shape, mean = self._coefficients
        a, b, c, d, e, f, chi_weight, zenith_weight, g = shape
        cosine = np.clip(directions @ self.sun, -1.0, 1.0)[:, None]
        angle, height = np.arccos(cosine), np.maximum(directions[:, 1:2], 0.0)
        chi = (1.0 + cosine**2) / (1.0 + g * g - 2.0 * g * cosine) ** 1.5
        gradient = 1.0 + a * np.exp(b / (height + 0.01))
        scatter = c + d * np.exp(e * angle) + f * cosine**2 + chi_weight * chi + zenith_weight * np.sqrt(height)
        return np.maximum(gradient * scatter * mean * LUMINOUS_EFFICACY, 0.0)

    @cached_property
    def _coefficients(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Shape (9, 3) of the sky and its mean radiance (3,): Bezier curves in the cube root of the elevation."""
        data = _data()
        along = (max(self.elevation_deg, 0.0) / 90.0) ** (1.0 / 3.0)
        bernstein = [math.comb(5, k) * along**k * (1.0 - along) ** (5 - k) for k in range(6)]
        weights = np.array(bernstein)[:, None] * [1.0 - self.ground_albedo, self.ground_albedo]
        tables = (_between(data[name], self.turbidity) for name in ("sky_shape", "sky_radiance"))
        shape, mean = (np.einsum("ka,ak...->...", weights, table) for table in tables)
        return shape.T, mean

    def _disc_parts(self) -> tuple[NDArray[np.float64], float]:
        """Unit vectors (P, 3) over the whole disc, and the solid angle of each."""
        cap = 1.0 - math.cos(math.radians(SUN_RADIUS_DEG))
        depth = cap * (np.arange(_DISC_RINGS) + 0.5) / _DISC_RINGS  # equal steps of the cosine: equal solid angles
        ring = np.sqrt(depth * (2.0 - depth))[:, None]
        around = 2.0 * np.pi * (np.arange(_DISC_SPOKES) + 0.5) / _DISC_SPOKES
        across, along = _frame(self.sun)
        offsets = np.cos(around)[:, None] * across + np.sin(around)[:, None] * along
        toward = (1.0 - depth)[:, None, None] * self.sun + ring[..., None] * offsets
        return toward.reshape(-1, 3), 2.0 * np.pi * cap / (_DISC_RINGS * _DISC_SPOKES)


@lru_cache(1)
def _data() -> dict[str, NDArray[np.float64]]:
    """The tables. Turbidities 1 to 10 stand first in each.

    sky_shape: (10, 2, 6, 3, 9), by albedo 0 and 1, control point, colour. sky_radiance: (10, 2, 6, 3).
    sun_radiance: (10, 45, 3, 4), by segment of elevation, colour, power of the elevation in it: the mean of the disc.
    """
    return {name: table.astype(np.float64) for name, table in load_arrays(_DATA, GIB).items()}


def _between(table: NDArray[np.float64], turbidity: float) -> NDArray[np.float64]:
    """A table (10, ...) between two whole turbidities, linearly."""
    lower = min(int(turbidity), int(MOST_TURBIDITY) - 1)
    share = turbidity - lower
    return (1.0 - share) * table[lower - 1] + share * table[lower]


def _sun_radiance(elevation_rad: Floats, turbidity: float) -> NDArray[np.float64]:
    """Radiance (P, 3) of parts of the disc by their elevation (P,) above 0: cubics, shorter toward the horizon."""
    table = _between(_data()["sun_radiance"], turbidity)
    pieces = len(table)
    piece = np.minimum((np.cbrt(elevation_rad / (0.5 * np.pi)) * pieces).astype(int), pieces - 1)
    into = elevation_rad - 0.5 * np.pi * (piece / pieces) ** 3
    powers = into[:, None] ** np.arange(4)
    return np.maximum(np.einsum("pk,pck->pc", powers, table[piece]) * LUMINOUS_EFFICACY, 0.0)


def _almanac_lux(elevation_deg: float) -> float:
    """Illuminance of level ground for a sun at or below the horizon, without moon and lamps."""
    elevation_deg = min(max(elevation_deg, NIGHT_DEG), 0.0)
    fit = next(fit for lowest, fit in _ALMANAC_FITS if elevation_deg >= lowest)
    share = elevation_deg / 90.0
    return 10.0 ** sum(factor * share**power for power, factor in enumerate(fit))


def _smooth(share: float) -> float:
    """0 at 0, 1 at 1 and beyond, level at both ends."""
    share = min(max(share, 0.0), 1.0)
    return share * share * (3.0 - 2.0 * share)


@lru_cache(1)
def _hemisphere() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Directions (P, 3) above the horizon and their weights (P,), which add up to 2 pi: denser toward the horizon."""
    elevations, azimuths = _QUADRATURE
    nodes, weights = leggauss(elevations)
    share, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    height, weights = share**2, 2.0 * share * weights  # the model has a square root of the height
    around = 2.0 * np.pi * (np.arange(azimuths) + 0.5) / azimuths
    level = np.sqrt(1.0 - height**2)[:, None]
    x, z = level * np.sin(around), level * np.cos(around)
    directions = np.stack([x, np.broadcast_to(height[:, None], x.shape), z], axis=-1).reshape(-1, 3)
    return directions, np.repeat(weights * 2.0 * np.pi / azimuths, azimuths)


def _frame(axis: Vector) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit vectors that are square to a unit vector and to each other."""
    other = np.eye(3)[np.argmin(np.abs(axis))]
    across = np.cross(axis, other)
    across /= np.linalg.norm(across)
    return across, np.cross(axis, across)
