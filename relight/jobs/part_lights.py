"""The lights of parts: of one that alone takes the new light or keeps the captured one, and of those with lights of
their own.

The shadow that a part casts on the rest: the part is in the scene, and out of it, a pose in which its faces are gone.
So the rest changes where the part stops light that would come directly, and there by what it does to all light.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Mask
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

from ..engine.appearance import Place
from ..engine.relighter import Relighter, Shaded
from ..lamps.asked import WHITE
from ..light.environment import Environment
from ..light.loading import CapturedLight
from ..live.parts import LivePart
from ..splats.kept_parts import kept_parts
from ..splats.lit_part import LitPart, checked
from ..splats.part_spec import PartSpec, SplatFile
from ..splats.parts import AskedPart, PartShares, blended
from .job import Job


class PartInLight:
    """A part of a job in a light of its own, beside that of the rest. shares: of that light."""

    def __init__(self, job: Job, asked: LitPart, shares: PartShares) -> None:
        self._job, self._asked, self.shares = job, asked, shares
        self._latest: tuple[Environment | None, Shaded] | None = None

    def whole(self, shaded: Shaded) -> Job:
        """A Job that lights the whole scene as the part is, but for exposure and tint of that. Raises InputError where
        the light of the capture would be turned."""
        whole, env, light, asked = self._job.request, self._asked.env, shaded.light, self._asked
        if asked.has_own:
            if env is None and isinstance(light, CapturedLight):
                raise InputError(
                    f"`parts` {asked.words}: rotate: the light of the capture cannot be turned; give an env"
                )
            level = whole.exposure_ev if env is None else None
            whole = whole.under(light.rotated(-light.rotation_deg) if env is None else env)
            whole = replace(whole, angles_deg=(asked.angle_deg or 0.0,), exposure_ev=level)
        return Job(replace(whole, parts=(), only=(), keep=(), shadow_of_parts=False), known=self._job.known)

    def under(self, shaded: Shaded) -> Shaded:
        """Its light beside that of the rest, as it lights the whole scene; in it `received` is known."""
        if not self._asked.has_own:
            return self._changed(shaded)
        beside = shaded.light if self._asked.env is None else None
        if self._latest is None or self._latest[0] is not beside:
            self._latest = beside, self._changed(next(self.whole(shaded).shaded()))
        return self._latest[1]

    def _changed(self, shaded: Shaded) -> Shaded:
        """A light with the exposure and the tint of the part. Raises InputError for one that changes no surface."""
        shading, light, look, asked = shaded.shading, shaded.light, self._job.known.appearance, self._asked
        received = shading.received
        if received is None:
            if look.as_captured:
                raise InputError(f"`parts` {asked.words}: no light gets into this closed room")
            received = look.received(shading.radiance, shaded.exposure)
        if asked.tint != WHITE:
            tint = np.asarray(asked.tint, np.float32)
            shading = shading._replace(radiance=shading.radiance * tint)
            received = np.asarray(received * tint, np.float32)
            if not isinstance(light, CapturedLight):
                light = Environment(light.radiance * tint, light.name, light.rotation_deg)
        shading = shading._replace(received=received)
        return shaded._replace(light=light, shading=shading, exposure=shaded.exposure * 2.0**asked.exposure_ev)


class PartLights:
    """The parts of a job. new: what takes the new light; None for all. lit: parts in lights of their own, the last one
    on top. Raises InputError for a shadow of parts in a scene that has none."""

    def __init__(self, job: Job) -> None:
        asked = job.request  # which has none where all is lit as a part of it
        pairs = zip(job.inputs.lit_parts, job.known.lit_parts, strict=True) if asked.parts else ()
        self.lit = [PartInLight(job, *pair) for pair in pairs]
        self.new, self._look = job.known.part if asked.only or asked.keep else None, job.known.appearance
        self._shadow = PartShadow(job) if job.request.shadow_of_parts else None

    def shadow_on_rest(self, shaded: Shaded) -> NDArray[np.float32] | None:
        """(V, 3) by which a light changes that of the rest; None where the rest stays."""
        return None if self._shadow is None else self._shadow.ratio(shaded)

    def shown(self, shaded: Shaded) -> Shaded:
        """The light as the mesh shows it: that of each part, new in the part that takes it, captured in the rest."""
        found, layers = shaded, [(part.under(shaded), part.shares) for part in self.lit]
        if self.new is not None:
            shade, layers = self.shadow_on_rest(shaded), [(shaded, self.new), *layers]
            scale = np.float32(1.0) if shade is None else shade
            captured = (each * scale / shaded.exposure for each in (self._look.captured, self._look.irradiance))
            found = _with_light(shaded, *captured)
        for own, shares in layers:
            level, pairs = np.float32(own.exposure / shaded.exposure), zip(*map(self._light, (found, own)), strict=True)
            found = _with_light(found, *(blended(below, level * above, shares.vertices) for below, above in pairs))
        return found

    def _light(self, shaded: Shaded) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Exit radiance and irradiance over pi, (V, 3)."""
        radiance, known = shaded.shading.radiance, shaded.shading.received
        return radiance, self._look.received(radiance, shaded.exposure) if known is None else known


