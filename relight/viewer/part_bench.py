"""A part of the capture that clicks make: each grows from a point of the surface, as far as its reach.

The part may be brighter than the rest, and tinted: that is kept with it, and commands light it so.
"""

from collections.abc import Hashable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask, Triple
from splat2mesh.scene.color import bytes_from_unit, linear_from_srgb, srgb_from_linear

from ..albedo.by_hand import HandLight
from ..output.sheet import MARK
from ..splats.grown_part import GrowingSurface
from ..splats.kept_parts import keep_part
from .history import Timeline
from .request import PartSource

REACH = 0.12
"""Of a first click, by `scripts/fit parts`: of those tried, a third of an octave apart, the one with most in common
with the parts of eight generated scenes. On eight others .095 is best."""

_NAME = "part"


@dataclass(frozen=True)
class PartClick:
    """place: of the click, in the frame of the splat. reach: as of `GrowingSurface.grown`."""

    place: tuple[float, float, float]
    reach: float


@dataclass(frozen=True)
class PartMade:
    """clicks: all that make a part. exposure_ev: stops by which it is brighter than the rest. warmth: of its light, as
    of a HandLight."""

    clicks: tuple[PartClick, ...] = ()
    exposure_ev: float = 0.0
    warmth: float = 0.0

    @property
    def light(self) -> dict[str, Any]:
        """What is of its own in its light, as of `lit_part`; none where that is of the rest."""
        tint = [round(float(each), 4) for each in HandLight(warmth=self.warmth).tint] if self.warmth else None
        return {"exposure": self.exposure_ev} | ({"tint": tint} if tint else {}) if self.exposure_ev or tint else {}


class PartBench:
    """The part that clicks make of a PartSource. timeline: undoes them. reach: that of the last click."""

    def __init__(self, source: PartSource, timeline: Timeline | None = None) -> None:
        self.source, self.timeline = source, timeline or Timeline()
        self.timeline.begin(_NAME, PartMade())
        self._surface: GrowingSurface | None = None
        self._grown: dict[PartClick, Mask] = {}
        self._reach = REACH

    @property
    def made(self) -> PartMade:
        """The present part."""
        found: PartMade = self.timeline.present(_NAME)
        return found

    @property
    def clicks(self) -> tuple[PartClick, ...]:
        """All that make the present part."""
        return self.made.clicks

    @property
    def reach(self) -> float:
        """Of the last click, or of the next one."""
        return self.clicks[-1].reach if self.clicks else self._reach

    def add(self, place: Triple) -> None:
        """Add what grows from a place of the surface, in the frame of the splat."""
        self._to(clicks=(*self.clicks, PartClick(place, self.reach)))

    def reach_to(self, reach: float) -> None:
        """Set how far the last click reaches, and the next ones."""
        self._reach = reach
        if self.clicks:
            *others, last = self.clicks
            self._to(("reach", len(others)), clicks=(*others, replace(last, reach=reach)))

    def light_to(self, name: str, value: float) -> None:
        """Set a field of its light, `exposure_ev` or `warmth`."""
        self._to(name, **{name: value})

    def _to(self, merge: Hashable = None, **changes: Any) -> None:
        self.timeline.to(_NAME, replace(self.made, **changes), merge)

    @property
    def vertices(self) -> Mask:
        """The vertices (V,) in the part."""
        if self._surface is None:
            self._surface = self.source.surface()
        new = [click for click in self.clicks if click not in self._grown]
        self._grown = {click: part for click, part in self._grown.items() if click in self.clicks}
        self._grown |= {click: self._surface.grown(np.array(click.place), click.reach) for click in new}
        return np.logical_or.reduce(list(self._grown.values()))

    @property
    def splats(self) -> Mask:
        """The splats (N,) in the part."""
        if not self.clicks:
            return np.zeros(len(self.source.splats), bool)
        part = self.vertices
        assert self._surface is not None
        return self._surface.splats_of(part, self.source.splats)

    def tinted(self, colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Colours (V, 3) uint8 with the part in another, or in its light where that is of its own."""
        if not self.clicks:
            return colors
        shown, part, made = colors.copy(), self.vertices, self.made
        if made.light:
            factor = np.float32(2.0**made.exposure_ev) * HandLight(warmth=made.warmth).tint.astype(np.float32)
            lit = factor * linear_from_srgb(shown[part] / np.float32(255.0))
            shown[part] = bytes_from_unit(srgb_from_linear(lit))
        else:
            shown[part] = (0.5 * shown[part] + 0.5 * np.array(MARK)).astype(np.uint8)
        return shown

    def keep(self) -> tuple[str, Path]:
        """Write the part into the folder of the scene and begin a new one: its name, and the folder. Raises InputError
        for an empty part and a folder that cannot be written."""
        name = keep_part(self.source.folder, self.splats, self.made.light)
        self.timeline.to(_NAME, PartMade())
        return name, self.source.folder
