"""The captured light of a session while a hand sets it: the albedo at once, with a traced sun when the input rests."""

from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Vector
from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear

from ..albedo.by_hand import HandLight, SkyAndSun, sun_through
from ..engine.by_hand import LightByHand
from ..output.offered_lights import light_map
from .bench import Answer, Bench, Check
from .request import SessionRequest
from .worker import in_words

MAP_WIDTH = 32
"""Columns of the map of a light on the panel."""

PREPARING = "tracing the captured light"

Bytes: TypeAlias = NDArray[np.uint8]

Setting: TypeAlias = tuple[int, HandLight]
"""Number of an offered light, from 0, and what is set of it."""


class HandBench(Bench[Setting | None, Bytes]):
    """The captured light as a hand sets it.

    setting: the present Setting; None before it is ready. kept: the one that was written last, or None.
    """

    def __init__(
        self,
        lights: Callable[[], LightByHand],
        under_kept_light: Callable[[], SessionRequest] | None = None,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        """Arguments as of SessionRequest, `lights` its `hand_source`. changed: called after every change."""
        super().__init__()
        self._message, self._source, self._under_kept_light, self._changed = "", lights, under_kept_light, changed
        self.setting: Setting | None = None
        self.kept: Setting | None = None
        self._relit: Future[SessionRequest] | None = None

    @property
    def wanted(self) -> Setting | None:
        """As of Bench."""
        return self.setting

    @property
    def message(self) -> str:
        """The text to show, or ""."""
        return self._message or self.failure

    @property
    def offered(self) -> list[SkyAndSun]:
        """The offered lights; none before it is ready."""
        return list(self.made.offered) if self.ready else []

    @property
    def number(self) -> int:
        """Number, from 0, of the offered light in use."""
        return 0 if self.setting is None else self.setting[0]

    @property
    def hand(self) -> HandLight:
        """What is set."""
        return HandLight() if self.setting is None else self.setting[1]

    def poll(self, rests: bool) -> bool:
        """As of Bench; the lights come first."""
        if self.ready and self.setting is None:
            self.choose(self.made.first)
        return self.setting is not None and super().poll(rests)

    def change(self, **changes: float) -> None:
        """Set fields of the HandLight. Raises InputError for names and numbers that are none."""
        if self.setting is not None:
            self._to(self.setting[0], self.setting[1].changed(**changes))

    def choose(self, number: int) -> None:
        """Begin anew with an offered light, counted from 0; the numbers wrap around."""
        if self.ready:
            number %= len(self.offered)
            self._to(number, self.offered[number].hand)

    def _to(self, number: int, hand: HandLight) -> None:
        self.setting, self._message = (number, hand), ""
        self._changed()

    def reset(self) -> None:
        """Begin anew with the offered light in use."""
        self.choose(self.number)

    def point(self, edge: Vector, caster: Vector) -> None:
        """Set the sun by a shadow's edge (3,) and what casts it (3,), scene frame. Raises InputError as `sun_through`.

        A light without a sun gets one that lights as much as its sky.
        """
        share = {} if self.hand.sun_share > 0.0 else {"sun_share": 0.5}
        self.change(**sun_through(edge, caster), **share)

    def keep(self) -> Path | None:
        """Write the light into the folder of the scene; its path, None before there is one. Raises InputError."""
        if self.setting is None:
            return None
        path: Path = self.made.keep(*self.setting)
        self.kept = self.setting
        if self._under_kept_light is not None:
            self._relit = self.submit(self._under_kept_light)
        return path

    def relit(self) -> SessionRequest | None:
        """The request of the scene under the light that was kept, once: None before it is there."""
        if self._relit is None or not self._relit.done():
            return None
        done, self._relit = self._relit, None
        error = done.exception()
        if error is not None:
            self._message = in_words(error)
        return None if error is not None else done.result()

    def map_of(self, number: int | None) -> NDArray[np.uint8]:
        """The map of an offered light, or of the present one for None: (MAP_WIDTH / 2, MAP_WIDTH, 3) uint8 sRGB."""
        offered = self.offered[self.number if number is None else number]
        return light_map(offered.environment(self.hand) if number is None else offered.whole, MAP_WIDTH)

    @property
    def figures(self) -> str:
        """What is set, in words."""
        if self.setting is None:
            return ""
        offered, hand = self.offered[self.number], self.hand
        sun = f"sun {hand.height_deg:.0f}\N{DEGREE SIGN} high at {hand.azimuth_deg:.0f}\N{DEGREE SIGN}"
        light = f"light {self.number + 1} of {len(self.offered)}: {offered.entry.name}"
        return f"{light}   set: {sun if hand.sun_share > 0.0 else 'no sun'}, {100 * hand.sun_share:.0f} % of the light"

    @property
    def follows(self) -> str:
        """What is under way, in words."""
        if not self.ready:
            return PREPARING
        if not self.settled:
            return "sharp shadows when the light rests"
        if self._relit is not None:
            return "kept: the scene is being relit"
        return "kept: commands use it" if self.kept == self.setting else "press 0 to keep it"

    def _prepare(self) -> LightByHand:
        lights = self._source()
        first = lights.first
        lights.albedo(first, lights.offered[first].hand)  # which traces and compiles what a drag needs
        return lights

    def _exactly(self, setting: Setting | None, _: Check) -> Callable[[], Bytes]:
        return partial(self._bytes, setting, True)

    def _quickly(self, setting: Setting | None, _: Answer[Setting | None, Bytes] | None) -> Callable[[], Bytes]:
        return partial(self._bytes, setting, False)

    def _bytes(self, setting: Setting | None, exact: bool) -> Bytes:
        assert setting is not None  # or nothing is asked
        return bytes_from_unit(srgb_from_linear(self.made.albedo(*setting, exact)))
