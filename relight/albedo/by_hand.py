"""The captured light set by hand: an offered light with its sun moved, made stronger, brighter or of another tint.

    offer = SkyAndSun.of(entry, environment)       an offered light, its sun taken out of its sky
    hand = HandLight(azimuth_deg=210.0, height_deg=35.0, sun_share=0.5)
    HandScene(captured_scene).albedo(offer, hand)  a product of matrices and a division for each picture
    keep(folder, offer, hand)                      commands use it from now on

A share of the irradiance, and the brightness, are those of a surface that faces the sun.
"""

import math
import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Vector
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import luminance

from ..light.captured_light import CapturedLights, LikelyLight, LikelySun, choose_new, read_environment
from ..light.environment import Environment, Suns
from ..light.sun_position import toward
from .captured import CapturedScene
from .division import albedo_of, prior_of
from .offered import drawn_sun, environment_of, facing, texels

RANGES = {
    "azimuth_deg": (0.0, 360.0),
    "height_deg": (1.0, 90.0),
    "sun_share": (0.0, 0.95),
    "brightness_ev": (-3.0, 3.0),
    "warmth": (-2.0, 2.0),
    "green": (-1.0, 1.0),
}
"""Of the fields of a HandLight. An azimuth wraps around, other values are clipped."""

SAMPLED = 20_000
"""Vertices, evenly chosen, whose medians give the prior of the division while a light is moved."""


@dataclass(frozen=True)
class HandLight:
    """What a hand sets of a captured light. azimuth_deg: from -z of the scene frame, clockwise seen from above.
    height_deg: above the horizon. sun_share: of the sun in the irradiance of a surface that faces it. brightness_ev:
    stops over the offered light. warmth, green: stops of red over blue, and of green over both, luminance unchanged."""

    azimuth_deg: float = 180.0
    height_deg: float = 45.0
    sun_share: float = 0.0
    brightness_ev: float = 0.0
    warmth: float = 0.0
    green: float = 0.0

    def changed(self, **changes: float) -> "HandLight":
        """Return it with fields set, brought into their ranges. Raises InputError for names and numbers that are none.

        A direction toward the sun comes as `azimuth_deg` and `height_deg`, for instance of `angles`."""
        checked = {}
        for name, value in changes.items():
            if name not in RANGES:
                raise InputError(f"{name}: expected one of {', '.join(RANGES)}")
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise InputError(f"{name} must be a finite number, found {value}")
            low, high = RANGES[name]
            checked[name] = float(value) % high if name == "azimuth_deg" else float(min(max(value, low), high))
        return replace(self, **checked)

    @property
    def direction(self) -> NDArray[np.float64]:
        """(3,) unit, toward the sun, scene frame."""
        return np.array(toward(self.azimuth_deg, self.height_deg))

    @property
    def tint(self) -> NDArray[np.float64]:
        """(3,) factors on red, green and blue, of luminance 1."""
        color = np.exp2([self.warmth / 2.0, self.green, -self.warmth / 2.0])
        return np.asarray(color / luminance(color))


class SkyAndSun(NamedTuple):
    """An offered light in its parts. entry: of `captured_light.json`. whole: the Environment as offered. sky: without
    the sun that is drawn in it. color: (3,) of the sun, luminance 1. hand: the HandLight that leaves it as offered."""

    entry: LikelyLight
    whole: Environment
    sky: Environment
    color: NDArray[np.float64]
    hand: HandLight

    @classmethod
    def of(cls, entry: LikelyLight, environment: Environment) -> "SkyAndSun":
        """Return an offered light in its parts: without a sun in its entry, its sky is all of it."""
        image = environment.lookup(texels()[0]).astype(np.float64)
        if entry.sun is None:
            return cls(entry, environment, environment_of(image, entry.name), np.ones(3), HandLight())
        hand = HandLight().changed(azimuth_deg=entry.sun.azimuth_deg, height_deg=entry.sun.height_deg)
        sun = np.array(entry.sun.irradiance)
        image = np.maximum(image - drawn_sun(hand.direction, sun), 0.0)
        bright, rest = (float(luminance(each)) for each in (sun, facing(image, hand.direction)))
        hand = hand.changed(sun_share=bright / max(bright + rest, 1e-12))
        sky = environment_of(image, entry.name)
        return cls(entry, environment, sky, sun / bright if bright > 0.0 else np.ones(3), hand)

    def parts(self, hand: HandLight) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Factors (3,) on the sky, and the irradiance (3,) of the sun on a surface that faces it.

        What faces the sun is as bright as in the offered light, but for the brightness that the hand asks for.
        """
        image = self.sky.radiance.reshape(-1, 3)
        at_offered = float(luminance(facing(image, self.hand.direction))) / (1.0 - self.hand.sun_share)
        level = at_offered * 2.0**hand.brightness_ev
        rest = max(float(luminance(facing(image, hand.direction))), 1e-12)
        return (1.0 - hand.sun_share) * level / rest * hand.tint, hand.sun_share * level * self.color * hand.tint

    def coefficients(self, hand: HandLight, bands: int) -> NDArray[np.float64]:
        """(K, 3) of the light's radiance, the sun as a point."""
        factors, irradiance = self.parts(hand)
        return self.sky.sh(bands) * factors + Suns(hand.direction[None], irradiance[None]).sh(bands)

    def environment(self, hand: HandLight) -> Environment:
        """The whole light as an Environment in the unit of the captured colours, which needs no exposure."""
        factors, irradiance = self.parts(hand)
        image = self.sky.radiance.reshape(-1, 3) * factors + drawn_sun(hand.direction, irradiance)
        found = environment_of(image, "set by hand")
        found.exposed = True
        return found

    def described(self, hand: HandLight) -> LikelyLight:
        """The entry of what was set, without its file."""
        factors, irradiance = self.parts(hand)
        _, offered = self.parts(self.hand)
        sky, sun = (float(luminance(each)) for each in (factors, irradiance))
        before = float(luminance(offered))
        stronger = sun / before if before > 0.0 else 1.0
        name = f"set by hand from {self.entry.name.removeprefix('set by hand from ')}"
        red, green, blue = (float(each) for each in irradiance)
        tint = hand.tint
        return LikelyLight(
            name,
            1.0,
            LikelySun(hand.azimuth_deg, hand.height_deg, (red, green, blue)) if sun > 0.0 else None,
            "",
            2.0**hand.brightness_ev,
            (float(tint[0]), float(tint[1]), float(tint[2])),
            stronger,
            sky / stronger if stronger > 0.0 else 1.0,
            by_hand=True,
        )


