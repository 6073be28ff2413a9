"""Light beside an environment: the remaining captured light, and added lamps."""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..engine.appearance import Appearance
from ..engine.assumed_light import assumed_change
from ..engine.exposure import level_of
from ..engine.mixing import CapturedPart, mixed
from ..engine.relighter import Relighter, Shaded, Shading
from ..light.captured import CapturedLight
from ..light.environment import Environment
from ..light.tonemap import auto_exposure
from ..options import DEFAULT_TOLERANCE, LightingOptions

if TYPE_CHECKING:
    from ..engine.placed import LampLight, Placed
    from ..engine.relit_room import RelitRoom
    from ..lamps.asked import AskedLamp, LampScale
    from ..lamps.shapes import Lamp
    from ..live.mixture import Mixture
    from ..output.lamps_glb import PlacedLamps
    from ..viewer.mixture import SessionMixture


class ExtraLight:
    """The light on a scene beside its environment, computed on first use.

    options: LightingOptions. asked_lamps: the requested lamps. environment: Environment, unrotated.
    exposure_ev: as requested, or None. relighter, look, room: of the scene; room is None where it is no closed one.
    """

    def __init__(
        self,
        options: LightingOptions,
        asked_lamps: Sequence["AskedLamp"],
        environment: Environment,
        exposure_ev: float | None,
        relighter: Relighter,
        look: Appearance,
        room: "RelitRoom | None",
    ) -> None:
        self._options, self.asked_lamps, self._environment = options, list(asked_lamps), environment
        self._exposed, self._relighter, self._look, self._room = exposure_ev is not None, relighter, look, room
        self._steady = bool(room and room.steady)
        self._brightness: float | None = look.capture["brightness"] if look.capture else None

    @property
    def alone(self) -> bool:
        """Whether the environment adds no light: it is the captured light, or does not enter the room."""
        return isinstance(self._environment, CapturedLight) or self._steady

    @property
    def captured_factor(self) -> float:
        """The fraction of captured light that stays."""
        given = self._options.captured
        return float(self.alone) if given is None else given

    @property
    def env_scale(self) -> float:
        """The factor on the environment; 0 where it adds no light."""
        return 0.0 if self.alone else self._options.env_scale

    @property
    def assumed(self) -> NDArray[np.float32] | None:
        """Factor on captured light from outside, (3,) float32, in a room that lets no environment in. None elsewhere,
        beside added lamps, and where the request sets the captured light."""
        given = self._options.captured is not None or bool(self.asked_lamps)
        if not self._room or not self._look.kept or given or isinstance(self._environment, CapturedLight):
            return None
        return assumed_change(self._environment, self._options.env_scale)

    @property
    def lamp_factors(self) -> list[float]:
        """The factor on each captured lamp of a closed room."""
        return self._room.lamp_factors if self._room else []

    @cached_property
    def scale(self) -> "LampScale":
        """The length of a metre and the brightness of the captured light, which the fields of lamps refer to."""
        from ..engine.lamp_scale import lamp_scale

        return lamp_scale(self._relighter.scene, self._look, self._relighter.occluder)

    @property
    def scale_known(self) -> bool:
        """Whether the capture has a known scale in metres."""
        return bool(self._relighter.scene.capture.get("eyes"))

    @cached_property
    def lamps(self) -> "list[Lamp]":
        """The added lamps, in the frame of the splat and in units of the picture."""
        from ..lamps.asked import resolve

        return [resolve(each, self.scale) for each in self.asked_lamps]

    @cached_property
    def lamp_light(self) -> "LampLight | None":
        """The light of the added lamps, or None."""
        if not self.asked_lamps:
            return None
        from ..engine.placed import LampLight
        from ..lamps.moving import moved

        tolerance = self._options.tolerance or DEFAULT_TOLERANCE
        lamps = [moved(lamp, self._relighter.scene.scene_from_splat) for lamp in self.lamps]
        return LampLight(self._relighter, self._look, lamps, tolerance, self.captured_factor)

    def light_of(self, asked_lamps: Sequence["AskedLamp"], captured: float) -> "LampLight":
        """The light of other lamps, beside a fraction of the captured light."""
        from ..lamps.asked import resolve
        from ..lamps.moving import moved

        motion = self._relighter.scene.scene_from_splat
        return self._lamp_ground.of([moved(resolve(each, self.scale), motion) for each in asked_lamps], captured)

    @cached_property
    def _lamp_ground(self) -> "LampLight":
        """The shared part of the light of all lamps."""
        from ..engine.placed import LampLight

        if self.lamp_light is not None:
            return self.lamp_light
        return LampLight(self._relighter, self._look, [], self._options.tolerance or DEFAULT_TOLERANCE)

    @property
    def in_words(self) -> list[str]:
        """A line on each added lamp: its position and brightness."""
        from ..lamps.asked import in_words
        from ..lamps.placing import in_brief

        place = "room" if self._relighter.scene.capture.get("from") == "inside" else "scene"
        return [f"{in_brief(lamp)}: {in_words(lamp, self.scale, place)}" for lamp in self.lamps]

    def lamps_shown(self, light: Environment, radiance: NDArray[np.float32], exposure: float) -> "PlacedLamps":
        """The lamps beside a light that gives a radiance (V, 3) and is shown at an exposure, in the frame of the scene
        and in display values."""
        from ..lamps.photometry import times
        from ..output.lamps_glb import PlacedLamps

        if self.lamp_light is None:
            return PlacedLamps()
        factor = exposure / self.level_under(light, radiance) if self._exposed else 1.0
        lamps = [times(lamp, factor) for lamp in self.lamp_light.lamps]
        return PlacedLamps(lamps, [each.name for each in self.asked_lamps])

    def mixed(self, shaded: Shaded, level: float | None = None) -> Shaded:
        """The same light with all its other parts. level: as of `level_of`, where it is known."""
        placed = None if self.lamp_light is None else self.lamp_light.placed
        level = self.level(shaded.shading.radiance) if level is None else level
        return self._mixed(shaded, level, self.captured_factor, placed)

    def _mixed(self, shaded: Shaded, level: float, captured: float, placed: "Placed | None") -> Shaded:
        own, shading = self._own if captured else self._look.captured, shaded.shading
        if self.alone:  # of a room that lets no environment in `own` has what that is assumed to change
            shading = shading._replace(radiance=np.zeros_like(own))
        part = CapturedPart(own, captured)
        shading = mixed(self._look, shading, self._options.env_scale, part, placed, level)
        scale = 0.0 if self.alone else self._options.env_scale
        backdrop = captured if self.alone else scale
        return Shaded(shaded.light, shading, shaded.exposure, backdrop, scale, captured, level)

    def parts(self, level: float) -> dict[str, NDArray[np.float32]]:
        """Exit radiance (V, 3) of surfaces under the captured light and under added lamps, in the environment's unit.
        level: as for `level`."""
        found = {}
        if self.captured_factor:
            found["captured"] = self._own * np.float32(self.captured_factor / level)
        if self.lamp_light is not None:
            found["lamps"] = self.lamp_light.placed.radiance / np.float32(level)
        return found

    @cached_property
    def _own(self) -> NDArray[np.float32]:
        """The captured colours under the requested captured light. In a room that no environment enters, it follows an
        environment that is requested alone."""
        if self._room is None:
            return self._look.captured
        if self.assumed is None:
            return self._room.with_its_own_light()
        return self._room.assumed(self._environment, self._options.env_scale)

    def level(self, radiance: NDArray[np.float32]) -> float:
        """Units of the picture per unit of the environment, which gives a radiance (V, 3)."""
        if self.alone:
            return 1.0
        if self._room and self._room.exposure is not None:
            return self._room.exposure
        if self._brightness is None:
            return auto_exposure(radiance)
        return level_of(self._brightness, self._environment)

    def level_under(self, light: Environment, radiance: NDArray[np.float32] | None) -> float:
        """The same under another light; radiance: None in a room whose exposure is known."""
        if isinstance(light, CapturedLight) or self._steady:
            return 1.0
        if self._brightness is None and radiance is not None:
            return auto_exposure(radiance)
        return level_of(self._brightness, light)

    def live(self) -> "Mixture":
        """The mixture for live light."""
        from ..live.mixture import Mixture

        options, room = self._options, self._room
        asked = bool(self.asked_lamps) or options.captured is not None or options.env_scale != 1.0
        changes = asked or isinstance(self._environment, CapturedLight)
        colors = room.with_its_own_light() if room and changes else None
        names, lamps = [each.name for each in self.asked_lamps], self.lamps if self.asked_lamps else []
        return Mixture(asked, options.captured, options.env_scale, self.lamp_light, lamps, names, colors, self._exposed)

    def of_session(
        self, light: Environment, level: float, captured: float, placed: "Placed | None"
    ) -> "SessionMixture":
        """The mixture for a session under a light with `level` units of the picture per unit, a fraction of the
        captured light, and factors on lamps."""
        from ..viewer.mixture import SessionMixture

        options = self._options
        nothing = Shading(np.zeros_like(self._look.captured), 0, [], options.unplanned)
        rest = self._mixed(Shaded(light, nothing, 1.0), level, captured, placed)
        assert rest.shading.received is not None  # of a mixture it is known
        scale = 0.0 if self._steady else options.env_scale
        backdrop = captured if self.alone else options.env_scale
        parts = rest.shading.radiance, rest.shading.received
        own = isinstance(self._environment, CapturedLight)
        return SessionMixture(*parts, scale, level, backdrop, own, captured)
