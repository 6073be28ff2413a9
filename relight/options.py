"""Options of the light, passed unchanged from a command line or a caller to the planner. Imports nothing heavy."""

import math
import os
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from splat2mesh.base.choices import check_choice, check_seed
from splat2mesh.base.errors import InputError
from splat2mesh.base.specs import vector

from .light import ANEW, CAPTURED_SKIES, SUN_TOLERANCE
from .transfer import DEFAULT_BANDS, DEFAULT_RAYS, FEW_BANDS, METHODS, check_rays
from .transfer.settings import (
    BOUNCE_RAYS,
    BOUNCE_TOLERANCE,
    BOUNCES,
    EFFECTS,
    GLOSS,
    SHADOWS,
    SUN,
    VOLUME,
    VOLUME_DIRECTIONS,
    Settings,
)

PICTURE_SIZE = 960, 720
"""Of pictures, in pixels."""

DEFAULT_TOLERANCE = 0.01
"""Relative error of exit radiance, root mean square over vertices and colours."""

PLACE_TOLERANCE = 0.03
"""The same for a place: among leaves and grass the last percents cost ten times the rays, and what is known of the
capture's light is worse than this. A garden of 367,000 vertices: 22 s planned for .03, 140 s for .01."""

MOST_LAMPS = 1000.0
"""Largest factor on the light of the capture, of its lamps, of an environment: ten stops."""

LampKey: TypeAlias = int | tuple[float, float, float]
"""Which captured lamp: its number, from 1, or a place on it in the frame of the splat."""


