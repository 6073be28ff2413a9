"""The light of placed lamps on a scene: direct, and reflected by its surfaces."""

import copy
import math
import warnings
from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.base.progress import Advance
from splat2mesh.scene.color import BLACK, luminance

from ..albedo.division import DARKEST, LIGHTEST
from ..lamps.emitters import Emitters, emitters_of
from ..lamps.shapes import Lamp
from ..lamps.tracing import Ordered, lamplight, ordered
from ..planning.lamp_plan import RayPlan, plan_first_bounce, plan_lamps
from ..rooms.evenness import Evenness
from ..rooms.room import AVERAGING_ROUNDS
from ..transfer.bounces import with_bounces
from ..transfer.first_bounce import first_bounce
from ..transfer.occluder import Frame, Occluder
from .appearance import CAPTURE
from .relit_room import ROUNDS

if TYPE_CHECKING:
    from ..transfer.bounces import Interreflection
    from .appearance import Appearance
    from .relighter import Relighter

NEGLIGIBLE = 0.01
"""Part of the tolerance, of the median light of the capture, below which one lamp's light at a vertex is left out."""


class Placed(NamedTuple):
    """The light of placed lamps, unit of the picture. radiance, received: (V, 3) float32, exit radiance and irradiance
    over pi, bounces included. direct: (V, 3) float32 irradiance over pi without bounces. bounces: relative contribution
    of each bounce."""

    radiance: NDArray[np.float32]
    received: NDArray[np.float32]
    direct: NDArray[np.float32]
    bounces: list[float]


