"""Frames of a sequence in the light of the first one: at rest, moving, or with rows of their own.

What moves is lit on the mesh of the first frame as its splats carry it. Light is that of the first frame and what the
motion changes of it, in the light of the capture and in the new one: both are found in either pose by the same rays. So
a captured shadow that moves is divided out where it is, the new one falls where it belongs, and what the motion does
not reach changes as in the first frame, to the bit.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from splat2mesh.sequence import meshed_like
from splat2mesh.splats.frames import ALONE, AT_REST, MOVING, SplatFrame
from splat2mesh.splats.splats import Splats

from ..engine.appearance import CAPTURE, Appearance, Place
from ..engine.relighter import Relighter, Shaded
from ..light.environment import Environment
from ..request import RelightRequest
from ..rooms.room_poses import RoomPoses
from ..splats.carried import CarriedMesh
from ..splats.light_ratio import Usual
from ..splats.part_spec import Shares
from ..splats.parts import blended_splats
from ..transfer.bounces import Interreflection
from ..transfer.settings import Settings
from .job import Job
from .part_lights import PartLights
from .relit_source import RelitSource
from .results import Results

PoseLight = tuple[Appearance, list[NDArray[np.float32]]]
"""What light does on a pose: its Appearance in the light of the capture, and (V, 3) irradiance over pi in the new one,
at each angle."""


class LitFrames:
    """The frames of a request in one light. job: of the first frame. lit: what it shades, of every angle."""

    def __init__(self, request: RelightRequest, job: Job, lit: list[Shaded]) -> None:
        self._request, self._job, self._shaded = request, job, lit

    def relit(self, frame: SplatFrame, splats: Splats, state: str) -> Iterator[Splats]:
        """The splats of a frame in the light, at one angle after the other."""
        ways = {AT_REST: self._at_rest, MOVING: self._moving, ALONE: self._alone}
        found = ways[state](frame, splats)
        if state == MOVING:
            for shares, part in self._parts:
                found = map(partial(blended_splats, shares=shares), found, part.relit(frame, splats, state))
        return found

    @cached_property
    def _parts(self) -> "list[tuple[Shares, LitFrames]]":
        """The frames in the lights of parts that have their own, and the shares of these."""
        found = []
        for part in PartLights(self._job).lit:
            assert part.shares.splats is not None  # of a sequence
            lit = [part.under(shaded) for shaded in self._shaded]
            found.append((part.shares.splats, LitFrames(self._request, part.whole(self._shaded[0]), lit)))
        return found

    def picture(self, relit: Splats, shaded: Shaded) -> NDArray[np.uint8]:
        """The picture, (H, W, 3) sRGB, of a relit frame at an angle."""
        with self._job.stages.stage("preview"):
            return self._results.painted(relit, shaded)

    @cached_property
    def _results(self) -> Results:
        return Results(self._job)

    @property
    def _source(self) -> RelitSource:
        return self._results.relit

    def _at_rest(self, frame: SplatFrame, splats: Splats) -> Iterator[Splats]:
        return map(self._source.of_frame(splats, frame.path).relit, self._shaded)

    def _moving(self, frame: SplatFrame, splats: Splats) -> Iterator[Splats]:
        """On the mesh of the first frame, as the splats carry it."""
        mesh = self._carried.at(splats)
        look, after = self._pose_light(self._still.posed(mesh.scene(self._still.scene), self._settings))
        binding = self._job.known.binding.posed(splats, mesh, look.captured)
        source, still_lit = self._source.of_frame(splats, frame.path, binding, look), self._first[1]
        for shaded, usual, now, still in zip(self._shaded, self._usual, after, still_lit, strict=True):
            light = _moved(self._source.received(shaded.shading), now, still)
            yield source.relit(shaded._replace(shading=shaded.shading._replace(received=light)), usual)

    @cached_property
    def _carried(self) -> CarriedMesh:
        return self._job.known.binding.carried

    @cached_property
    def _still(self) -> Relighter:
        """The first pose, as all others are lit."""
        return self._job.known.relighter.posed(self._job.known.scene, self._settings)

    @property
    def _settings(self) -> Settings:
        return self._shaded[0].shading.settings

    @cached_property
    def _room(self) -> RoomPoses | None:
        """The closed room that the scene is, where its lamps are known."""
        room = self._job.known.appearance.room
        return None if room is None else RoomPoses(room, self._still.occluder, _bounces(self._still))

    @cached_property
    def _first(self) -> PoseLight:
        return self._pose_light(self._still)

    @cached_property
    def _usual(self) -> list[Usual]:
        """The typical change of light in the first frame, which stays, at each angle."""
        binding, before = self._job.known.binding, self._job.known.appearance.irradiance
        return [binding.usual(before, self._source.received(each.shading), each.exposure) for each in self._shaded]

    def _pose_light(self, relighter: Relighter) -> PoseLight:
        look = self._job.known.appearance
        if self._room is not None:
            look = look._replace(room=self._room.at(relighter.occluder, _bounces(relighter)))
        elif look.place is Place.OPEN:
            before = _moved(look.irradiance, self._captured(relighter), self._captured_still)
            change = np.divide(before, look.irradiance, out=np.ones_like(before), where=look.irradiance > 0.0)
            look = look._replace(irradiance=before, captured=look.captured * change)
        job = self._job.posed(relighter, look)
        lit = [job.beside(Shaded(each.light, job.mix.alone_under(each.light), each.exposure)) for each in self._shaded]
        return look, [self._source.received(each.shading) for each in lit]

    @cached_property
    def _captured_still(self) -> NDArray[np.float32]:
        return self._captured(self._still)

    def _captured(self, relighter: Relighter) -> NDArray[np.float32]:
        """(V, 3) irradiance over pi of the captured light on a pose, by its model."""
        look = self._job.known.appearance
        assert look.environment is not None  # of every estimate
        return look.received(relighter.shading(look.environment, look.albedo).radiance)

    def _alone(self, frame: SplatFrame, splats: Splats) -> Iterator[Splats]:
        """On a mesh of its own, that has the axes of the first."""
        asked, stages, look = self._request, self._job.stages, self._job.known.appearance
        scene = meshed_like(self._job.known.scene, frame.path, asked.meshing, stages)
        separable = bool((look.capture or {}).get("separable"))
        known = _exposed(look.environment) if separable and look.environment is not None else None
        own = replace(
            asked,
            scene=scene,
            splat=frame.path,
            albedo=None if separable else "captured",
            lighting=replace(asked.lighting, captured_sun=None, captured_sky=None, captured_light=known),
            capture_env=None,
            white_at=None,
            exposure_ev=math.log2(self._shaded[0].exposure),
            caching="none",
            clear_cache=False,
        )
        job = Job(own.under(self._job.request.light), stages)
        return map(Results(job).relit.relit, job.shaded())


def _bounces(relighter: Relighter) -> Interreflection:
    return relighter.transport(CAPTURE).interreflection


def _moved(first: NDArray[np.float32], now: NDArray[np.float32], still: NDArray[np.float32]) -> NDArray[np.float32]:
    """Light of the first frame (V, 3) with what a motion changes of it."""
    return np.maximum(first + (now - still), np.float32(0.0))


def _exposed(light: Environment) -> Environment:
    """A captured light whose brightness is taken as it is."""
    same = Environment(light.radiance, light.name, light.rotation_deg)
    same.exposed = True
    return same
