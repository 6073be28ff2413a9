"""The light of a request on a scene: an environment, what stays of the captured light, and added lamps."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ..lamps.asked import AskedLamp, LampScale, in_words, resolve
from ..lamps.photometry import times
from ..lamps.shapes import moved
from ..lamps.spec import in_brief
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..light.tonemap import auto_exposure
from ..options import LightingOptions
from .appearance import Appearance
from .assumed_light import assumed_change
from .exposure import exposure_as_captured, level_of
from .lamp_scale import lamp_scale
from .placed import LampLight
from .relighter import Relighter, Shaded, Shading

if TYPE_CHECKING:
    from ..lamps.shapes import Lamp
    from .relit_room import RelitRoom

Received: TypeAlias = Callable[[NDArray[np.float32], float], NDArray[np.floating]]
"""The irradiance over pi (V, 3) of the radiance (V, 3) that an environment gives, at an exposure."""


class LightBeside(NamedTuple):
    """Light beside an environment, in its unit.

    radiance, received: (V, 3) float32, exit radiance and irradiance over pi of all parts but the environment.
    env_scale: factor on the environment. level: units of the picture per unit of the environment. backdrop: factor on
    the visible light itself. keeps_sky: whether the sky is that of the capture, only dimmed. captured: factor on the
    captured light. bounces: of the lamps, as of a Shading.
    """

    radiance: NDArray[np.float32]
    received: NDArray[np.float32]
    env_scale: float
    level: float
    backdrop: float
    keeps_sky: bool
    captured: float = 0.0
    bounces: Sequence[float] = ()

    def with_environment(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the radiance (V, 3) of all parts. radiance: of the environment."""
        return np.asarray(self.radiance + np.float32(self.env_scale) * radiance, np.float32)

    def receives(self, received: Received) -> Received:
        """Return a function for the irradiance of all parts. received: that of the environment alone."""

        def mixed(radiance: NDArray[np.float32], exposure: float) -> NDArray[np.floating]:
            if not (radiance.any() and self.env_scale > 0.0):
                return self.received
            return self.received + np.float32(self.env_scale) * received(radiance, self.level)

        return mixed

    def shading(self, look: Appearance, environment: Shading) -> Shading:
        """Return the Shading of all parts. environment: that under the environment alone."""
        return environment._replace(
            radiance=self.with_environment(environment.radiance),
            received=np.asarray(self.receives(look.received)(environment.radiance, self.level), np.float32),
            bounces=environment.bounces or list(self.bounces),
        )


def light_beside(
    look: Appearance, colors: NDArray[np.float32], captured: float, placed: Any, level: float
) -> LightBeside:
    """Return the captured light that stays and the light of lamps, beside an environment of factor 1.

    colors: (V, 3) float32, the captured colours under the captured light, with its lamps as in the options. captured:
    its dimming. placed: a Placed, what lamps do, in units of the picture, or None. level: units of the picture per unit
    of the environment.

    What receives k E of the captured light E and L of lamps sends out c (k E + L) / E = k c + a L: the captured colour
    c keeps its gloss and its detail, and only the new light needs the albedo a.
    """
    kept = np.float32(captured) * colors
    # The captured light at each vertex after switching: unchanged to the bit if nothing was switched off.
    change = np.divide(colors, look.captured, out=np.ones_like(look.captured), where=look.captured > 0.0)
    share = np.float32(captured) * change * look.irradiance
    if placed is not None:
        kept, share = kept + placed.radiance, share + placed.received
    radiance, received = (np.asarray(each / np.float32(level), np.float32) for each in (kept, share))
    bounces = () if placed is None else placed.bounces
    return LightBeside(radiance, received, 1.0, level, 1.0, False, captured, bounces)


class LightKind(Enum):
    """What a new light is."""

    ALONE = "an unchanged environment"
    MIXED = "an environment, changed or beside captured light or lamps"
    CAPTURED = "the captured light, changed or not, and lamps"

    @property
    def adds(self) -> bool:
        """Whether it is more than an unchanged environment."""
        return self is not LightKind.ALONE


def kind_of(options: LightingOptions, environment: Environment) -> LightKind:
    """Return the LightKind of an environment with these options."""
    if isinstance(environment, CapturedLight):
        return LightKind.CAPTURED
    return LightKind.MIXED if options.adds_light else LightKind.ALONE


