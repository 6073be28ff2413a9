"""An interactive session without windows: the user's settings, and the light for them.

A new light shows at once: the transfer that the window holds is multiplied by the new coefficients, and bounced light
is added in few bands. Suns and bounces in full, errors and references follow from the worker
(`worker`) when the light has not moved for `REST_SECONDS`.
"""

import math
import time
from collections.abc import Callable, Hashable
from dataclasses import fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Triple
from splat2mesh.base.errors import InputError
from splat2mesh.scene.foreign import as_scene

from ..engine.light_mix import LightBeside
from ..light.environment import turned_about_y
from ..light.tonemap import auto_exposure
from ..transfer.settings import BOUNCES, SHADOWS
from .answers import Answers, LightWorker
from .editing import LampEditing
from .hand_bench import HandBench
from .lighting import LightWish, check_albedos
from .modes import MODES
from .object_bench import ObjectBench
from .object_light import light_key, light_now
from .quick import display_bytes, harmonic_light, prepare
from .request import SessionRequest
from .splats import RelitSplats
from .state import RANGES, State, check_field, choices_of
from .worker import ProcessWorker

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight

REST_SECONDS = 0.15
"""Seconds without motion before a request for a new angle: long enough for the user to have stopped."""

TURN_DEG_PER_SECOND = 36.0

START_TOLERANCE = 0.02
"""Default."""


