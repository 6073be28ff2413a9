"""What a session needs to set the captured light by hand. Types only, so they import no engine."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from splat2mesh.render.raycaster import Hits

    from ..albedo.by_hand import HandLight, SkyAndSun


class HandLights(Protocol):
    """An `engine.by_hand.LightByHand`, which documents each of these."""

    @property
    def offered(self) -> "Sequence[SkyAndSun]": ...

    @property
    def first(self) -> int: ...

    def albedo(self, number: int, hand: "HandLight", exact: bool = False) -> NDArray[np.float32]: ...

    def keep(self, number: int, hand: "HandLight") -> Path: ...


@dataclass(frozen=True, eq=False)
class HandSource:
    """lights: returns the HandLights, called in a thread since it may trace rays. first_hits: of rays (N, 6) float32,
    scene frame."""

    lights: Callable[[], HandLights]
    first_hits: "Callable[[NDArray[np.float32]], Hits]"