@dataclass(frozen=True)
class LightingOptions:
    """How to light a scene. A given value is not planned.

    method: "raytraced"; "neural-gash" (the paper's network: position and normal, three bands, shadows guessed);
        "analytic" (no shadows); "blinn-phong" (lamps without shadows, the baseline); "auto": raytraced, or analytic
        where no effects are wanted or needed.
    bands, rays, seed: SH bands 1..10; rays per vertex; seed of their directions.
    effects: "auto", "none", or some of shadows, sun, bounces, volume, gloss, as names or as text with commas; kept as
        "auto" or a frozenset. With "auto", light bounces if there is an albedo: in an all-white scene it would never
        fade.
    tolerance, budget_s: the accepted relative error, or the seconds to spend. With either, every light is planned, and
        effects that the scene does not need are skipped. With neither, all effects are computed, with the default
        bands and rays of the method.
    lamps: the captured lamps of a closed room: "keep", "off", a factor on their light, a factor of each by its number,
        as {1: 0, 3: 0.5} or "1=off,3=0.5", or by a place on it, in the frame of the splat, as {(1.2, 2.0, -0.4): 0} or
        "at=1.2,2.0,-.4=off", off without a factor; kept as a number or as pairs of number or place and factor.
    placed: added lamps: shapes of `relight.lamps`, files of lamps, or text, "1.5,1.5,-1.5 color=3000K".
    captured: factor on the captured light kept beside lamps and environment; 1 where the light is that of
        the capture, else 0. env_scale: factor on the light of the environment.
    captured_sun: the sun of the capture: "2026-06-21T15:00+02:00 at=48.85,2.35 north=20", a DaylightRequest, azimuth
        and height in degrees, "210,35", or a direction; kept as a unit direction in the scene frame.
    captured_sky: its sky: one of `light.CAPTURED_SKIES`, a file or an Environment.
    captured_light: its whole light: the number, from 1, of a likely light in the folder of the scene, a file or an
        Environment; "auto" ignores the one that was chosen there.
    Raises InputError for anything else.
    """

    method: str = "auto"
    bands: int | None = None
    rays: int | None = None
    effects: str | Iterable[str] = "auto"
    tolerance: float | None = None
    budget_s: float | None = None
    seed: int = 0
    lamps: str | float | Mapping[LampKey, float] | Sequence[tuple[LampKey, float]] = "keep"
    placed: Sequence[Any] = ()
    captured: float | None = None
    env_scale: float = 1.0
    captured_sun: Any = None
    captured_sky: Any = None
    captured_light: Any = None

    def __post_init__(self) -> None:
        for name, checked in _CHECKED.items():
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, checked(name, value))
        object.__setattr__(self, "effects", _checked_effects(self.effects, self.method))
        if self.tolerance is not None and self.budget_s is not None:
            raise InputError("`tolerance` and `budget_s`: expected one of them")

    @classmethod
    def of(cls, options: "LightingOptions | str | None" = None, **changes: Any) -> "LightingOptions":
        """Options with changes: to the given ones, to the method of that name, or to the defaults."""
        if isinstance(options, LightingOptions):
            return replace(options, **changes) if changes else options
        return cls(**changes) if options is None else cls(method=options, **changes)

    def planned(self, tolerance: float = DEFAULT_TOLERANCE) -> "LightingOptions":
        """These options, within a tolerance where they have neither that nor a budget."""
        return self if self.is_planned else replace(self, tolerance=tolerance)

    @property
    def is_planned(self) -> bool:
        """Whether there is a tolerance or a budget to plan for."""
        return self.tolerance is not None or self.budget_s is not None

    @property
    def accepted_error(self) -> float:
        """The accepted relative error of lamps, which know no budget."""
        return self.tolerance or DEFAULT_TOLERANCE

    @property
    def chosen_effects(self) -> frozenset[str]:
        """The effects that may take part in the light on the mesh: those given, or with "auto" all that the method can
        do."""
        return _able(self.method) if self.fixed_effects is None else self.fixed_effects

    @property
    def fixed_effects(self) -> frozenset[str] | None:
        """The given effects; None where they are chosen."""
        return None if isinstance(self.effects, str) else frozenset(self.effects) - {GLOSS}

    @property
    def wants_gloss(self) -> bool:
        """Whether reflections may move with the light: gloss is given, or left to the choice."""
        return isinstance(self.effects, str) or GLOSS in self.effects

    @property
    def fixed_method(self) -> str | None:
        """The given method; None where it is chosen."""
        return None if self.method == "auto" else self.method

    @property
    def lamp_factor(self) -> float:
        """The factor on the light of captured lamps: 1 to keep it, 0 for off; 1 where each has its own factor."""
        return float(self.lamps) if isinstance(self.lamps, float) else 1.0

    @property
    def pointed_at(self) -> list[tuple[float, float, float]]:
        """Places on captured lamps that were given, in the frame of the splat."""
        pairs = () if isinstance(self.lamps, (str, float)) else dict(self.lamps)
        return [key for key in pairs if isinstance(key, tuple)]

    def lamp_factors(self, count: int, pointed: Sequence[int] = ()) -> list[float]:
        """Return the factor of each of so many captured lamps.

        pointed: the number, from 1, of the lamp at each place of `pointed_at`. Raises InputError for one that is not.
        """
        if isinstance(self.lamps, (str, float)):
            return [self.lamp_factor] * count
        chosen: dict[int, float] = {}
        found = dict(zip(self.pointed_at, pointed, strict=False))
        for key, factor in dict(self.lamps).items():
            number = key if isinstance(key, int) else found.get(key, 0)
            if not 1 <= number <= count:
                there = f"its lamps are 1 to {count}" if count else "found no lamp of known strength"
                if not isinstance(key, int):
                    there = "expected a closed room that was captured from inside, with its albedo estimated"
                raise InputError(f"`lamps` {lamp_name(key)}={factor:g}: {there}")
            if chosen.setdefault(number, factor) != factor:
                problem = f"this is lamp {number}, which has the factor {chosen[number]:g} already"
                raise InputError(f"`lamps` {lamp_name(key)}={factor:g}: {problem}")
        return [chosen.get(number, 1.0) for number in range(1, count + 1)]

    @property
    def changes_captured_light(self) -> bool:
        """Whether the request changes or adds to the light of the capture, which needs no environment."""
        return bool(self.placed) or self.captured is not None or self.lamps != "keep"

    @property
    def adds_light(self) -> bool:
        """Whether the request adds light to an environment, or changes it."""
        return bool(self.placed) or self.captured is not None or self.env_scale != 1.0

    @property
    def said(self) -> tuple[str, ...]:
        """Names of the fields that say something of the captured light."""
        names = [each for each in ("captured_sun", "captured_sky") if getattr(self, each) is not None]
        return (*names, *(["captured_light"] if self.captured_light not in (None, ANEW) else []))

    @property
    def unplanned(self) -> Settings:
        """The Settings without a plan: everything that the chosen effects allow."""
        method, effects = self.method, self.chosen_effects
        if method == "auto":
            method = "raytraced" if effects else "analytic"
        bands = DEFAULT_BANDS if self.bands is None else self.bands
        if method != "raytraced":
            return Settings(method, min(bands, FEW_BANDS) if method == "neural-gash" else bands)
        rays = self.rays or DEFAULT_RAYS
        bouncing = (BOUNCE_RAYS, BOUNCE_TOLERANCE) if BOUNCES in effects else (0, 0.0)
        sun_tolerance = SUN_TOLERANCE if SUN in effects else 0.0
        return Settings(method, bands, rays, sun_tolerance, *bouncing, VOLUME_DIRECTIONS * (VOLUME in effects))


def _able(method: str) -> frozenset[str]:
    """The effects that a method can do: the others are traced among shadows, and all need rays."""
    return frozenset(EFFECTS if method in ("auto", "raytraced") else ())


def _checked_bands(_: str, bands: int) -> int:
    from .sh.harmonics import check_bands

    return check_bands(bands)


def _above_zero(name: str, value: float) -> float:
    if not 0.0 < value < math.inf:
        raise InputError(f"`{name}` must be a number above 0, found {value}")
    return value


def _checked_sun(_: str, sun: Any) -> Any:
    from .light.daylight import captured_sun

    return captured_sun(sun)


def _checked_sky(_: str, sky: Any) -> Any:
    return sky.lower() if isinstance(sky, str) and sky.lower() in CAPTURED_SKIES else sky


