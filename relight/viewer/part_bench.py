"""A part of the capture that clicks make: each grows from a point of the surface, as far as its reach."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask, Vector

from ..splats.grown_part import GrowingSurface
from ..splats.kept_parts import keep_part
from .history import Timeline
from .sources import PartSource

REACH = 0.14
"""Of a first click: in `examples/garden.sog` a door, wooden furniture, the lawn and two pots come off at it. At .07
most have gaps, at .25 four of the five run over."""

TINT = np.array([224, 118, 45], np.float32)
"""sRGB of what is in the part, half of the colour that shows."""

_NAME = "part"


@dataclass(frozen=True)
class PartClick:
    """place: of the click, in the frame of the splat. reach: as of `GrowingSurface.grown`."""

    place: tuple[float, float, float]
    reach: float


class PartBench:
    """The part that clicks make of a PartSource. timeline: undoes them. reach: that of the last click."""

    def __init__(self, source: PartSource, timeline: Timeline | None = None) -> None:
        self.source, self.timeline = source, timeline or Timeline()
        self.timeline.begin(_NAME, ())
        self._surface: GrowingSurface | None = None
        self._grown: dict[PartClick, Mask] = {}
        self._reach = REACH

    @property
    def clicks(self) -> tuple[PartClick, ...]:
        """All that make the present part."""
        found: tuple[PartClick, ...] = self.timeline.present(_NAME)
        return found

    @property
    def reach(self) -> float:
        """Of the last click, or of the next one."""
        return self.clicks[-1].reach if self.clicks else self._reach

    def add(self, place: Vector) -> None:
        """Add what grows from a place (3,) of the surface, scene frame."""
        back = np.linalg.inv(self.source.scene_from_splat)
        x, y, z = (float(each) for each in back[:3, :3] @ place + back[:3, 3])
        self.timeline.to(_NAME, (*self.clicks, PartClick((x, y, z), self.reach)))

    def reach_to(self, reach: float) -> None:
        """Set how far the last click reaches, and the next ones."""
        self._reach = reach
        if self.clicks:
            *others, last = self.clicks
            self.timeline.to(_NAME, (*others, replace(last, reach=reach)), ("reach", len(others)))

    def reset(self) -> None:
        """Begin a new part."""
        if self.clicks:
            self.timeline.to(_NAME, ())

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
        """Colours (V, 3) uint8 with the part in another."""
        if not self.clicks:
            return colors
        shown, part = colors.copy(), self.vertices
        shown[part] = (0.5 * shown[part] + 0.5 * TINT).astype(np.uint8)
        return shown

    def keep(self) -> tuple[str, Path]:
        """Write the part into the folder of the scene and begin a new one: its name, and the folder. Raises InputError
        for an empty part and a folder that cannot be written."""
        name = keep_part(self.source.folder, self.splats)
        self.reset()
        return name, self.source.folder