class HandScene:
    """A scene as it was captured, whose albedo follows a light set by hand. scene: CapturedScene, V vertices."""

    def __init__(self, scene: CapturedScene) -> None:
        self.scene = scene
        self._bands = math.isqrt(scene.transport.transfer.shape[1])
        count = len(scene.captured)
        self._sample = np.unique(np.linspace(0, count - 1, min(SAMPLED, count)).astype(np.int64))
        self._shares = np.where(scene.usable, scene.areas, 0.0)

    def under(self, environment: Environment) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Albedo and irradiance, (V, 3) each, under an Environment in the unit of the captured colours."""
        scene = self.scene
        irradiance = scene.direct(environment) + scene.bounce
        return albedo_of(scene.captured, irradiance, prior_of(scene.captured, irradiance, self._shares)), irradiance

    def albedo(self, offered: SkyAndSun, hand: HandLight, exact: bool = False) -> NDArray[np.float32]:
        """(V, 3) under a light set by hand, as `albedo_of` divides.

        exact: with the sun traced, as commands see the light; else in the harmonics of the transfer, at once.
        """
        scene = self.scene
        if exact:
            return self.under(offered.environment(hand))[0]
        light = offered.coefficients(hand, self._bands).astype(np.float32)
        irradiance = np.maximum(scene.transport.transfer @ light, np.float32(0.0)) + scene.bounce
        rows = self._sample
        prior = prior_of(scene.captured[rows], irradiance[rows], self._shares[rows])
        return albedo_of(scene.captured, irradiance, prior)


def offered_in(lights: CapturedLights, folder: str | os.PathLike[str]) -> list[SkyAndSun]:
    """The lights of a scene folder in their parts, the likeliest first; after them one that was set by hand."""
    chosen = lights.chosen
    entries = [*lights.candidates, *([chosen] if chosen is not None and chosen.by_hand else [])]
    return [SkyAndSun.of(each, read_environment(Path(folder) / each.environment, each.name)) for each in entries]


def keep(folder: str | os.PathLike[str], offered: SkyAndSun, hand: HandLight) -> LikelyLight:
    """Write a light set by hand into a scene folder, as the one that commands use from now on; returns its entry.

    Raises InputError for a folder that cannot be written.
    """
    return choose_new(folder, offered.described(hand), offered.environment(hand))


def angles(direction: Vector) -> dict[str, float]:
    """`azimuth_deg` and `height_deg` of a direction (3,) toward the sun, of any length. Raises InputError for one that
    is not above the horizon."""
    x, y, z = (float(each) for each in np.asarray(direction, np.float64))
    height = math.degrees(math.atan2(y, math.hypot(x, z)))
    if not height > 0.0:
        raise InputError("the sun would stand below the horizon: what casts a shadow is higher than the shadow's edge")
    return {"azimuth_deg": math.degrees(math.atan2(x, -z)) % 360.0, "height_deg": height}


def sun_through(edge: Vector, caster: Vector) -> dict[str, float]:
    """`azimuth_deg` and `height_deg` of the sun by which a point (3,) casts its shadow on another, its edge. Raises
    InputError where both are one, and for a caster that is not higher than the edge."""
    way = np.asarray(caster, np.float64) - np.asarray(edge, np.float64)
    if not np.linalg.norm(way) > 0.0:
        raise InputError("the edge of a shadow and what casts it are one point: click two")
    return angles(way)
