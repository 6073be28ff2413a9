"""Lights as the bundle stores them: a small image for the sky, coefficients about +y, and a few suns; and lights
that may have lit the capture, sky and sun apart, so that a hand can move the sun."""

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.scene.color import luminance

from ..albedo.by_hand import SkyAndSun
from ..engine.by_hand import LightByHand, can_be_set
from ..insert.surroundings import OWN_SUN, clustered
from ..light import CAPTURED, SUN_TOLERANCE
from ..light.environment import Environment, Suns
from ..light.projections import pooled, texel_directions
from ..light.sun_split import GRID, split
from ..sh import harmonics
from .response import BANDS, LAMPS, SPREAD_BANDS, Response, about_y, evaluate

if TYPE_CHECKING:
    from ..engine.appearance import Appearance
    from ..engine.relighter import Relighter

IMAGE = GRID
"""Rows and columns: texels of 2.8 degrees, much narrower than a lobe of 10 bands."""

MOST_SUNS = 4
"""Most suns, since each costs the renderer a shadow map. The harmonics blur the remaining light."""


class PortableLight(NamedTuple):
    """A light before rotation. image: (64, 128, 3) float32 canonical lat-long radiance, suns included. rest, whole:
    (K, 3) float64 coefficients about +y without and with the suns. suns: Suns. exposure: display value per radiance.
    mean: its mean luminance. lamps: factor on the lamps of a room. name: as shown. captured: factor on the
    captured light beside it. unit: display value per unit of the picture, of placed lamps and captured light.
    sky: the light that far background shows, "own" or CAPTURED.
    """

    name: str
    image: NDArray[np.float32]
    rest: NDArray[np.float64]
    whole: NDArray[np.float64]
    suns: Suns
    exposure: float
    mean: float
    lamps: float = 0.0
    captured: float = 0.0
    unit: float = 1.0
    sky: str = "own"

    def times(self, factor: float) -> "PortableLight":
        """The light times a factor, lamps of a room included."""
        if factor == 1.0:
            return self
        suns = Suns(self.suns.directions, self.suns.weights * factor)
        radiance = {name: getattr(self, name) * factor for name in ("rest", "whole", "mean", "lamps")}
        return self._replace(image=self.image * np.float32(factor), suns=suns, **radiance)


def captured_alone(factor: float, unit: float = 1.0) -> PortableLight:
    """The PortableLight of the captured light alone, times a factor."""
    nothing = np.zeros((BANDS**2, 3))
    image = np.zeros((*IMAGE, 3), np.float32)
    light = PortableLight(CAPTURED, image, nothing, nothing, Suns.none(), exposure=1.0, mean=0.0)
    return light._replace(captured=float(factor), unit=float(unit), sky=CAPTURED)


def light_of(environment: Environment, exposure: float, lamps: float = 0.0) -> PortableLight:
    """The Light of an Environment, as turned."""
    suns = split(environment, BANDS, SUN_TOLERANCE, MOST_SUNS)[1]
    suns, least = Suns(*clustered(suns.directions, suns.weights)), OWN_SUN * np.pi * environment.mean_luminance
    kept = luminance(suns.weights) > least
    suns = Suns(suns.directions[kept], suns.weights[kept])
    image = pooled(environment.radiance, IMAGE)
    shift = environment.rotation_deg / 360.0 * IMAGE[1]
    if shift:  # whole columns of the finer image cannot be shifted by a fraction: the small one is blended
        low = int(np.floor(shift))
        share = shift - low
        image = np.roll(image, -low, axis=1) * (1.0 - share) + np.roll(image, -low - 1, axis=1) * share
    whole = about_y(environment.sh(BANDS))
    rest, mean = whole - about_y(suns.sh(BANDS)), environment.mean_luminance
    shown: NDArray[np.float32] = image.astype(np.float32)
    return PortableLight(environment.name, shown, rest, whole, suns, float(exposure), mean, float(lamps))