def _checked_lamps(_: str, choice: Any) -> str | float | tuple[tuple[LampKey, float], ...]:
    """ "keep"; a factor, 0.0 for "off"; or pairs of a lamp's number or place and its factor, by number."""
    if isinstance(choice, str) and "=" in choice:
        choice = _words_of_lamps(choice)
    if isinstance(choice, (str, int, float)):
        return "keep" if choice == "keep" else _checked_factor("lamps", 0.0 if choice == "off" else choice)
    pairs = choice.items() if isinstance(choice, Mapping) else choice
    found: dict[LampKey, float] = {}
    for name, factor in pairs:
        key = _checked_key(name, factor)
        if key in found:
            raise InputError(f"`lamps` {lamp_name(key)}={factor}: expected each lamp once, as in 1=off,3=0.5")
        found[key] = _checked_factor("lamps", {"off": 0.0, "keep": 1.0}.get(factor, factor))
    return tuple(sorted(found.items(), key=lambda pair: (isinstance(pair[0], tuple), pair[0])))


def _words_of_lamps(text: str) -> list[tuple[str, str]]:
    """(number or x,y,z; factor) of each lamp in a text such as "1=off,at=1.2,2.0,-.4=0.5"; a place alone is off."""
    found = re.findall(r"\s*(at=[^=,]*(?:,[^=,]*){0,2}|[^=,]*)(?:=([^,]*))?(?:,|$)", text)[:-1]  # the last is the end
    return [(name, factor.strip() or "off" * name.startswith("at=")) for name, factor in found]


def _checked_key(name: Any, factor: Any) -> LampKey:
    """Which lamp a number, a text or three numbers mean. Raises InputError for what means none."""
    text = str(name).strip()
    if text.isdecimal():
        return int(text)
    try:
        return vector("at", text.removeprefix("at=") if isinstance(name, str) else name)
    except InputError:
        pass
    expected = "three numbers, as in at=1.2,2.0,-.4=off" if "at=" in text else "the number of a lamp, as in 1=off,3=0.5"
    raise InputError(f"`lamps` {text}={factor}: expected {expected}")


def lamp_name(key: LampKey) -> str:
    """Return the name of a captured lamp in a request: "2" or "at=1.2,2,-0.4"."""
    return str(key) if isinstance(key, int) else "at=" + ",".join(f"{value:g}" for value in key)


def _checked_factor(name: str, value: Any) -> float:
    """A factor on some light, from 0 to MOST_LAMPS. Raises InputError for anything else."""
    try:
        factor = float(value)
    except (TypeError, ValueError):
        factor = math.nan
    if not 0.0 <= factor <= MOST_LAMPS:
        words = "keep, off or " if name == "lamps" else ""
        raise InputError(f"`{name}` {value!r}: expected {words}a factor from 0 to {MOST_LAMPS:g}")
    return factor


def _checked_light(_: str, choice: Any) -> Any:
    """A captured light: None, "auto", the number of a candidate, a path or an Environment. Raises InputError."""
    if isinstance(choice, str) and (choice.strip().lstrip("+-").isdecimal() or choice.lower() == ANEW):
        choice = ANEW if choice.lower() == ANEW else int(choice)
    if isinstance(choice, int) and choice < 1:
        raise InputError(f"`captured_light` {choice}: expected the number of a likely light, from 1, a file, or {ANEW}")
    return choice


def _checked_effects(choice: str | Iterable[str], method: str) -> str | frozenset[str]:
    """ "auto", or the set of effects of a text or of names. Raises InputError for what makes no sense."""
    names = choice.replace(",", " ").split() or [""] if isinstance(choice, str) else list(map(str, choice))
    if names == ["auto"]:
        return "auto"
    effects = frozenset(() if names == ["none"] else names)
    listed = " ".join(sorted(effects))
    if effects - {*EFFECTS, GLOSS}:
        raise InputError(f"`effects` {listed!r}: expected auto or none alone, or some of {' '.join((*EFFECTS, GLOSS))}")
    if effects - {SHADOWS, GLOSS} and SHADOWS not in effects:
        raise InputError(f"`effects` {listed}: sun, bounces and volume need shadows too")
    if effects - _able(method) - {GLOSS}:
        raise InputError(f"`effects` {listed}: the method {method} has none; leave it at auto")
    if method == "raytraced" and not effects - {GLOSS}:
        raise InputError(f"`effects` none: the method {method} has shadows at least; use analytic, or leave it at auto")
    return effects


_CHECKED: dict[str, Callable[[str, Any], Any]] = {
    "method": lambda name, value: check_choice(name, value, METHODS),
    "seed": lambda _, seed: check_seed(seed),
    "bands": _checked_bands,
    "rays": lambda _, rays: check_rays(rays),
    "tolerance": _above_zero,
    "budget_s": _above_zero,
    "lamps": _checked_lamps,
    "placed": lambda _, placed: (placed,) if isinstance(placed, (str, os.PathLike)) else tuple(placed),
    "captured": _checked_factor,
    "env_scale": _checked_factor,
    "captured_sun": _checked_sun,
    "captured_sky": _checked_sky,
    "captured_light": _checked_light,
}
"""What a given value of each field becomes, by the name of the field and the value, or raises InputError."""
