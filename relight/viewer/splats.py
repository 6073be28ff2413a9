"""The relit splats of a session: at once without the fit in views, exact when the light rests.

A thread binds splats to their mesh and fits them to its light, since both take longer than a frame.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

from ..light.environment import Environment, turned_about_y
from .mixture import SessionMixture

if TYPE_CHECKING:
    from ..insert.inserts import InsertedLight
    from ..lamps.asked import AskedLamp
    from ..splats import Binding
    from .session_view import SessionView

LEAST_LIGHT = 1e-6
"""Mean luminance of an environment below which its sky is black."""

WAITING = "binding the splats to the mesh"
"""Text of the panel until then, while the captured splats show."""


class Shining(NamedTuple):
    """Light that glossy splats mirror in a session. light: (K, 3) SH coefficients of the environment, display units.
    radiance: (V, 3) that vertices send out, received: (V, 3) irradiance, display units once times exposure. unit:
    display units per unit of the picture, of lamps and captured light. captured: factor on it. lamps: placed ones."""

    light: NDArray[np.float64]
    radiance: NDArray[np.float32]
    received: NDArray[np.floating]
    exposure: float
    unit: float = 1.0
    captured: float = 0.0
    lamps: "Sequence[AskedLamp]" = ()


ShineUnder: TypeAlias = Callable[[Splats, Shining], Splats]
"""Type of `SplatLook.gloss`."""


class SplatLook(NamedTuple):
    """How splats take the light under one albedo. before: (V, 3) captured irradiance, unit of the
    captured colours. received: returns the irradiance (V, 3) of a radiance (V, 3) and an exposure. gloss: takes relit
    splats and the Shining of a light, and returns the splats with its reflections; None without."""

    before: NDArray[np.float32]
    received: Callable[[NDArray[np.float32], float], NDArray[np.floating]]
    gloss: ShineUnder | None = None


def beside(alone: Shining, mixture: SessionMixture, lamps: "Sequence[AskedLamp]") -> Shining:
    """The Shining of an environment beside the captured light and lamps of a mixture."""
    return alone._replace(
        light=mixture.env_scale * alone.light,
        radiance=mixture.with_environment(alone.radiance),
        unit=alone.exposure / mixture.level,
        captured=mixture.captured,
        lamps=lamps,
    )


class SplatSource(NamedTuple):
    """The splats of a scene, and the functions that relight them.

    captured: Splats, in their own frame. binding: returns their Binding. looks: name of an albedo -> SplatLook; under
    others the mesh shows. sky: returns the rows (M,) of splats that show the sky. sky_level: mean luminance at which
    they show it, in captured units, or None for the session's exposure.
    """

    captured: Splats
    binding: Callable[[], "Binding"]
    looks: Mapping[str, SplatLook]
    sky: Callable[[], NDArray[np.int64]] = lambda: np.zeros(0, np.int64)
    sky_level: float | None = None


class _Wanted(NamedTuple):
    """The dependencies of a picture of the splats."""

    radiance: NDArray[np.float32]
    exposure: float
    albedo: str
    sky: tuple | None  # name, angle and whether it is shown; None where no splat shows it
    mixture: SessionMixture | None
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
        self._bound: Future = self._thread.submit(lambda: (source.binding(), source.sky()))
        self._bound_reported = False
        self._pending: tuple[_Wanted, Future] | None = None
        self._exact: tuple[_Wanted, Splats] | None = None
        self._quick: tuple[_Wanted, Splats] | None = None
        self._plain: tuple[_Wanted, Splats] | None = None  # the quick one without objects

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

    def shown(self, session: "SessionView", rests: bool, wait: bool = False) -> Splats:
        """The Splats under the present light of a session, in order, in their own frame.

        rests: whether the light rests, so that a fit is worthwhile. wait: until they are bound and fitted.
        """
        if wait:
            self._bound.exception()
            self.poll()
        radiance, mixture = session.environment_radiance(), session.mixture
        if radiance is None or not self._bound.done() or self._bound.exception() is not None:
            return self.source.captured
        binding, rows = self._bound.result()
        state, light = session.state, session.light
        sky = (session.light_name, state.angle_deg, state.sky) if len(rows) else None
        wanted = _Wanted(radiance, session.exposure(), state.albedo, sky, mixture, session.inserted)
        if self._exact is not None and wanted.same(self._exact[0]):
            return self._exact[1]

        source, sky_exposure = self.source, session.sky_exposure()
        lamps = () if session.board is None else [lamp.asked for lamp in session.board.state.lamps]

        def relit(rounds: int | None) -> Splats:
            look = self.source.looks[wanted.albedo]
            received = look.received if mixture is None else mixture.receives(look.received)
            after = received(wanted.radiance, wanted.exposure)
            more = {} if rounds is None else {"rounds": rounds}
            inserted, objects = wanted.inserted, session.objects
            found = binding.relit(look.before, after, wanted.exposure, **more)
            if look.gloss is not None and rounds is None and light is not None:
                shining = turned_about_y(light.coefficients, state.angle_deg) * wanted.exposure
                mirrored = Shining(shining, wanted.radiance, after, wanted.exposure)
                found = look.gloss(found, mirrored if mixture is None else beside(mirrored, mixture, lamps))
            if inserted is not None and rounds is None and objects is not None:
                found = objects.source.shadowed(inserted, found, wanted.exposure)
            if mixture is not None and mixture.keeps_sky:
                from ..splats.sky import dimmed

                return dimmed(found, source.captured, session.scene.background_splats, sky_exposure)
            if sky is None or light is None:
                return found
            return _under(
                found, rows, light.sky, wanted._replace(exposure=sky_exposure), session.scene, self.source.sky_level
            )

        try:
            if wait:
                self._exact = wanted, relit(None)
                return self._exact[1]
            if rests and session.objects_settled and self._pending is None:
                self._pending = wanted, self._thread.submit(relit, None)
            if self._quick is None or not wanted.same(self._quick[0]):
                plain = wanted._replace(inserted=None)
                if self._plain is None or not plain.same(self._plain[0]):
                    self._plain = plain, relit(0)
                inserted = wanted.inserted
                # At the vertices, without edges: while objects move, only the splats that they change get new colours.
                found = self._plain[1] if inserted is None else binding.shaded(self._plain[1], inserted.ratio)
                self._quick = wanted, found
        except InputError as error:
            self.failure = f"the splats stay as captured: {error}"
            return self.source.captured
        return self._quick[1]

    def close(self) -> None:
        """Stop all requests."""
        self._thread.shutdown(wait=False, cancel_futures=True)


def _under(
    splats: Splats,
    rows: NDArray[np.int64],
    sky: NDArray[np.float32],
    wanted: _Wanted,
    scene: Scene,
    level: float | None,
) -> Splats:
    """The Splats with the new sky on sky splats, or without them if no sky shows."""
    from ..splats import under_sky

    assert wanted.sky is not None
    name, angle_deg, shown = wanted.sky
    environment = Environment(sky, name).rotated(angle_deg)
    exposure = wanted.exposure * (1.0 if level is None else level / max(environment.mean_luminance, LEAST_LIGHT))
    return under_sky(splats, rows, environment, scene.scene_from_splat, exposure, "new" if shown else "drop")