def capture_light(response: Response, shares: Floats, lamps: float = 0.0) -> PortableLight | None:
    """The PortableLight of the captured light, by least squares: it leaves every vertex unchanged. None if no light
    does.

    response: Response. shares: (V,) weights of the vertices. lamps: factor on lamps beside it; the capture has 1.
    It consists of harmonics alone; its sky image shows them.
    """
    few, direct = SPREAD_BANDS**2, BANDS**2
    degree, _ = harmonics.degrees_and_orders(BANDS)
    light = np.zeros((direct, 3))
    for c in range(3):
        values = response.values[:, :direct, c].astype(np.float64)
        values[:, :few] += response.values[:, direct:LAMPS, c]
        normal = (values * shares[:, None]).T @ values / shares.sum()
        held = (1.0 + degree) ** 4 * 1e-5 * np.trace(normal)  # coefficients that no vertex shows stay small
        held[0] = 0.0
        left = shares * (1.0 - response.values[:, LAMPS, c])
        light[:, c] = np.linalg.solve(normal + np.diag(held), values.T @ left / shares.sum())
    if not (np.isfinite(light).all() and light[0].min() > 0.0):
        return None
    image = np.maximum(evaluate(texel_directions(*IMAGE).reshape(-1, 3), BANDS) @ light, 0.0)
    mean = float(luminance(light[0])) / np.sqrt(4.0 * np.pi)
    image = image.reshape(*IMAGE, 3).astype(np.float32)
    return PortableLight("capture", image, light, light, Suns.none(), 1.0, mean, float(lamps))


class OfferedLight(NamedTuple):
    """A likely light of the capture, in the unit of its colours. name: for people. share: of the posterior. image:
    (64, 128, 3) float32 radiance of its sky, without a sun. rest: (K, 3) coefficients of that about +y. color: (3,) of
    the sun, luminance 1. sun: `azimuth_deg`, `height_deg` and `sun_share` of a HandLight, as offered."""

    name: str
    share: float
    image: NDArray[np.float32]
    rest: NDArray[np.float64]
    color: list[float]
    sun: dict[str, float]

    @classmethod
    def of(cls, offered: SkyAndSun) -> "OfferedLight":
        """The OfferedLight of a SkyAndSun."""
        image: NDArray[np.float32] = pooled(offered.sky.radiance, IMAGE).astype(np.float32)
        sun = {name: float(getattr(offered.hand, name)) for name in ("azimuth_deg", "height_deg", "sun_share")}
        color = [float(each) for each in offered.color]
        entry = offered.entry
        return cls(entry.name, entry.share, image, about_y(offered.sky.sh(BANDS)), color, sun)

    def described(self, file: str) -> dict[str, Any]:
        """Its entry in live.json, a dict. file: of its image."""
        numbers = {"rest": self.rest.tolist(), "color": self.color, **self.sun}
        return {"name": self.name, "share": self.share, "file": file, **numbers}


def offered_lights(relighter: "Relighter", look: "Appearance") -> list[OfferedLight]:
    """The likely lights of a scene; none where its captured light cannot be set by hand."""
    if not can_be_set(look, relighter):
        return []
    return [OfferedLight.of(each) for each in LightByHand(relighter, look).offered]


def rgbe(image: Radiance) -> NDArray[np.uint8]:
    """(..., 4) uint8 of radiance (..., 3): mantissas and a shared exponent, as in Radiance files."""
    largest = image.max(axis=-1)
    _, exponent = np.frexp(np.where(largest > 1e-32, largest, 0.0))
    mantissa = np.floor(np.ldexp(image, 8 - exponent[..., None]))
    bytes_ = np.concatenate([np.clip(mantissa, 0, 255), exponent[..., None] + 128], axis=-1)
    bytes_[largest <= 1e-32] = 0
    return bytes_.astype(np.uint8)
