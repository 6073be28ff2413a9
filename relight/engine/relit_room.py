"""A closed room in new light: its captured colours times the change of light on its surfaces.

The change is that of the model, new over captured, both by the same rays: where nothing changes, no bit does, and what
the model gets wrong in one light it mostly gets wrong in the other.
"""

import warnings
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning, InputError

from ..albedo.division import DARKEST
from ..light.environment import Environment
from ..rooms.evenness import Evenness
from ..rooms.room import Room
from ..transfer.bounces import with_bounces
from ..transfer.settings import Settings
from ..transfer.store import array_key
from .appearance import CAPTURE, Appearance
from .assumed_light import OUTSIDE, assumed_change
from .relighter import Relighter, Shading

SOFTNESS = 0.05
"""Share of the model's median light below which the mean change weighs more than the vertex's own."""

ROUNDS = 16
"""Times that light is averaged over rings of neighbours: what few rays and the dents of a scanned wall make of the
light of a window is seen as blotches on it. Of 3 cm each they blur shadows by a hand's breadth."""

MOST = 30.0
"""Largest change: five stops."""


class RelitRoom:
    """A closed room under environments, with the lamps that the options of its Relighter wish.

    look: its Appearance. relighter: of the scene. level: captured units per unit of the environments. lets_in: whether
    an environment enters by the model of the room: its light is known, and it has a window. Else what an environment
    changes is assumed.
    lamps_found: how many. lamp_factor: what their light is multiplied by.
    """

    def __init__(self, look: Appearance, relighter: Relighter, level: float) -> None:
        self._look, self._relighter, self._level = look, relighter, np.float32(level)
        self.lamp_factor = relighter.options.lamp_factor
        self._before: tuple[object, NDArray[np.float32]] | None = None
        self.lamps_found = 0 if look.room is None else len(look.room.report["lamps"])
        pointed = () if look.room is None else look.room.report.get("pointed", ())
        self._factors = relighter.options.lamp_factors(self.lamps_found, pointed)
        self._shut = look.room is not None and look.room.report["windows"] is None
        self.lets_in = not look.as_captured and not self._shut
        method = relighter.options.method
        if self.lets_in and method not in ("auto", "raytraced"):
            problem = f"`method` {method} knows no shadows: in a closed room its light comes through the walls"
            warnings.warn(f"{problem}; auto traces rays", DataWarning, stacklevel=3)

    @property
    def lamp_factors(self) -> list[float]:
        """The factor on the light of each captured lamp, by number."""
        return self._factors

    @property
    def exposure(self) -> float | None:
        """Display value per unit of the radiance of `shading`, as the capture was exposed; None where that is not
        known, of a room that is lit by its captured colours."""
        return 1.0 if self._look.as_captured else None if self._look.room is None else float(self._level)

    def shading(self, environment: Environment) -> Shading:
        """Exit radiance, in the unit of the environment, of a room as captured in that of its colours: a Shading."""
        look, room = self._look, self._look.room
        nothing = Shading(np.zeros_like(look.captured), 0, [], self._relighter.options.unplanned)
        if look.as_captured:
            colors, change = self.assumed(environment), assumed_change(environment)
            ratio = np.broadcast_to(change, colors.shape).copy()
            np.divide(colors, look.captured, out=ratio, where=look.captured > 0.0)
            return nothing._replace(radiance=colors, received=(look.irradiance * ratio).astype(np.float32))
        if room is None:
            return self._relighter.shading(environment, look.albedo)
        shaded = self._relighter.shading(environment, room.albedo) if self.lets_in else nothing
        radiance = self._changed(self._level * shaded.radiance, shaded.settings)
        return shaded._replace(radiance=(radiance / self._level).astype(np.float32))

    @property
    def outside(self) -> float:
        """Share of the captured light that is assumed to come from outside, where no environment gets in."""
        return 1.0 if self._look.room is None else OUTSIDE

    def assumed(self, environment: Environment, scale: float = 1.0) -> NDArray[np.float32]:
        """The captured colours, (V, 3) float32, under an environment times a scale, without a known way in for it.
        Lamps shine as the options say."""
        look, room, inside = self._look, self._look.room, np.float32(1.0 - self.outside)
        change = np.float32(self.outside) * assumed_change(environment, scale)
        if room is None:
            return np.asarray(look.captured * (inside + change), np.float32)
        own, glowing = self.with_its_own_light(), room.glow.any(axis=1, keepdims=True)
        if own is look.captured:
            colors, shining = own * (inside + change), own
        else:  # a lamp that is off is lit by what comes from outside
            colors, shining = inside * own + change * look.captured, own + change * room.by_lamps
        return np.asarray(np.where(glowing, shining, colors), np.float32)

    def with_its_own_light(self) -> NDArray[np.float32]:
        """The captured colours, (V, 3) float32, with each captured lamp as bright as the options say, all else as it
        was."""
        look, room = self._look, self._look.room
        if room is None or all(factor == 1.0 for factor in self._factors):
            return look.captured
        outside = np.zeros_like(look.captured)
        if not self._shut:
            outside = self._from_outside(CAPTURE)
        return self._changed(outside, CAPTURE).astype(np.float32)

    def _changed(self, outside: NDArray[np.float32], settings: Settings) -> NDArray[np.float32]:
        """The captured colours under light from outside by which the model sends out that radiance, (V, 3), and the
        lamps as the options say."""
        look, room = self._look, self._known
        after, usual, below = self._compared(outside + self._by_lamps, settings)
        radiance = look.captured * np.minimum((after + usual) / below, np.float32(MOST))
        glowing = room.glow.any(axis=1)
        if glowing.any():
            factors = np.array([*self._factors, 1.0], np.float32)[room.lamp_of[glowing], None]
            radiance[glowing] = after[glowing] + factors * room.glow[glowing]
        return radiance

    @cached_property
    def _by_lamps(self) -> NDArray[np.float32]:
        """(V, 3) float32 of the light of all lamps, each as bright as the options say, bounces included."""
        room, factors = self._known, np.array(self._factors, np.float32)
        if len(set(self._factors)) == 1:
            return factors[0] * room.by_lamps
        if not len(factors):
            return room.by_lamps
        interreflection = self._relighter.transport(CAPTURE).interreflection
        before, after = (
            with_bounces(np.einsum("l,lvc->vc", weights, room.lamp_light), room.albedo, interreflection)[0]
            for weights in (np.ones_like(factors), factors)
        )
        # By its model's change: without a window, captured colours replace the model.
        return room.by_lamps * np.divide(after, before, out=np.zeros_like(after), where=before > 0.0)

    def changes(
        self, after: NDArray[np.float32], settings: Settings
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """(own, usual), (V, 3) float32 both: the captured colours under light by which the model sends out `after`
        (V, 3) in all, times their own change, and times what the scene as a whole changes by, as far as that counts
        where little was modelled. Lamps pass on what they get, and have no usual change. Both are linear in `after`.

        settings: those by which `after` was computed, and the light of the capture is.
        """
        look, room = self._look, self._known
        after, usual, below = self._compared(after, settings)
        own, usual = look.captured * after / below, look.captured * usual / below
        glowing = room.glow.any(axis=1)
        own[glowing], usual[glowing] = after[glowing], 0.0
        return own, usual

    def lamps(self, settings: Settings) -> NDArray[np.float32]:
        """(V, 3) float32: the captured colours under the light of the lamps alone, as they were captured."""
        room = self._known
        own, usual = self.changes(room.by_lamps, settings)
        return own + usual + room.glow

    @property
    def _known(self) -> Room:
        """The Room, which live rooms always have."""
        assert self._look.room is not None
        return self._look.room

    def _compared(
        self, after: NDArray[np.float32], settings: Settings
    ) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]:
        """(after, usual, below): the change is (after + usual) / below. after: as even as what it is compared with, and
        as far as the model is trusted; the rest takes the mean change."""
        before = self._model(settings)
        if not self._shut:
            after = self._even_light(after)
        soft = np.float32(SOFTNESS) * np.median(before, axis=0) + np.float32(1e-6)
        mean = after.sum(axis=0, dtype=np.float64) / np.maximum(before.sum(axis=0, dtype=np.float64), 1e-12)
        usual, below, trust = mean.astype(np.float32), before + soft, self._known.trust[:, None]
        return trust * after, usual * (trust * soft + (1.0 - trust) * below), below

    def session(
        self, environment: Environment | None = None
    ) -> tuple[NDArray[np.float32] | None, NDArray[np.float32] | None]:
        """(albedo (V, 3), radiance (V, 3) of what the lamps light) by which a session shows it: what it shades with,
        and what it adds to every light, as captured; None for nothing to add. environment: that it shows first, which
        a room that lets none in keeps."""
        look, room = self._look, self._look.room
        if look.as_captured:
            return np.zeros_like(look.captured), look.captured if environment is None else self.assumed(environment)
        if room is None:
            return look.albedo, None
        return room.albedo, (room.by_lamps + room.glow) / self._level

    def as_captured(self, radiance: NDArray[np.float32], settings: Settings) -> NDArray[np.float32]:
        """What `shading` gives where a session shows a radiance (V, 3), lamps included: the captured colours times the
        change. settings: those by which the light of the capture is computed."""
        look, room = self._look, self._known
        after, glowing = self._level * radiance, room.glow.any(axis=1)
        shining = after[glowing]
        after[glowing] = room.by_lamps[glowing]
        after, usual, below = self._compared(after, settings)
        found = look.captured * np.minimum((after + usual) / below, np.float32(MOST))
        found[glowing] = shining
        return (found / self._level).astype(np.float32)

    def _even_light(self, radiance: NDArray[np.float32]) -> NDArray[np.float32]:
        """Radiance (V, 3) of which the light, not the albedo, is averaged along the surface."""
        albedo = np.maximum(self._known.albedo, np.float32(DARKEST))
        return albedo * self._evenness.average(radiance / albedo, ROUNDS)

    @cached_property
    def _evenness(self) -> "Evenness":
        return Evenness(self._relighter.occluder)

    def _model(self, settings: Settings) -> NDArray[np.float32]:
        """(V, 3) captured light according to the model, by these settings, as smooth as the light compared with it."""
        room = self._known
        if self._before is None or self._before[0] != settings:
            before = room.by_lamps
            if not self._shut:
                before = self._even_light(before + self._from_outside(settings))
            self._before = settings, before
        return self._before[1]

    def _from_outside(self, settings: Settings) -> NDArray[np.float32]:
        """(V, 3) float32 of what the windows let in of the captured light, by these settings; kept between runs."""
        room, relighter = self._known, self._relighter
        environment, seen = room.environment, relighter.precomputed.transfer(settings)[0]
        rays = relighter.precomputed.interreflection(settings.bounce_rays, seen).rays if settings.bounce_rays else 0
        text = np.frombuffer(repr((settings, rays, environment.rotation_deg)).encode(), np.uint8)
        key = array_key(environment.radiance, room.albedo, seen[:, 0], text), relighter.seed

        def checked(kept: dict[str, NDArray[Any]]) -> NDArray[np.float32]:
            radiance = np.asarray(kept["radiance"])
            if radiance.dtype != np.float32 or radiance.shape != room.albedo.shape or not np.isfinite(radiance).all():
                raise InputError("the kept light of a room is of another kind")
            return radiance

        found = relighter.cache.restored(checked, "windows", *key)
        if found is None:
            found = relighter.shading(environment, room.albedo, settings).radiance
            relighter.cache.put("windows", *key, radiance=found)
        return found