def _with_light(shaded: Shaded, radiance: NDArray[np.float32], received: NDArray[np.float32]) -> Shaded:
    return shaded._replace(shading=shaded.shading._replace(radiance=radiance, received=received))


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


class PartShadow:
    """The shadow of what takes the new light of a Job that has a part. Raises InputError for a scene without a known
    captured light, for a closed room and for a method without rays."""

    def __init__(self, job: Job) -> None:
        look, part = job.known.appearance, job.known.part
        if look.environment is None or look.place is not Place.OPEN:
            raise InputError("`shadow_of_parts`: expected an object or an open place whose captured light is estimated")
        assert part is not None  # of the job
        self._job, self._look, self._captured_in = job, look, look.environment
        self._without = _without(job.known.scene, part.vertices > 0.5)
        self._latest: tuple[Shaded, NDArray[np.float32]] | None = None

    def ratio(self, shaded: Shaded) -> NDArray[np.float32]:
        """(V, 3) by which the light of the capture changes on the rest, 1 where the part does not shade it."""
        if self._latest is None or self._latest[0].light is not shaded.light:
            self._latest = shaded, self._found(shaded)
        return self._latest[1]

    def _found(self, shaded: Shaded) -> NDArray[np.float32]:
        relighter, settings = self._job.known.relighter, shaded.shading.settings
        if settings.method != "raytraced":
            raise InputError(f"`shadow_of_parts`: rays cast it, and the method is {settings.method}")
        present, absent = (
            self._lights(relighter.posed(scene, settings), shaded) for scene in (relighter.scene, self._without)
        )
        (new, captured), (new_without, captured_without) = present[1], absent[1]
        shades = np.any([a != b for a, b in zip(present[0], absent[0], strict=True)], axis=(0, 2))
        ratio = np.ones_like(new)
        above, below = (new * captured_without)[shades], (new_without * captured)[shades]
        ratio[shades] = np.divide(above, below, out=np.ones_like(above), where=below > 0.0)
        return ratio

    def _lights(self, relighter: Relighter, shaded: Shaded) -> tuple[list[NDArray[np.float32]], list[NDArray]]:
        """Direct light of the new and the captured sky on a pose, (V, 3), and irradiance over pi by all light."""
        job, look = self._job.posed(relighter, self._look), self._look
        lit = job.beside(Shaded(shaded.light, job.mix.alone_under(shaded.light), shaded.exposure)).shading
        captured = relighter.shading(self._captured_in, look.albedo)
        direct = [
            relighter.direct(light, shading.settings)[0]
            for light, shading in ((shaded.light, lit), (self._captured_in, captured))
        ]
        new = look.received(lit.radiance, shaded.exposure) if lit.received is None else lit.received
        return direct, [new, look.received(captured.radiance)]


def _without(scene: Scene, gone: Mask) -> Scene:
    """A pose of a Scene without the faces of some of its vertices, (V,) bool, which count as moved: by one rounding."""
    chunks, start = [], 0
    for chunk in scene.chunks:
        rows = gone[start : start + len(chunk.vertices)]
        vertices = np.where(rows[:, None], np.nextafter(chunk.vertices, np.float32(np.inf)), chunk.vertices)
        chunks.append(replace(chunk, vertices=vertices, faces=chunk.faces[~rows[chunk.faces].any(axis=1)]))
        start += len(chunk.vertices)
    return replace(scene, chunks=chunks, path=None)
