"""The light of a session's lamps: the engine, in the form that the session needs."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from splat2mesh.render.raycaster import Hits

from ..engine.light_mix import LightBeside
from ..lamps.asked import AskedLamp, LampScale


class LampParts(Protocol):
    """The light of lamps, as of `engine.placed.Placed`: (V, 3) float32 exit radiance, and irradiance over pi."""

    @property
    def radiance(self) -> NDArray[np.float32]: ...

    @property
    def received(self) -> NDArray[np.float32]: ...


class LampTracer(Protocol):
    """The light of some lamps on the scene, as of `engine.placed.LampLight`."""

    def glimpse(self) -> NDArray[np.float32]:
        """Direct light on the white scene, (V, 3), at once."""

    def draft(self, advance: Callable[[int], None] = ...) -> NDArray[np.float32]:
        """The same with more rays, without a plan."""

    def direct_of(self, *lamps: int, advance: Callable[[int], None] = ...) -> NDArray[np.float32]:
        """Direct light of some of them on the white scene, (V, 3)."""

    def without_bounces(self, direct: NDArray[np.float32]) -> Any:
        """The effect of direct light (V, 3), as LampParts."""

    def with_bounces(self, direct: NDArray[np.float32]) -> Any:
        """Its effect with bounces, as LampParts."""


class LampSource(NamedTuple):
    """A scene whose lamps can be changed.

    asked, captured: the lamps at the start, in the frame of the splat, and the factor on the captured light. mixes:
    whether there is light beside the environment at the start. prepare: the long work, done once. light_of: the
    LampTracer of lamps beside a factor on the captured light. mixture: the LightBeside of a factor on the captured
    light and LampParts, or None for no lamps. scale: the LampScale. first_hits: the hits of rays (N, 6) in the frame of
    the scene; distances in lengths of their directions. command: the command that relights with the saved lamps.
    """

    asked: Sequence[AskedLamp]
    captured: float
    mixes: bool
    prepare: Callable[[], None]
    light_of: Callable[[Sequence[AskedLamp], float], LampTracer]
    mixture: Callable[[float, LampParts | None], LightBeside]
    scale: Callable[[], LampScale]
    first_hits: Callable[[NDArray[np.float32]], Hits]
    scene_from_splat: NDArray[np.float64]
    command: str = ""
