"""An interactive session without windows: the user's settings, and the light for them.

A new light shows at once: the transfer at hand is multiplied by the new coefficients, and bounced light is added in few
bands. Suns and bounces in full, and the error follow from the `worker` when the light rests.
"""

import math
import time
from collections.abc import Callable, Hashable
from dataclasses import fields, replace
from operator import is_
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.scene.foreign import as_scene

from ..engine.light_mix import LightBeside
from ..light.environment import turned_about_y
from ..light.tonemap import auto_exposure
from ..transfer.settings import BOUNCES, SHADOWS
from .bench import Bench
from .hand_bench import HandBench
from .history import Timeline
from .lamps import BoardState, LampBench, LampBoard
from .lighting import LightWish, SessionScene, check_albedos
from .object_bench import ObjectBench
from .part_bench import PartBench
from .quick import harmonic_light, prepare
from .request import ObjectsUnder, SessionRequest
from .splats import RelitSplats
from .state import MODES, State, check_field, choices_of, first_state, methods_of
from .worker import REST_SECONDS, Answers, ProcessWorker

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight


class Session:
    """One scene, a list of lights, and the user's settings.

    state: the present State; `change` and `reset` alter it. start: the one that `reset` returns to.
    choices: names to choose from, of "environment", "albedo", "mode" and "method". answers: the Answers of the worker.
    lamps, bench: the LampBoard and the LampBench; None in a session whose lamps cannot be changed, which
    `relight SCENE --view` opens. objects: the ObjectBench. hand: the HandBench of the captured light. parts: the
    PartBench. splats: the RelitSplats. All are None where there are none. timeline: undoes changes of all of them.
    worker, clock: as given. revision: grows with everything that may change the picture.
    """

    def __init__(
        self,
        asked: SessionRequest,
        worker: Callable[[SessionScene], ProcessWorker] = ProcessWorker,
        clock: Callable[[], float] = time.perf_counter,  # returns seconds, which decide when a moving light is at rest
    ) -> None:
        """Start the worker. Raises InputError for albedos and options that do not fit."""
        scene = self.scene = as_scene(asked.scene)
        self.clock = clock
        self.environments = choices_of(asked.environment, asked.environments_folder)
        captured = {"captured": scene.colors_linear, "white": None}
        self.albedos = check_albedos(scene, captured if asked.albedos is None else asked.albedos)
        self.choices = {"environment": list(self.environments), "albedo": list(self.albedos), "mode": list(MODES)}
        self.choices["method"] = methods_of(asked.lighting)
        self.start = self.state = first_state(asked.lighting, self.environments, self.albedos)
        self._room_lamps, self._lamps_known = dict(asked.lamps or {}), bool(asked.lamps) and asked.lamps_known
        self.timeline, self._mixture, source = Timeline(self._edited), asked.mixture, asked.lamp_source
        self.lamps: LampBoard | None = None
        self.bench: LampBench | None = None
        if source is not None:
            mix = source.mix
            start = mix.asked_lamps, mix.captured_factor
            self.lamps = LampBoard(*start, self.timeline, lambda: mix.scale, source.command)
            self.bench = LampBench(source, self.lamps, asked.mixture)
        objects, key = asked.object_source, self._key_of_objects
        self.objects = None if objects is None else ObjectBench(objects, self.timeline, key, self._light_on)
        self.hand = (
            None if asked.hand_source is None else HandBench(asked.hand_source, asked.under_kept_light, self._edited)
        )
        self.parts = None if asked.part_source is None else PartBench(asked.part_source, self.timeline)
        self.splats = None if asked.splats is None else RelitSplats(asked.splats, self)
        self._given_exposure = asked.exposure
        self._exposures: dict[tuple[str | None, str], float] = {}
        self._memory: dict[str, tuple[Any, tuple, Any]] = {}  # derived values by name
        self._moved = self._edited_at = -math.inf
        self.light_seconds: float | None = None
        self.revision = 0
        options, effects = asked.lighting, asked.lighting.chosen_effects
        options = replace(options, tolerance=None, budget_s=None)  # every wish brings its own tolerance
        working = worker(SessionScene(scene, self.environments, self.albedos, options, asked.cache))
        self.answers, self.worker = Answers(working, self._wish(effects), effects), worker
        self.answers.ask()
        prepare()
        self.change(**asked.state or {})

    def change(self, **changes: Any) -> None:
        """Set fields of the state; values outside their range are brought into it. Raises InputError for names."""
        changes = {name: check_field(name, value, self.choices) for name, value in changes.items()}
        state = replace(self.state, **changes)
        if state == self.state:
            return
        self.state, self.revision = state, self.revision + 1
        self.answers.wish = self._wish(state.effects & self.answers.available)
        if set(changes) - {"angle_deg"}:
            self.answers.message = ""
        if set(changes) <= {"angle_deg", "tolerance"}:
            self._moved = self.clock()
        else:
            self.answers.ask()

    def reset(self) -> None:
        """Reset everything."""
        self.change(**{field.name: getattr(self.start, field.name) for field in fields(State)})
        self.timeline.reset()
        if self.hand is not None:
            self.hand.reset()

    def follow(self, other: "Session") -> None:
        """Take over what the user set in another session of the same scene, but for its captured light."""
        if self.lamps is not None and other.lamps is not None:
            self.lamps.follow(other.lamps)
        self.timeline.follow(other.timeline)
        kept = {field.name: getattr(other.state, field.name) for field in fields(State)}
        self.change(**kept | {"tool": "", "split": False})

    def poll(self) -> None:
        """Collect results, without waiting, and give work to what rests. Call it often."""
        rests = not self.state.turning and self.clock() - self._moved > REST_SECONDS
        edits_rest = self.clock() - self._edited_at > REST_SECONDS
        benches: list[tuple[Bench | None, bool]] = [
            (self.bench, edits_rest),
            (self.objects, rests and edits_rest),
            (self.hand if self.uses("hand") else None, edits_rest),
            (self.splats if self.shows_splats else None, rests),
        ]
        news = self.answers.poll()
        self.revision += news + sum(bench.poll(still) for bench, still in benches if bench is not None)
        if rests:
            self.answers.ask()

    def hurry(self) -> None:
        """Ask the worker for the present light at once, as if it had rested."""
        self._moved = self._edited_at = -math.inf
        self.answers.ask()

    def finish(self, timeout: float = 600.0) -> None:
        """Wait until the worker has answered the present state. Raises InputError if it cannot."""
        deadline = time.perf_counter() + timeout
        self.hurry()
        while not self.settled:
            self.poll()
            if self.failure:
                raise InputError(self.failure)
            if time.perf_counter() > deadline:
                late = f"the light did not arrive within {timeout:g} s"
                raise InputError(f"{late}; allow more time, or a larger tolerance")
            time.sleep(0.002)

    def close(self) -> None:
        """End the worker and all threads."""
        for each in (self.answers, self.bench, self.splats, self.objects, self.hand):
            if each is not None:
                each.close()

    @property
    def name(self) -> str:
        """Name of the scene."""
        return self.scene.path.name if self.scene.path else "scene"

    def uses(self, tool: str) -> bool:
        """Whether the mouse acts on "lamps", "objects", "hand" or "parts"."""
        return self.state.tool == tool and getattr(self, tool) is not None

    def _wish(self, on: frozenset[str]) -> LightWish:
        """What the present state needs from the worker, with these effects: sun and bounces only with shadows."""
        s, effects = self.state, on if SHADOWS in on else frozenset()
        return LightWish(s.environment, s.angle_deg, s.tolerance, effects, s.albedo, s.method)

    @property
    def effects(self) -> frozenset[str]:
        """The effects that take part."""
        return self.answers.wish.effects

    @property
    def _answered(self) -> bool:
        """Whether the worker has answered the present state, and lamps are lit."""
        return self.answers.complete and (self.bench is None or self.bench.settled)

    @property
    def settled(self) -> bool:
        """Whether the light of the present state is there in full, and nothing newer has come in since."""
        return self._answered and self.objects_settled

    @property
    def objects_settled(self) -> bool:
        """Whether the light of inserted objects is complete; it is computed under the first albedo only."""
        return self.objects is None or not self._in_first_albedo or self.objects.settled

    @property
    def complete(self) -> bool:
        """Whether suns, bounces and shadows are all in what `radiance` returns."""
        return self.answers.lit is not None and (self.bench is None or self.bench.settled)

    @property
    def waiting_for(self) -> str:
        """What is still missing in the picture, in words; "" when it is complete."""
        if self.complete or self.answers.light is None:
            return ""
        return "the light" if self.answers.lit is None else "the light of the lamps"

    @property
    def failure(self) -> str:
        """Why the light of the present state cannot be computed, or ""."""
        return self.answers.failure or next((each.failure for each in self._benches if each.failure), "")

    @property
    def notice(self) -> str:
        """The message on lamps and objects, or ""."""
        return "".join(each.message for each in self._benches)

    @property
    def _benches(self) -> "list[LampBench | ObjectBench]":
        return [each for each in (self.bench, self.objects) if each is not None]

    @property
    def inserted(self) -> "InsertedLight | None":
        """The inserted objects in their newest light; None without objects, or before the first light."""
        return None if self.objects is None or self.objects.shown is None else self.objects.shown.result

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
        answers, wish, factor = self.answers, self.answers.wish, self.state.lamps
        lit = answers.lit
        if lit is not None:
            return self.remembered("lit", (wish.albedo, factor), lambda: self.beside_lamps(lit.radiance), lit)
        if answers.light is None:
            return None
        newest = [answers.newest(kind) for kind in ("light", "transfer", "bounced")]
        key = wish.angle_deg, wish.effects, wish.albedo, factor
        return self.remembered("quick", key, self.quick_radiance, *newest)

    def exposure(self) -> float:
        """Display value per unit of radiance. The automatic one is that of the starting angle, so that the
        brightness of the picture is steady while the light turns."""
        if self._given_exposure is None:
            key = self.answers.light_name, self.state.albedo
            if key not in self._exposures:
                angle = self.state.angle_deg if not self._exposures else self.start.angle_deg
                self._exposures[key] = auto_exposure(self.quick_radiance(angle))
        base = self._given_exposure if self._given_exposure is not None else self._exposures[key]
        return base * 2.0**self.state.exposure_ev

    def sky_exposure(self) -> float:
        """Display value per unit of radiance of the light itself, seen behind the scene."""
        return self.exposure() * (1.0 if self.mixture is None else self.mixture.backdrop)

    def quick_radiance(self, angle_deg: float | None = None) -> NDArray:
        """Radiance (V, 3) by spherical harmonics alone at an angle, by default the present one."""
        began = time.perf_counter()
        answers = self.answers
        transfer = answers.newest("transfer")[1] if SHADOWS in self.effects else None
        if transfer is None:
            transfer = answers.newest("unshadowed")[1]
        assert answers.light is not None  # before the first there is no transfer either
        turned = turned_about_y(answers.light.coefficients, self.state.angle_deg if angle_deg is None else angle_deg)
        bounced = answers.bounced if BOUNCES in self.effects else None
        radiance = harmonic_light(transfer, turned, self.albedos[self.state.albedo], bounced)
        self.light_seconds = time.perf_counter() - began
        return self.beside_lamps(radiance)

    def beside_lamps(self, radiance: NDArray) -> NDArray:
        """Radiance (V, 3) including the lamps of a room."""
        lamps = self._room_lamps.get(self.state.albedo)
        return radiance if lamps is None else radiance + np.float32(self.state.lamps) * lamps

    @property
    def shows_splats(self) -> bool:
        """Whether the picture shows splats. Without splats, and in all modes but the relit one, it shows the mesh."""
        splats, state = self.splats, self.state
        relit = state.mode == "relit" and state.tool not in ("hand", "parts")
        return splats is not None and relit and not state.mesh and state.albedo in splats.source.looks

    def remembered(self, name: str, key: Any, compute: Callable[[], Any], *made_of: Any) -> Any:
        """The result of `compute()`, kept under this name until the key or the objects differ.

        It keeps the objects too, since a new object may get the address of a deleted one.
        """
        kept = self._memory.get(name)
        if kept is None or kept[0] != key or not all(map(is_, kept[1], made_of)):
            kept = self._memory[name] = key, made_of, compute()
        return kept[2]

    @property
    def _in_first_albedo(self) -> bool:
        return self.state.albedo == self.choices["albedo"][0]

    def _key_of_objects(self) -> Hashable:
        """The dependencies of the light on objects, besides their poses."""
        lamps = None if self.lamps is None else self.lamps.state
        return self.state.environment, self.state.angle_deg, self.state.lamps, self.effects, lamps

    def _light_on(self) -> ObjectsUnder | None:
        """The present light on objects; None before the worker has answered, and under other albedos."""
        mixture, alone, plain = self.mixture, self.environment_radiance(), self.plain_radiance()
        if alone is None or plain is None or self.objects is None or not (self._answered and self._in_first_albedo):
            return None
        look, exposure = self.objects.source.received, self.exposure()
        received = np.asarray((look if mixture is None else mixture.receives(look))(alone, exposure), np.float32)
        environment, angle = self.environments[self.state.environment], self.state.angle_deg
        if mixture is None:
            return ObjectsUnder(environment, angle, 1.0, 0.0, (), exposure, plain, received)
        beside = BoardState((), 0.0) if self.lamps is None else self.lamps.state
        lamps, captured = tuple(lamp.asked for lamp in beside.lamps), beside.captured
        return ObjectsUnder(environment, angle, mixture.env_scale, captured, lamps, mixture.level, plain, received)

    def _edited(self) -> None:
        """The work after a change of lamps, objects, a part or the captured light."""
        self.revision += 1
        self.answers.message, self._edited_at = "", self.clock()
