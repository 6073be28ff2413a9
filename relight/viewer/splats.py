"""The relit splats of a session: at once without the fit in views, exact when the light rests.

A thread binds splats to their mesh and fits them to its light, since both take longer than a frame.
"""

from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.splats.splats import Splats

from ..engine.light_mix import LightBeside, Received
from ..gloss.scene_gloss import NewLight
from ..light.environment import Environment, turned_about_y
from ..light.loading import CapturedLight
from ..output.relit_splats import BoundSplats, SplatLight, relit
from ..splats.binding import ROUNDS
from ..splats.sky import FarSplats

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight
    from ..splats import Binding

WAITING = "binding the splats to the mesh"
"""Text of the panel until then, while the captured splats show."""


class SplatLook(NamedTuple):
    """How splats take the light under one albedo. before: (V, 3) captured irradiance, unit of the
    captured colours. received: returns the irradiance (V, 3) of a radiance (V, 3) and an exposure. gloss: as of
    BoundSplats."""

    before: NDArray[np.float32]
    received: Received
    gloss: Callable[[Splats, NewLight], Splats] | None = None


def beside(alone: NewLight, mixture: LightBeside, lamps: Any) -> NewLight:
    """The NewLight of an environment beside the captured light and lamps, a LampLight or None, of a mixture."""
    return alone._replace(
        light=mixture.env_scale * alone.light,
        radiance=mixture.with_environment(alone.radiance),
        unit=alone.exposure / mixture.level,
        captured=mixture.captured,
        lamps=lamps,
    )


def _no_sky(source: Splats) -> FarSplats:
    nothing = np.zeros(0, np.int64)
    return FarSplats(source, nothing, nothing, np.eye(4))


class SplatSource(NamedTuple):
    """The splats of a scene, and the functions that relight them.

    captured: Splats, in their own frame. binding: returns their Binding. looks: name of an albedo -> SplatLook; under
    others the mesh shows. far: returns the FarSplats of the captured ones. sky_level: mean luminance at which
    they show it, in captured units, or None for the session's exposure.
    """

    captured: Splats
    binding: Callable[[], "Binding"]
    looks: Mapping[str, SplatLook]
    far: Callable[[Splats], FarSplats] = _no_sky
    sky_level: float | None = None


class _Wanted(NamedTuple):
    """The dependencies of a picture of the splats."""

    radiance: NDArray[np.float32]
    exposure: float
    albedo: str
    sky: tuple[str | None, float, bool] | None  # name, angle and whether it is shown; None where no splat shows it
    mixture: LightBeside | None
    inserted: "InsertedLight | None" = None

    def same(self, other: "_Wanted | None") -> bool:
        if other is None or self.mixture is not other.mixture or self.inserted is not other.inserted:
            return False
        return self.radiance is other.radiance and self[1:4] == other[1:4]


