"""A job as a session shows it."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError

from ..albedo.division import DARKEST
from ..engine.appearance import CHOICES
from ..engine.by_hand import LightByHand, can_be_set
from ..engine.light_mix import LightBeside
from ..engine.placed import Placed
from ..lamps.asked import WHITE, AskedLamp
from ..lamps.shapes import SphereLamp
from ..output.inserted_picture import PictureAsked, with_objects
from ..request import RelightRequest
from ..splats.grown_part import GrowingSurface
from ..splats.sky import far_splats
from ..viewer.request import LampSource, ObjectSource, ObjectsUnder, PartSource, SessionRequest
from ..viewer.splats import SplatLook, SplatSource
from .job import Job
from .object_surroundings import surroundings_in

if TYPE_CHECKING:
    from splat2mesh.splats.splats import Splats

    from ..insert.asked import AskedInsert
    from ..insert.inserts import InsertedLight
    from ..splats import Binding


def check_session(request: RelightRequest) -> None:
    """Raise InputError for a request that no session shows."""
    if len(request.angles_deg) > 1:
        raise InputError("`angles_deg`: a session has one angle")
    for name in ("only", "keep", "parts"):
        if getattr(request, name):
            raise InputError(f"`{name}`: a session shows the whole scene in its lights; leave it out")


def session_of(job: Job) -> SessionRequest:
    """Return what `viewer.view` shows of a job: its albedo first, and the lights beside its own."""
    source = _lamp_source(job)
    request = _under_light(job, _first_mixture(job, source) if job.light_kind.adds else None)
    relighter, splats = job.known.relighter, job.inputs.splats
    settable = can_be_set(job.known.appearance, relighter)
    estimated = settable and job.request.capture_env is None
    return replace(
        request,
        cache=relighter.cache,
        splats=None if splats is None else _splats(job, splats[0], request.mixture),
        lamp_source=source,
        object_source=_object_source(job) if job.inputs.asked_inserts else None,
        part_source=_part_source(job),
        hand_source=partial(LightByHand, relighter, job.known.appearance) if settable else None,
        under_kept_light=(lambda: session_of(job.under_kept_light())) if estimated else None,
    )


def _chosen(job: Job) -> str:
    """The name of a job's albedo in its session."""
    name = job.inputs.choice_name
    return name if name in CHOICES else Path(name).stem


def _under_light(job: Job, mixture: LightBeside | None) -> SessionRequest:
    """The scene, its albedos, and the lights on it."""
    look, room, options = job.known.appearance, job.room, job.inputs.options
    albedo, by_lamps = (look.albedo, None) if room is None else room.session(job.lights[0])
    exposure = None if room is None else room.exposure
    others, lights, chosen = {"captured": look.captured, "white": None}, Path(job.light_name), _chosen(job)
    if mixture is not None:  # what lamps light is known for one albedo
        others, by_lamps = {}, None if job.mix.alone else by_lamps
        exposure = mixture.level if exposure is None else exposure
    asked = job.request.exposure_ev
    return SessionRequest(
        scene=job.known.scene,
        environment=job.lights[0],
        lighting=replace(options, budget_s=None).planned(),  # a session has a tolerance
        albedos={chosen: albedo, **{name: each for name, each in others.items() if name != chosen}},
        environments_folder=lights.parent if lights.is_file() else None,
        exposure=exposure if asked is None else 2.0**asked,
        lamps={} if by_lamps is None else {chosen: by_lamps},
        lamps_known=bool(room and room.lamps_found),
        state={"lamps": 1.0 if look.as_captured else options.lamp_factor},  # already in the colours of such a room
        mixture=mixture,
    )


def _first_mixture(job: Job, source: LampSource) -> LightBeside:
    """The light beside the environment as it is requested."""
    source.mixture(source.captured, None)  # before lamps: a relight shades by the environment first, too
    lamp_light = job.mix.lamp_light
    return source.mixture(source.captured, None if lamp_light is None else lamp_light.placed)