@dataclass(frozen=True, eq=False)
class LightMix:
    """All light on a scene: an environment, the captured light, added lamps. Its parts are computed on first use.

    options: LightingOptions. asked_lamps: the requested lamps. environment: Environment, unrotated. relighter, look,
    room: of the scene; room is None where it is no closed one. exposure_ev: as requested, or None. metre: splat units
    per metre where the capture does not tell it; see `lamp_scale`. known_scale: of a scene that this is a part of.
    """

    options: LightingOptions
    asked_lamps: Sequence[AskedLamp]
    environment: Environment
    relighter: Relighter
    look: Appearance
    room: "RelitRoom | None" = None
    exposure_ev: float | None = None
    metre: float | None = None
    known_scale: LampScale | None = None

    def under(self, light: Environment) -> "LightMix":
        """The same parts beside another environment."""
        return replace(self, environment=light)

    # its factors

    @property
    def kind(self) -> LightKind:
        """What the light is."""
        return kind_of(self.options, self.environment)

    @property
    def alone(self) -> bool:
        """Whether the environment adds no light: it is the captured light, or does not enter the room."""
        return self.kind is LightKind.CAPTURED or self.look.as_captured

    @property
    def captured_factor(self) -> float:
        """The fraction of captured light that stays."""
        given = self.options.captured
        return float(self.alone) if given is None else given

    @property
    def env_scale(self) -> float:
        """The factor on the environment; 0 where it adds no light."""
        return 0.0 if self.alone else self.options.env_scale

    @property
    def assumes(self) -> bool:
        """Whether an environment changes the room by an assumption: it lets none in, and the request adds no lamps and
        leaves the captured light as it is."""
        return self.look.as_captured and self.options.captured is None and not self.asked_lamps

    @property
    def assumed(self) -> NDArray[np.float32] | None:
        """By that assumption the factor on captured light from outside, (3,) float32; None without it."""
        if not self.assumes or self.kind is LightKind.CAPTURED:
            return None
        return assumed_change(self.environment, self.options.env_scale)

    # its exposure

    @property
    def brightness(self) -> float | None:
        """Mean luminance of the light of the capture, in captured units; None where it is not known."""
        return self.look.capture["brightness"] if self.look.capture else None

    def level(self, radiance: NDArray[np.float32] | None, light: Environment | None = None) -> float:
        """Units of the picture per unit of the environment, or of another light, which gives a radiance (V, 3); None in
        a room whose exposure is known."""
        mix = self if light is None else self.under(light)
        if mix.alone:
            return 1.0
        if light is None and self.room and self.room.exposure is not None:
            return self.room.exposure
        if self.brightness is None and radiance is not None:
            return auto_exposure(radiance)
        return level_of(self.brightness, mix.environment)

    @property
    def level_is_known(self) -> bool:
        """Whether `level` needs no radiance."""
        return self.alone or self.brightness is not None or bool(self.room and self.room.exposure is not None)

    def exposure(self, lights: Sequence[Environment], first: NDArray[np.float32]) -> float:
        """Display value per unit of radiance: 2^EV if requested; otherwise the exposure of the capture's camera under
        an equally bright sky, within a stop of the exposure for the brightest vertices under any of the lights. Without
        a known capture, it is the latter. first: radiance (V, 3) under the first light."""
        if self.exposure_ev is not None:
            return 2.0**self.exposure_ev
        if self.kind.adds:  # lamps are given in units of the picture
            return self.level(first)
        if self.room and self.room.exposure is not None:
            return self.room.exposure
        others = (self.alone_under(light).radiance for light in lights[1:])
        least = min([auto_exposure(first), *map(auto_exposure, others)])
        return exposure_as_captured(self.brightness, self.look.captured, self.environment, least)

    def exposure_of(self, light: Environment, radiance: NDArray[np.float32] | None) -> float:
        """The same for one other light. radiance: None in a room whose exposure is known."""
        if self.exposure_ev is not None:
            return 2.0**self.exposure_ev
        if radiance is None:
            return level_of(self.brightness, light)
        return exposure_as_captured(self.brightness, self.look.captured, light, auto_exposure(radiance))

    # its lamps

    @property
    def lamp_factors(self) -> list[float]:
        """The factor on each captured lamp of a closed room."""
        return self.room.lamp_factors if self.room else []

    @cached_property
    def scale(self) -> LampScale:
        """The length of a metre and the brightness of the captured light, which the fields of lamps refer to."""
        return self.known_scale or lamp_scale(self.relighter.scene, self.look, self.relighter.occluder, self.metre)

    @property
    def scale_known(self) -> bool:
        """Whether the capture has a known scale in metres."""
        return bool(self.relighter.scene.capture.get("eyes"))

    @cached_property
    def lamps(self) -> "list[Lamp]":
        """The added lamps, in the frame of the splat and in units of the picture."""
        return [resolve(each, self.scale) for each in self.asked_lamps]

    @cached_property
    def lamp_light(self) -> "LampLight | None":
        """The light of the added lamps, or None."""
        return self._lit_by(self.asked_lamps, self.captured_factor) if self.asked_lamps else None

    def light_of(self, asked_lamps: Sequence[AskedLamp], captured: float) -> "LampLight":
        """The light of other lamps, beside a fraction of the captured light."""
        return self._lamp_ground.of(self.in_scene(asked_lamps), captured)

    def in_scene(self, asked_lamps: Sequence[AskedLamp]) -> "list[Lamp]":
        """Lamps in the frame of the scene and in units of the picture."""
        motion = self.relighter.scene.scene_from_splat
        return [moved(resolve(each, self.scale), motion) for each in asked_lamps]

    @cached_property
    def _lamp_ground(self) -> "LampLight":
        """The shared part of the light of all lamps."""
        return self.lamp_light or self._lit_by([], 1.0)

    def _lit_by(self, asked_lamps: Sequence[AskedLamp], captured: float) -> "LampLight":
        return LampLight(self.relighter, self.look, self.in_scene(asked_lamps), self.options.accepted_error, captured)

    @property
    def in_words(self) -> list[str]:
        """A line on each added lamp: its position and brightness."""
        place = "room" if self.relighter.scene.capture.get("from") == "inside" else "scene"
        return [f"{in_brief(lamp)}: {in_words(lamp, self.scale, place)}" for lamp in self.lamps]

    def lamps_shown(self, light: Environment, radiance: NDArray[np.float32], exposure: float) -> "list[Lamp]":
        """The lamps beside a light that gives a radiance (V, 3) and is shown at an exposure, in the frame of the scene
        and in display values."""
        if self.lamp_light is None:
            return []
        factor = 1.0 if self.exposure_ev is None else exposure / self.level(radiance, light)
        return [times(lamp, factor) for lamp in self.lamp_light.lamps]

    # the light itself

    def alone_under(self, light: Environment) -> Shading:
        """The scene under an environment alone; black for the captured light."""
        if isinstance(light, CapturedLight):
            return Shading(np.zeros_like(self.look.captured), 0, [], self.options.unplanned)
        if self.room:
            return self.room.shading(light)
        return self.relighter.shading(light, self.look.albedo)

    @cached_property
    def own_colors(self) -> NDArray[np.float32]:
        """(V, 3) float32 captured colours under the requested captured light. In a room that no environment enters, it
        follows an environment that is requested alone."""
        if self.room is None:
            return self.look.captured
        if self.assumed is None:
            return self.room.with_its_own_light()
        return self.room.assumed(self.environment, self.options.env_scale)

    def beside(self, level: float, captured: float, placed: Any) -> LightBeside:
        """The light beside the environment. level: as of `level`. captured: fraction of the captured light. placed: the
        Placed of lamps, or None."""
        found = light_beside(self.look, self.own_colors if captured else self.look.captured, captured, placed, level)
        scale = 0.0 if self.look.as_captured else self.options.env_scale
        backdrop = captured if self.alone else scale
        return found._replace(env_scale=scale, backdrop=backdrop, keeps_sky=self.kind is LightKind.CAPTURED)

    def mixed(self, shaded: Shaded, level: float | None = None) -> Shaded:
        """The light of an environment with all its other parts. level: as of `level`, where it is known."""
        level = self.level(shaded.shading.radiance) if level is None else level
        captured, lamps = self.captured_factor, self.lamp_light
        beside = self.beside(level, captured, None if lamps is None else lamps.placed)
        shading = beside.shading(self.look, shaded.shading)
        return Shaded(
            shaded.light, shading, shaded.exposure, beside.backdrop, self.env_scale, captured=captured, level=level
        )

    def parts(self, level: float) -> dict[str, NDArray[np.float32]]:
        """Exit radiance (V, 3) of surfaces under the captured light and under added lamps, in the environment's unit.
        level: as of `level`."""
        found = {}
        if self.captured_factor:
            found["captured"] = self.own_colors * np.float32(self.captured_factor / level)
        if self.lamp_light is not None:
            found["lamps"] = self.lamp_light.placed.radiance / np.float32(level)
        return found