class LampLight:
    """The light of placed lamps on the scene of a Relighter, found once.

    lamps: in the frame of the scene, unit of the picture. look: the Appearance, whose albedo bounces take.
    captured: factor on the light of the capture beside them.
    """

    def __init__(
        self,
        relighter: "Relighter",
        look: "Appearance",
        lamps: Sequence[Lamp],
        tolerance: float,
        captured: float = 1.0,
    ) -> None:
        self._relighter, self._look, self.lamps = relighter, look, list(lamps)
        self._tolerance, self._captured = tolerance, np.float32(captured)
        self._frame = relighter.occluder.frame
        self._emitters = emitters_of(self.lamps, self._frame.center, self._frame.diagonal)
        self._least = NEGLIGIBLE * tolerance * float(np.median(luminance(look.irradiance)))

    @property
    def emitters(self) -> Emitters:
        """The Emitters of the lamps, in `frame`."""
        return self._emitters

    @property
    def frame(self) -> Frame:
        """The unit Frame of the scene."""
        return self._frame

    @cached_property
    def plan(self) -> RayPlan:
        """The number of rays that they need."""
        relighter, beside = self._relighter, self._captured * self._look.irradiance
        more: dict[str, Any] = {"leaf": self._leaf, "least": self._least, "seed": relighter.options.seed}
        with relighter.stages.stage("plan"):
            return plan_lamps(self._receivers, self._emitters, beside, self._tolerance, **more)

    @cached_property
    def bounce_plan(self) -> RayPlan | None:
        """The number of rays that their first bounce needs, for hard shadows; None without bounces or lamps."""
        if not self._bounces or not len(self._emitters.kind):
            return None
        left = math.sqrt(max(self._tolerance**2 - self.plan.error**2, (self._tolerance / 2.0) ** 2))
        seed, beside = self._relighter.options.seed, self._captured * self._look.irradiance
        with self._relighter.stages.stage("plan"):
            direct = self.glimpse()
            return plan_first_bounce(
                self._receivers, self._albedo * direct, self._interreflection, beside + direct, left, seed
            )

    def plan_dict(self) -> dict[str, Any]:
        """Both plans, JSON-clean, for the report."""
        return {**self.plan.as_dict(), "first_bounce": self.bounce_plan and self.bounce_plan.as_dict()}

    @cached_property
    def placed(self) -> Placed:
        """The light of all lamps together. Warns of those that light nothing."""
        relighter = self._relighter
        with relighter.stages.stage("lamps", len(relighter.scene.vertices)) as advance:
            direct = self._direct(self._emitters, advance)
        if not direct.any() and any(np.any(color > 0.0) for color in self._emitters.color):
            message = "no vertex receives light from the lamps: they are inside a wall, outside, or face away"
            warnings.warn(message, DataWarning, stacklevel=2)
        return self.with_bounces(direct)

    def of(self, lamps: Sequence[Lamp], captured: float) -> "LampLight":
        """The light of other lamps on the same scene, beside so much of its captured light; what no lamp changes is
        shared."""
        self.prepare()
        other = copy.copy(self)
        other.lamps, other._captured = list(lamps), np.float32(captured)
        other._emitters = emitters_of(other.lamps, self._frame.center, self._frame.diagonal)
        for name in ("plan", "bounce_plan", "placed"):
            vars(other).pop(name, None)
        return other

    def prepare(self) -> None:
        """Compute everything that does not depend on the lamps."""
        for name in ("_ordered", "_albedo", *(("_interreflection",) if self._bounces else ())):
            getattr(self, name)

    def direct_of(self, *lamps: int, advance: Advance = lambda count: None) -> NDArray[np.float32]:
        """Direct light of these lamps on the white scene, (V, 3) float32."""
        return self._direct(self._emitters.of_lamp(*lamps), advance)

    def glimpse(self) -> NDArray[np.float32]:
        """Direct light of all lamps by one ray to each from each vertex, (V, 3) float32: with hard shadows, at once."""
        return lamplight(self._receivers, self._emitters, 1, at=self._ordered, least=self._least)

    def without_bounces(self, direct: NDArray[np.float32]) -> Placed:
        """The light of direct irradiance, (V, 3) on white, without bounces."""
        return Placed(self._albedo * direct, direct, direct, [])

    def with_bounces(self, direct: NDArray[np.float32]) -> Placed:
        """The light of direct irradiance, (V, 3) on white, with bounces."""
        albedo = self._albedo
        if not self._bounces:
            return self.without_bounces(direct)
        matrix, seed = self._interreflection, self._relighter.options.seed
        rays = 0 if self.bounce_plan is None else self.bounce_plan.rays
        with self._relighter.stages.stage("bounces", len(albedo)) as advance:
            first = first_bounce(self._receivers, albedo * direct, rays, seed=seed, advance=advance) if rays else None
            radiance, bounces = with_bounces(direct, albedo, matrix, first=first)
        received = radiance / np.maximum(albedo, np.float32(DARKEST))
        dark = albedo < DARKEST  # the light that falls on black does not show in the light that black reflects
        received[dark] = np.maximum(received, direct)[dark]
        return Placed(radiance, received.astype(np.float32), direct, bounces)

    @property
    def _bounces(self) -> bool:
        bouncing = self._relighter.options.fixed_effects is None or "bounces" in self._relighter.effects
        return bouncing and self._look.albedo is not None  # in a scene all white light would never fade

    def _direct(self, emitters: Emitters, advance: Advance = lambda count: None) -> NDArray[np.float32]:
        known = self._receivers, emitters, self.plan.rays
        light = lamplight(*known, at=self._ordered, least=self._least, advance=advance)
        return light if self._evenness is None else self._evenness.average(light, AVERAGING_ROUNDS)

    @cached_property
    def _evenness(self) -> Evenness | None:
        """Smoothing in a closed room: scanned walls are dented, and lamps would show the noise of their normals."""
        closed = self._look.capture is not None and "room" in self._look.capture
        return Evenness(self._relighter.occluder) if closed else None

    @cached_property
    def _receivers(self) -> Occluder:
        """The occluder of the scene; in a closed room its vertices receive light by averaged normals."""
        occluder = self._relighter.occluder
        if self._evenness is None:
            return occluder
        receivers = copy.copy(occluder)
        receivers.normals = self._evenness.average_directions(occluder.normals, AVERAGING_ROUNDS)
        return receivers

    @cached_property
    def _ordered(self) -> Ordered:
        return ordered(self._receivers, leaf=self._leaf, seed=self._relighter.options.seed)

    @cached_property
    def _leaf(self) -> NDArray[np.float32] | None:
        """The leaf share of each vertex, (V,); None without leaves."""
        foliage = self._relighter.precomputed.foliage
        if foliage is None:
            return None
        leaf = np.zeros(len(self._relighter.scene.vertices), np.float32)
        leaf[foliage.rows] = foliage.share[:, 0]
        return leaf

    @cached_property
    def _albedo(self) -> NDArray[np.float32]:
        albedo, room = self._look.albedo, self._look.room
        if albedo is None:
            return np.ones_like(self._look.captured)
        if room is None or self._evenness is None:
            return np.asarray(albedo, np.float32)
        # What few rays and dents make of the captured light would be seen as blotches.
        light = np.exp(self._evenness.average(np.log(np.maximum(room.irradiance, BLACK)), ROUNDS))
        even = np.clip(self._look.captured / light, 0.0, LIGHTEST).astype(np.float32)
        return np.where(room.glow.any(axis=1, keepdims=True), room.albedo, even)

    @cached_property
    def _interreflection(self) -> "Interreflection":
        """The cached bounces that the estimate of the capture's light used."""
        return self._relighter.transport(CAPTURE).interreflection