def _part_source(job: Job) -> PartSource | None:
    """The PartSource of a session; None without splats, or without a folder to keep parts in."""
    scene, splats = job.known.scene, job.inputs.splats
    if splats is None or scene.path is None:
        return None

    def surface() -> GrowingSurface:
        albedo = job.known.appearance.albedo
        return GrowingSurface(job.known.binding.surface, scene.colors_linear if albedo is None else albedo)

    return PartSource(surface, splats[0], scene.path)


def _lamp_source(job: Job) -> LampSource:
    """The LampSource of a session, with the mixture of `Job.shaded`."""
    mix = job.mix
    found: list[float] = []

    def level() -> float:
        if not found:
            known = mix.level_is_known
            found.append(mix.level(job.known.appearance.captured if known else mix.alone_under(job.lights[0]).radiance))
        return found[0]

    def mixture(captured: float, placed: Placed | None) -> LightBeside:
        return mix.beside(level(), captured, placed)

    def prepare() -> None:
        mixture(1.0, None)
        mix.light_of([AskedLamp(SphereLamp((0.0, 0.0, 0.0), intensity=WHITE))], 1.0).glimpse()  # which compiles it

    return LampSource(
        asked=mix.asked_lamps,
        captured=mix.captured_factor,
        prepare=prepare,
        light_of=mix.light_of,
        mixture=mixture,
        scale=lambda: mix.scale,
        command=f"relight {job.inputs.name} --env {job.light_name} --captured {{captured}} --lamp {{lamps}}",
    )


def _received_of(job: Job) -> "Callable[[NDArray[np.float32], float], NDArray[np.float32]]":
    """The function for the irradiance over pi of the scene from the radiance of an environment and its exposure."""
    look, room = job.known.appearance, job.room

    def received(radiance: NDArray[np.float32], exposure: float) -> NDArray[np.float32]:
        if look.as_captured:  # the session shows the captured colours, times what its lamps are dimmed by
            return look.irradiance * (radiance + DARKEST) / (look.captured + np.float32(DARKEST))
        if room and look.room is not None:
            radiance = room.as_captured(radiance, job.inputs.options.unplanned)
        return np.asarray(look.received(radiance, exposure), np.float32)

    return received


def _object_source(job: Job) -> ObjectSource:
    """The ObjectSource of a session."""
    inserts = job.known.inserts
    assert inserts is not None

    def exact(asked: "Sequence[AskedInsert]", now: ObjectsUnder, check: "Callable[..., None]") -> "InsertedLight":
        return inserts.moved(asked).under(surroundings_in(now, job.mix), now.received, check)

    return ObjectSource(
        asked=tuple(inserts.asked),
        received=_received_of(job),
        exact=exact,
        glimpse=lambda asked, before: inserts.moved(asked).glimpse(before),
        drawn=lambda splats, light, exposure, view, samples: with_objects(
            splats, light, PictureAsked(job.known.scene, view, exposure, samples)
        ),
    )


def _splats(job: Job, captured: "Splats", mixture: LightBeside | None) -> SplatSource:
    """The splats as a session shows them: by its own albedo, or by the captured colours."""
    look, room, chosen = job.known.appearance, job.room, _chosen(job)
    received = _received_of(job)

    def binding() -> "Binding":
        if not look.as_captured:
            received(np.zeros_like(look.captured), 1.0)  # the light of the capture in a room takes long, once
        return job.known.binding

    gloss = None if job.known.gloss is None or look.environment is None else partial(job.known.gloss.relit, look)
    looks = {chosen: SplatLook(look.irradiance, received, gloss)}
    if mixture is None and chosen != "captured" and room is None:
        least = np.maximum(look.captured, np.float32(DARKEST))
        looks["captured"] = SplatLook(
            np.ones_like(look.captured), lambda radiance, _: np.asarray(radiance / least, np.float32)
        )

    level = job.mix.brightness if look.as_captured and mixture is None else None
    return SplatSource(
        captured, binding, looks, lambda source: far_splats(source, job.known.scene, look, job.known.mirror), level
    )