class Session(LampEditing, Answers):
    """One scene, a list of lights, and the user's settings.

    state: the present State; `change` and `reset` alter it. start: the one that `reset` returns to.
    choices: names to choose from, of "environment", "albedo" and "mode". progress: (label, fraction or None) of the
    work under way, or None. message: the text to show, or "".
    revision: grows with everything that may change the picture.
    """

    def __init__(
        self,
        asked: SessionRequest,
        worker: Callable[..., LightWorker] = ProcessWorker,
        clock: Callable[[], float] = time.perf_counter,  # returns seconds, which decide when a moving light is at rest
    ) -> None:
        """Start the worker. Raises InputError for albedos and options that do not fit."""
        options = asked.lighting
        tolerance = START_TOLERANCE if options.tolerance is None else options.tolerance
        scene = self.scene = as_scene(asked.scene)
        self.clock = clock
        self.environments = choices_of(asked.environment, asked.environments_folder)
        captured = {"captured": scene.colors_linear, "white": None}
        self.albedos = check_albedos(scene, captured if asked.albedos is None else asked.albedos)
        self.lamps, self._lamps_known = dict(asked.lamps or {}), bool(asked.lamps) and asked.lamps_known
        LampEditing.__init__(self, asked.lamp_source, asked.mixture)
        self.objects = None if asked.object_source is None else ObjectBench(asked.object_source, self.timeline)
        self.hand = None if asked.hand_source is None else HandBench(asked.hand_source)
        self.splats = None if asked.splats is None else RelitSplats(asked.splats)
        self.choices = {"environment": list(self.environments), "albedo": list(self.albedos), "mode": list(MODES)}
        self.available = options.chosen_effects
        if not RANGES["tolerance"][0] <= tolerance <= RANGES["tolerance"][1]:
            low, high = RANGES["tolerance"]
            raise InputError(f"the `tolerance` of a session must be from {low:g} to {high:g}, found {tolerance:g}")
        first, albedo = next(iter(self.environments)), next(iter(self.albedos))
        angle = getattr(self.environments[first], "rotation_deg", 0.0)
        self.start = State(first, albedo, angle_deg=angle, tolerance=tolerance, effects=frozenset(self.available))
        self.state, self.revision = self.start, 0
        self._given_exposure = asked.exposure
        self._exposures: dict[tuple[str | None, str], float] = {}
        self._memory: dict[str, tuple[Any, tuple, Any]] = {}  # derived values by name
        self._moved = self._lamps_moved = self._objects_moved = self._hand_moved = -math.inf
        self.light_seconds: float | None = None
        options = replace(options, tolerance=None, budget_s=None)  # every wish brings its own tolerance
        Answers.__init__(self, worker(scene, self.environments, self.albedos, options, asked.cache))
        self._ask()
        prepare()
        self.change(**asked.state or {})

    def change(self, **changes: Any) -> None:
        """Set fields of the state; values outside their range are brought into it. Raises InputError for names."""
        changes = {name: check_field(name, value, self.choices) for name, value in changes.items()}
        state = replace(self.state, **changes)
        if state == self.state:
            return
        self.state = state
        self.revision += 1
        if set(changes) - {"angle_deg"}:
            self.message = ""
        if set(changes) <= {"angle_deg", "tolerance"}:
            self._moved = self.clock()
        else:
            self._ask()

    def reset(self) -> None:
        """Reset everything."""
        self.change(**{field.name: getattr(self.start, field.name) for field in fields(State)})
        with self.timeline.together():
            if self.board is not None:
                self.reset_lamps()
            if self.objects is not None:
                self.objects.reset()
                self._edited()
        if self.hand is not None:
            self.set_hand(HandBench.reset)

    def set_hand(self, change: Callable[[HandBench], None]) -> None:
        """Change the captured light that a hand sets; nothing in a session without. Raises what the change raises."""
        if self.hand is not None:
            change(self.hand)
            self.revision, self._hand_moved = self.revision + 1, self.clock()

    def poll(self) -> None:
        """Collect the worker's results, without waiting. Call it often."""
        for kind, *rest in self._worker.poll():
            getattr(self, f"_take_{kind}")(*rest)
            self.revision += kind != "progress"
        if self.splats is not None and self.splats.poll():
            self.revision += 1
        if self.bench is not None and self.bench.poll(self.clock() - self._lamps_moved > REST_SECONDS):
            self.revision += 1
        if self.objects is not None:
            under = partial(light_now, self, self.objects) if self.answered and self._in_first_albedo else None
            self.revision += self.objects.poll(under, light_key(self), self._rests)
        if self.hand is not None and self.state.by_hand:
            self.revision += self.hand.poll(self.clock() - self._hand_moved > REST_SECONDS)
        if not self.state.turning and self.clock() - self._moved > REST_SECONDS:
            self._ask()

    def hurry(self) -> None:
        """Ask the worker for the present light at once, as if it had rested."""
        self._moved = self._lamps_moved = self._objects_moved = -math.inf
        self._ask()

    def finish(self, timeout: float = 600.0) -> None:
        """Wait until the worker has answered the present state. Raises InputError if it cannot."""
        deadline = time.perf_counter() + timeout
        self.hurry()
        while not self.settled:
            self.poll()
            if self.failure:
                raise InputError(self.failure)
            if time.perf_counter() > deadline:
                raise InputError(
                    f"the light did not arrive within {timeout:g} s; allow more time, or a larger tolerance"
                )
            time.sleep(0.002)

    def close(self) -> None:
        """End the worker."""
        self._worker.close()
        if self.bench is not None:
            self.bench.close()
        if self.splats is not None:
            self.splats.close()
        if self.objects is not None:
            self.objects.close()
        if self.hand is not None:
            self.hand.close()

    def move_object(
        self, number: int, at: Triple, turn_deg: float | None = None, lifted: bool = False, merge: Hashable = None
    ) -> None:
        """Put an object, counted from 0, at a position in the frame of the splat, turned about the vertical.

        lifted: off the floor. merge: moves in a row that share it are undone as one. Raises InputError for numbers that
        are none, and in a session without objects."""
        if self.objects is None:
            raise InputError("no object to move: open the session with --insert FILE")
        self.objects.put(number, at, turn_deg, lifted, merge)
        self.revision, self._objects_moved = self.revision + 1, self.clock()

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.path.name if self.scene.path else "scene"

    @property
    def wish(self) -> LightWish:
        """The wish of the present state to the worker."""
        s = self.state
        return LightWish(s.environment, s.angle_deg, s.tolerance, self.effects, s.albedo, MODES[s.mode].reference)

    @property
    def effects(self) -> frozenset[str]:
        """The active effects: those switched on; sun and bounces only with shadows."""
        on = self.state.effects & self.available
        return on if SHADOWS in on else frozenset()

    @property
    def lamps_settled(self) -> bool:
        """Whether the light of added lamps is complete."""
        return self.bench is None or self.bench.settled

    @property
    def lamps_failure(self) -> str:
        """Why it cannot be computed, or ""."""
        return "" if self.bench is None else self.bench.failure

    @property
    def objects_settled(self) -> bool:
        """Whether the light of inserted objects is complete; it is computed under the first albedo only."""
        return self.objects is None or not self._in_first_albedo or self.objects.settled

    @property
    def objects_failure(self) -> str:
        """Why it cannot be computed, or ""."""
        return "" if self.objects is None else self.objects.failure

    @property
    def notice(self) -> str:
        """The message on lamps and objects, or ""."""
        return "".join([each.message for each in (self.bench, self.objects) if each is not None][:2])

    @property
    def inserted(self) -> "InsertedLight | None":
        """The inserted objects in their newest light; None without objects, or before the first light."""
        shown = None if self.objects is None else self.objects.shown
        return None if shown is None else shown.light

    @property
    def has_lamps(self) -> bool:
        """Whether captured lamps can be switched and dimmed."""
        mixture = self.mixture
        return self._lamps_known and (mixture is None or mixture.env_scale > 0.0)

    @property
    def mixture(self) -> LightBeside | None:
        """The present light beside the environment, or None. Lamps are known for the first albedo only."""
        if self.bench is None:
            return self._mixture
        return self.bench.mixture() if self.state.albedo == self.choices["albedo"][0] else None

    def radiance(self) -> NDArray | None:
        """Exit radiance of the vertices under the present light, (V, 3) float32 linear; None before the first light."""
        plain, inserted = self.plain_radiance(), self.inserted
        if plain is None or inserted is None:
            return plain
        return self.remembered("with objects", None, lambda: plain * inserted.ratio, plain, inserted)

    def plain_radiance(self) -> NDArray | None:
        """The same without the effect of objects."""
        alone, mixture = self.environment_radiance(), self.mixture
        if alone is None or mixture is None:
            return alone
        return self.remembered("mixed", None, lambda: mixture.with_environment(alone), alone, mixture)

    def environment_radiance(self) -> NDArray | None:
        """The same without a mixture.

        With all effects once they are there, before that by spherical harmonics alone.
        """
        lit = self._lit()
        if lit is not None:
            return self.remembered(
                "lit", (self.wish.albedo, self.state.lamps), lambda: self.beside_lamps(lit.radiance), lit
            )
        if self.light is None:
            return None
        wish, newest = self.wish, [self._found.get(kind) for kind in ("light", "transfer", "bounced")]
        key = wish.angle_deg, wish.effects, wish.albedo, self.state.lamps
        return self.remembered("quick", key, self.quick_radiance, *newest)

    def exposure(self) -> float:
        """Display value per unit of radiance. The automatic one is that of the starting angle, so that the
        brightness of the picture is steady while the light turns."""
        if self._given_exposure is None:
            key = self.light_name, self.state.albedo
            if key not in self._exposures:
                angle = self.state.angle_deg if not self._exposures else self.start.angle_deg
                self._exposures[key] = auto_exposure(self.quick_radiance(angle))
        base = self._given_exposure if self._given_exposure is not None else self._exposures[key]
        return base * 2.0**self.state.exposure_ev

    def sky_exposure(self) -> float:
        """Display value per unit of radiance of the light itself, seen behind the scene."""
        return self.exposure() * (1.0 if self.mixture is None else self.mixture.backdrop)

    def colors(self) -> NDArray:
        """The colours of the surface in the present mode: (V, 3) uint8 sRGB."""
        mode = MODES[self.state.mode]
        if self.hand is not None and self.state.by_hand:
            return self.hand.colors(lambda: self.scene.colors_srgb)
        if mode.lights:
            return mode.colors(self)
        return self.remembered("colors", (self.state.mode, self.state.albedo), lambda: mode.colors(self))

    def shown_bytes(self) -> NDArray:
        """sRGB bytes (V, 3) of the relit scene: the captured colours before the first light."""
        radiance = self.radiance()
        return self.scene.colors_srgb if radiance is None else display_bytes(radiance, self.exposure())

    def quick_radiance(self, angle_deg: float | None = None) -> NDArray:
        """Radiance (V, 3) by spherical harmonics alone at an angle, by default the present one."""
        began = time.perf_counter()
        shadowed = SHADOWS in self.effects and "transfer" in self._found
        transfer = self._found["transfer" if shadowed else "unshadowed"][1]
        assert self.light is not None  # before the first there is no transfer either
        turned = turned_about_y(self.light.coefficients, self.state.angle_deg if angle_deg is None else angle_deg)
        bounced = self._bounced() if BOUNCES in self.effects else None
        radiance = harmonic_light(transfer, turned, self.albedos[self.state.albedo], bounced)
        self.light_seconds = time.perf_counter() - began
        return self.beside_lamps(radiance)

    def beside_lamps(self, radiance: NDArray) -> NDArray:
        """Radiance (V, 3) including the lamps of a room."""
        lamps = self.lamps.get(self.state.albedo)
        return radiance if lamps is None else radiance + np.float32(self.state.lamps) * lamps

    def with_all_parts(self, radiance: NDArray) -> NDArray:
        """Radiance (V, 3) of an environment, all lamps and the captured light."""
        found = self.beside_lamps(radiance)
        found = found if self.mixture is None else self.mixture.with_environment(found)
        return found if self.inserted is None else found * self.inserted.ratio

    @property
    def shows_splats(self) -> bool:
        """Whether the picture shows splats. Without splats, and in all modes but the relit one, it shows the mesh."""
        splats, state = self.splats, self.state
        relit = state.mode == "relit" and not state.by_hand
        return splats is not None and relit and not state.mesh and state.albedo in splats.source.looks

    def remembered(self, name: str, key: Any, compute: Callable[[], Any], *made_of: Any) -> Any:
        """The result of `compute()`, kept under this name until the key or the objects differ.

        It keeps the objects too, since a new object may get the address of a deleted one.
        """
        kept = self._memory.get(name)
        if kept is None or kept[0] != key or not _same(kept[1], made_of):
            kept = self._memory[name] = key, made_of, compute()
        return kept[2]

    @property
    def _in_first_albedo(self) -> bool:
        return self.state.albedo == self.choices["albedo"][0]

    @property
    def _rests(self) -> bool:
        moved = max(self._moved, self._lamps_moved, self._objects_moved)
        return not self.state.turning and self.clock() - moved > REST_SECONDS

    def _edited(self) -> None:
        self.revision += 1
        self.message, self._lamps_moved = "", self.clock()


def _same(some: tuple, others: tuple) -> bool:
    return len(some) == len(others) and all(one is other for one, other in zip(some, others, strict=True))