class RelitSplats:
    """The splats of a SplatSource in the light of a Session.

    source: the SplatSource. failure: why they cannot be relit, or "".
    """

    def __init__(self, source: SplatSource) -> None:
        self.source, self.failure = source, ""
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="splats")
        self._bound: Future = self._thread.submit(lambda: (source.binding(), source.far(source.captured)))
        self._bound_reported = False
        self._pending: tuple[_Wanted, Future] | None = None
        self._exact: tuple[_Wanted, Splats] | None = None

    @property
    def waiting(self) -> bool:
        """Whether they are still being bound."""
        return not self._bound.done()

    def poll(self) -> bool:
        """Collect finished work without waiting; return whether that changes the picture."""
        changed = False
        if not self._bound_reported and self._bound.done():
            self._bound_reported = changed = True
            error = self._bound.exception()
            self.failure = "" if error is None else f"the splats stay as captured: {error}"
        if self._pending is not None and self._pending[1].done():
            wanted, done = self._pending
            self._pending = None
            if done.exception() is None:
                self._exact, changed = (wanted, done.result()), True
            else:
                self.failure = f"the splats stay without their fit: {done.exception()}"
        return changed

    def shown(self, session: Any, rests: bool, wait: bool = False) -> Splats:
        """The Splats under the present light of a session, in order, in their own frame.

        rests: whether the light rests, so that a fit is worthwhile. wait: until they are bound and fitted.
        """
        if wait:
            self._bound.exception()
            self.poll()
        radiance, mixture = session.environment_radiance(), session.mixture
        if radiance is None or not self._bound.done() or self._bound.exception() is not None:
            return self.source.captured
        binding, far = self._bound.result()
        state = session.state
        sky = (session.answers.light_name, state.angle_deg, state.sky) if len(far.rows) else None
        inserted = session.inserted
        wanted = _Wanted(radiance, session.exposure(), state.albedo, sky, mixture, inserted)
        if self._exact is not None and wanted.same(self._exact[0]):
            return self._exact[1]

        relit_now = self._relighting(session, wanted, binding, far)
        try:
            if wait:
                self._exact = wanted, relit_now()
                return self._exact[1]
            if rests and session.objects_settled and self._pending is None:
                self._pending = wanted, self._thread.submit(relit_now)
            plain: Splats = session.remembered("splats", wanted[1:4], lambda: relit_now(0), radiance, mixture)
            if inserted is None:
                return plain
            # At the vertices, without edges: while objects move, only the splats that they change get new colours.
            found: Splats = session.remembered(
                "splats with objects", None, lambda: binding.shaded(plain, inserted.ratio), plain, inserted
            )
            return found
        except InputError as error:
            self.failure = f"the splats stay as captured: {error}"
            return self.source.captured

    def _relighting(self, session: Any, wanted: _Wanted, binding: "Binding", far: FarSplats) -> Callable[..., Splats]:
        """The function that relights the splats as a session wants them now: all, or with 0 rounds what is quick."""
        look, state, mixture = self.source.looks[wanted.albedo], session.state, wanted.mixture
        light = session.answers.light
        mirrored = _mirrored(session, wanted, look.gloss is not None)
        own_sky = mixture is not None and mixture.keeps_sky
        sky_exposure, exposure = session.sky_exposure(), wanted.exposure
        receives = look.received if mixture is None else mixture.receives(look.received)
        bound = BoundSplats(binding, look.before, far, look.gloss)
        if not (state.sky or own_sky):
            bound = bound._replace(far=far._replace(choice="drop"))

        def relit_now(rounds: int = ROUNDS) -> Splats:
            under = SplatLight(receives(wanted.radiance, exposure), exposure)
            if own_sky:
                under = under._replace(sky=CapturedLight(), sky_factor=sky_exposure)
            elif wanted.sky is not None and light is not None:
                sky = Environment(light.sky, wanted.sky[0] or "").rotated(wanted.sky[1])
                under = self._under_sky(under, sky, sky_exposure)
            if rounds:
                under = under._replace(mirrored=mirrored(under.received), inserted=wanted.inserted)
            return relit(bound, under, rounds)

        return relit_now

    def _under_sky(self, light: SplatLight, sky: Environment, exposure: float) -> SplatLight:
        """The light with an environment, turned, in the sky."""
        level = self.source.sky_level
        factor = 1.0 if level is None else level / (sky.mean_luminance or 1.0)
        return light._replace(sky=sky, sky_factor=exposure * factor)

    def close(self) -> None:
        """Stop all requests."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _mirrored(session: Any, wanted: _Wanted, glossy: bool) -> Callable[[NDArray[np.floating]], NewLight | None]:
    """The function for what glossy splats mirror of the present light of a session, whose vertices receive so much."""
    state, light, mixture = session.state, session.answers.light, wanted.mixture
    board, bench = session.lamps, session.bench
    lamps = [] if board is None else [lamp.asked for lamp in board.state.lamps]

    def mirrored(received: NDArray[np.floating]) -> NewLight | None:
        if not glossy or light is None:
            return None
        shining = turned_about_y(light.coefficients, state.angle_deg) * wanted.exposure
        alone = NewLight(shining, wanted.radiance, received, wanted.exposure)
        if mixture is None:
            return alone
        traced = bench.source.light_of(lamps, mixture.captured) if bench is not None and lamps else None
        return beside(alone, mixture, traced)

    return mirrored
