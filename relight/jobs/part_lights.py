"""The lights of parts that have their own, beside that of the rest: another environment, or the same changed."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from splat2mesh.base.errors import InputError

from ..engine.appearance import Appearance
from ..engine.relighter import Shaded
from ..lamps.asked import WHITE
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..live.parts import LivePart
from ..output.subject import PartInLight
from ..splats.kept_parts import kept_parts
from ..splats.lit_part import LitPart, checked
from ..splats.part_spec import PartSpec, SplatFile
from ..splats.parts import AskedPart, PartShares
from .job import Job


def part_lights(job: Job) -> list[PartInLight]:
    """The parts that a Job lights by themselves, in their order."""
    if not job.request.parts:
        return []
    pairs = zip(job.known.lit_parts, job.inputs.lit_parts, strict=True)
    return [PartInLight(shares, light_of_part(job, asked)) for shares, asked in pairs]


def job_of_part(job: Job, asked: LitPart, shaded: Shaded) -> Job:
    """A Job that lights the whole scene as a part of it is, beside the light of the rest, but for exposure and tint of
    that. Raises InputError where the light of the capture would be turned."""
    whole, env, light = job.request, asked.env, shaded.light
    if asked.has_own:
        if env is None and isinstance(light, CapturedLight):
            raise InputError(f"`parts` {asked.words}: rotate: the light of the capture cannot be turned; give an env")
        level = whole.exposure_ev if env is None else None
        whole = whole.under(light.rotated(-light.rotation_deg) if env is None else env)
        whole = replace(whole, angles_deg=(asked.angle_deg or 0.0,), exposure_ev=level)
    return Job(replace(whole, parts=(), only=(), keep=(), shadow_of_parts=False), known=job.known)


def light_of_part(job: Job, asked: LitPart) -> Callable[[Shaded], Shaded]:
    """The function that returns the light of a part beside that of the rest. It lights the scene once for each."""
    found: list[tuple[Environment | None, Shaded]] = []

    def under(shaded: Shaded) -> Shaded:
        if not asked.has_own:
            return changed(job.known.appearance, shaded, asked)
        beside = shaded.light if asked.env is None else None
        if not found or found[0][0] is not beside:
            own = next(job_of_part(job, asked, shaded).shaded())
            found[:] = [(beside, changed(job.known.appearance, own, asked))]
        return found[0][1]

    return under


def changed(look: Appearance, shaded: Shaded, asked: LitPart) -> Shaded:
    """A light with the exposure and the tint of a part. Raises InputError for a light that changes no surface."""
    shading, tint, light = shaded.shading, np.asarray(asked.tint, np.float32), shaded.light
    received = shading.received
    if received is None:
        if look.as_captured:
            raise InputError(f"`parts` {asked.words}: no light gets into this closed room")
        received = look.received(shading.radiance, shaded.exposure)
    if asked.tint != WHITE:
        shading = shading._replace(radiance=shading.radiance * tint)
        received = np.asarray(received * tint, np.float32)
        if not isinstance(light, CapturedLight):
            light = Environment(light.radiance * tint, light.name, light.rotation_deg)
    shading = shading._replace(received=received)
    return shaded._replace(light=light, shading=shading, exposure=shaded.exposure * 2.0**asked.exposure_ev)


def kept_live_parts(job: Job) -> list[LivePart]:
    """The parts that the folder of the scene keeps, with exposure and tint: a page has no other light for one."""
    scene, splats, found = job.known.scene, job.inputs.splats, []
    if scene.path is None or splats is None or not scene.path.is_dir():
        return []
    file = SplatFile(splats[0])
    for name, kept in kept_parts(scene.path).items():
        asked, light = AskedPart((PartSpec.parse(kept.file),), "parts"), checked(kept.light) if kept.light else {}
        shares = PartShares.of(asked, scene, file, asked.of_splats(file)).splats
        assert shares is not None  # of splats
        found.append(LivePart(name, shares, light.get("exposure_ev", 0.0), light.get("tint", WHITE), kept.entry))
    return found


def described(job: Job) -> list[dict[str, Any]]:
    """The entries of a report for the parts in lights of their own, JSON-clean."""
    entries = []
    for shares, asked in zip(job.known.lit_parts, job.inputs.lit_parts, strict=True):
        counts = {name: each for name, each in shares.report.items() if name in ("splats", "vertices")}
        name = None if asked.env is None else asked.env.name
        light = {"env": name, "rotate": asked.angle_deg, "exposure": asked.exposure_ev, "tint": list(asked.tint)}
        entries.append({"part": asked.words, **light, **counts})
    return entries
