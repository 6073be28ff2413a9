"""A sequence of splats under a new light: one captured light, exposure and up axis for all frames.

The first frame is meshed and its captured light estimated, as of any splat. A frame that shows the same at rest takes
the light of that mesh; one that moves is meshed by itself, and lit by the same captured and new light.
"""

import math
import os
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from splat2mesh.api import default_folder
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.progress import Stages
from splat2mesh.base.strictjson import text_of
from splat2mesh.capture import capture_of
from splat2mesh.pipeline import meshed
from splat2mesh.scene.sources import fingerprint
from splat2mesh.splats.formats import can_hold, write_splats
from splat2mesh.splats.splats import Splats

from ..engine.appearance import Appearance, Place
from ..engine.relighter import Shaded
from ..light.environment import Environment
from ..output.relit_splats import RelitSource
from ..request import AnyLight, RelightRequest
from ..splats import write_relit_ply
from .earlier_results import REPORT, Earlier, settings_of
from .frames import SplatFrame, frame_splats, frames_in, is_at_rest
from .job import Job
from .meshing import SceneAtHand, scene_at_hand
from .writer import Writer, report_of

HEEDED = {"scene", "env", "lighting", "angles_deg", "sun", "at", "north_deg", "capture_env", "capture_tint", "white_at"}
HEEDED |= {"exposure_ev", "formats", "sky", "meshing", "output", "overwrite", "caching", "clear_cache", "sequence"}
"""Fields of a request that a sequence obeys."""

AT_REST, MOVING = "at rest", "moving"
"""How a frame was lit, in the report."""

Work = list[tuple[AnyLight, list[Path]]]
"""Each light, and a folder for each of its angles."""


def check_sequence(request: RelightRequest) -> None:
    """Raise InputError for what a sequence does not heed."""
    for each in fields(request):
        if each.name not in HEEDED and getattr(request, each.name) != each.default:
            raise InputError(f"`{each.name}`: a sequence does not heed it; leave it out")
    if set(request.formats or ()) - {"splat"}:
        raise InputError("`formats`: a sequence has splat alone; leave it out")


@dataclass(frozen=True, eq=False)
class SplatSequence:
    """A folder of frames, the first of which is meshed. request, first: for the scene of that one. frames: all that can
    be read, in order. resting: the numbers of those that show it at rest. notes: lines of a summary."""

    request: RelightRequest
    first: SceneAtHand
    frames: list[SplatFrame]
    resting: frozenset[int]
    notes: list[str]
    stages: Stages

    @classmethod
    def of(cls, request: RelightRequest, stages: Stages) -> "SplatSequence":
        """Read the frames, and mesh the first. Raises InputError for a request or a folder that is no sequence."""
        check_sequence(request)
        folder = Path(os.fspath(request.scene))  # type: ignore[arg-type]
        first: Splats | None = None
        good, resting = [], set()
        for frame in frames_in(folder):
            with stages.stage("read"):
                splats = frame_splats(frame)
            if splats is None:
                continue
            first = splats if first is None else first
            good.append(frame)
            if is_at_rest(splats, first):
                resting.add(frame.number)
        if not good:
            raise InputError(f"`sequence`: {folder} holds no frame that can be read")
        known, notes = scene_at_hand(good[0].path, request.meshing, stages, folder=Path(default_folder(folder)))
        asked = replace(request, scene=known.folder, formats=("splat",))
        return cls(asked, known, good, frozenset(resting), notes, stages)

    def write(self, work: Work, messages: list[str]) -> tuple[list[dict[str, Any]], Job]:
        """Light every frame in every light: the report of each folder, and the last Job.

        Frames that an earlier run of the same settings wrote stay. Raises InputError for folders with other results.
        """
        job = Job(self.request.under(work[0][0]), self.stages, self.first)
        if self.request.clear_cache:
            job.known.relighter.cache.clear()
        self._check_light(job.known.appearance)
        reports = []
        for light, folders in work:
            job = job if light is work[0][0] else job.under(light)
            outputs, exposure = [], 1.0
            for shaded, folder in zip(job.shaded(), folders, strict=True):
                exposure = shaded.exposure
                outputs.append(FrameFolder.of(self.request, folder, job, shaded, messages))
                source = Writer(job).source
                for frame in self._left(outputs[-1:], at_rest=True):
                    self._write_at_rest(frame, source, shaded, outputs[-1])
            for frame in self._left(outputs, at_rest=False):
                self._write_moving(frame, job, exposure, outputs)
            reports += [output.report for output in outputs]
        return reports, job

    def _left(self, outputs: "list[FrameFolder]", at_rest: bool) -> Iterator[SplatFrame]:
        """Frames that some output lacks."""
        frames = [frame for frame in self.frames if (frame.number in self.resting) == at_rest]
        with self.stages.stage("frames", len(frames)) as advance:
            for frame in frames:
                if not all(output.has(frame) for output in outputs):
                    yield frame
                advance(1)

    def _write_at_rest(self, frame: SplatFrame, source: RelitSource, shaded: Shaded, output: "FrameFolder") -> None:
        started, splats = time.monotonic(), frame_splats(frame)
        if splats is not None:
            output.write(frame, source.at_rest(splats, frame.path).relit(shaded), AT_REST, started)

    def _write_moving(self, frame: SplatFrame, job: Job, exposure: float, outputs: "list[FrameFolder]") -> None:
        """Light a frame by a mesh of its own, that has the axes of the first, in the light of the first."""
        started, asked, look = time.monotonic(), self.request, job.known.appearance
        capture = capture_of(frame.path, asked.meshing, self.stages)
        capture = replace(capture, rotation=np.asarray(job.known.scene.scene_from_splat, np.float64))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DataWarning)  # the first frame has warned of the same
            scene = meshed(frame.path, capture, asked.meshing, self.stages)
        separable = bool((look.capture or {}).get("separable"))
        known = _exposed(look.environment) if separable and look.environment is not None else None
        own = replace(
            asked,
            scene=scene,
            splat=frame.path,
            albedo=None if separable else "captured",
            lighting=replace(asked.lighting, captured_sun=None, captured_sky=None, captured_light=known),
            capture_env=None,
            capture_tint=None,
            white_at=None,
            exposure_ev=math.log2(exposure),
            caching="none",
            clear_cache=False,
        )
        writer = Writer(Job(own.under(job.request.light), self.stages))
        for shaded, output in zip(writer.job.shaded(), outputs, strict=True):
            if not output.has(frame):
                output.write(frame, writer.relit_splats(shaded), MOVING, started)
                started = time.monotonic()

    def _check_light(self, look: Appearance) -> None:
        """Raise InputError for frames that move in a light that no other mesh can take over."""
        moving = next((frame for frame in self.frames if frame.number not in self.resting), None)
        if moving is not None and look.place is not Place.OPEN:
            raise InputError(f"`sequence`: frame {moving.number} moves, and in a closed room all must be at rest")


def _exposed(light: Environment) -> Environment:
    """A captured light whose brightness is taken as it is."""
    same = Environment(light.radiance, light.name, light.rotation_deg)
    same.exposed = True
    return same


class FrameFolder:
    """The folder of a light: a splat for each frame, by the name of its file, and the report, which says of each what
    it was made from. It is written after each frame, so that an interrupted run goes on there."""

    def __init__(self, folder: Path, report: dict[str, Any], messages: list[str]) -> None:
        self._folder, self.report, self._messages = folder, report, messages

    @classmethod
    def of(cls, request: RelightRequest, folder: Path, job: Job, shaded: Shaded, messages: list[str]) -> "FrameFolder":
        """Open it. Raises InputError where it holds results of other settings that may not be replaced."""
        settings = settings_of(request, job.request.light, shaded.light.rotation_deg)
        kept = Earlier(folder, settings, request.overwrite).kept.get("frames")
        report = {**report_of(job, shaded), "settings": settings, "frames": kept if isinstance(kept, dict) else {}}
        folder.mkdir(parents=True, exist_ok=True)
        made = cls(folder, report, messages)
        made._save()
        return made

    def has(self, frame: SplatFrame) -> bool:
        """Whether the frame was written, from the file as it is now."""
        entry = self.report["frames"].get(frame.path.name)
        if not isinstance(entry, dict) or not (self._folder / str(entry.get("file"))).is_file():
            return False
        return entry.get("sha256") == fingerprint(frame.path)

    def write(self, frame: SplatFrame, relit: Splats, state: str, started: float) -> None:
        """Write the relit splats of a frame in its format, or as a PLY where that has no writer."""
        name = frame.path.name
        if frame.kind == "ply":
            write_relit_ply(self._folder / name, relit, frame.path)
        elif can_hold(frame.kind, relit):
            write_splats(self._folder / name, relit, frame.kind)
        else:
            name = f"{frame.path.stem}.ply"
            write_relit_ply(self._folder / name, relit)
        entry = {"file": name, "sha256": fingerprint(frame.path), "state": state}
        self.report["frames"][frame.path.name] = {**entry, "seconds": round(time.monotonic() - started, 2)}
        self._save()

    def _save(self) -> None:
        frames = self.report["frames"]
        self.report.update(files=[frames[name]["file"] for name in sorted(frames)], warnings=list(self._messages))
        with staged_file(self._folder / REPORT) as staging:
            staging.write_text(text_of(self.report, indent=1) + "\n", encoding="utf-8")
