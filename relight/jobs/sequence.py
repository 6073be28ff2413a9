"""A sequence of splats under a new light: one captured light, exposure and up axis for all frames.

The first frame is meshed and its captured light estimated, as of any splat. Frames of the same splats take the light of
that mesh, which moves with them; others are meshed by themselves, and lit by the same captured and new light.
"""

import os
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.api import default_folder
from splat2mesh.base.errors import InputError
from splat2mesh.base.outputs import staged_file
from splat2mesh.base.progress import Stages
from splat2mesh.base.strictjson import text_of
from splat2mesh.scene.sources import fingerprint
from splat2mesh.splats.formats import can_hold, read_splats, write_splats
from splat2mesh.splats.frames import ALONE, MOVING, SplatFrame, frame_splats, frames_in, state_of
from splat2mesh.splats.splats import Splats

from ..animation.film import FILM, frame_times, joined
from ..engine.appearance import Appearance, Place
from ..engine.relighter import Shaded
from ..live.played import Played, write_player
from ..output.images import write_png
from ..request import AnyLight, RelightRequest
from ..splats import write_relit_ply
from .earlier_results import REPORT, Earlier, settings_of
from .job import Job
from .lit_frames import LitFrames
from .meshing import SceneAtHand, scene_at_hand
from .writer import report_of

HEEDED = {"scene", "env", "lighting", "angles_deg", "sun", "at", "north_deg", "capture_env", "white_at"}
HEEDED |= {
    "exposure_ev",
    "formats",
    "sky",
    "only",
    "keep",
    "parts",
    "meshing",
    "output",
    "overwrite",
    "caching",
    "clear_cache",
    "sequence",
    "fps",
}
"""Fields of a request that a sequence obeys."""

Work = list[tuple[AnyLight, list[Path]]]
"""Each light, and a folder for each of its angles."""


def check_sequence(request: RelightRequest) -> None:
    """Raise InputError for what a sequence does not heed."""
    for each in fields(request):
        if each.name not in HEEDED and getattr(request, each.name) != each.default:
            raise InputError(f"`{each.name}`: a sequence does not heed it; leave it out")
    if set(request.formats or ()) - {"splat", "png", "web"}:
        raise InputError("`formats`: a sequence has splat, and png and web on request")
    frame_times(0.0, request.fps)  # or an InputError


@dataclass(frozen=True, eq=False)
class SplatSequence:
    """A folder of frames, the first of which is meshed. request, first: for the scene of that one. frames: all that can
    be read, in order. states: of `frames.state_of`, by number. notes: lines of a summary. paged: whether each light has
    a page that plays its frames."""

    request: RelightRequest
    first: SceneAtHand
    frames: list[SplatFrame]
    states: dict[int, str]
    notes: list[str]
    stages: Stages
    paged: bool = False

    @classmethod
    def of(cls, request: RelightRequest, stages: Stages) -> "SplatSequence":
        """Read the frames, and mesh the first. Raises InputError for a request or a folder that is no sequence."""
        check_sequence(request)
        folder = Path(os.fspath(request.scene))  # type: ignore[arg-type]
        first: Splats | None = None
        good, states = [], {}
        for frame in frames_in(folder):
            with stages.stage("read"):
                splats = frame_splats(frame)
            if splats is None:
                continue
            first = splats if first is None else first
            good.append(frame)
            states[frame.number] = state_of(splats, first)
        if not good:
            raise InputError(f"`sequence`: {folder} holds no frame that can be read")
        known, notes = scene_at_hand(good[0].path, request.meshing, stages, folder=Path(default_folder(folder)))
        pictured = ("png",) * ("png" in (request.formats or ()))
        asked = replace(request, scene=known.folder, formats=("splat", *pictured))
        return cls(asked, known, good, states, notes, stages, "web" in (request.formats or ()))

    @property
    def counted(self) -> str:
        """How many frames move, in words."""
        moving, alone = (list(self.states.values()).count(state) for state in (MOVING, ALONE))
        return f"{len(self.frames)} frames, of which {moving} move and {alone} have splats of their own"

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
            outputs, lit = [], list(job.shaded())
            for shaded, folder in zip(lit, folders, strict=True):
                outputs.append(FrameFolder.of(self.request, folder, job, shaded, messages))
            frames = LitFrames(self.request, job, lit)
            for frame in self._left(outputs):
                started, state, splats = time.monotonic(), self.states[frame.number], frame_splats(frame)
                if splats is None:
                    continue
                for output, shaded, relit in zip(outputs, lit, frames.relit(frame, splats, state), strict=True):
                    picture = frames.picture(relit, shaded) if output.pictured else None
                    output.write(frame, relit, state, picture, started)
                    started = time.monotonic()
            notes = [output.film(self.frames, self.request.fps) for output in outputs if output.pictured]
            self.notes.extend(note for note in dict.fromkeys(notes) if note)
            if self.paged:
                self._write_pages(outputs, lit, job)
            reports += [output.report for output in outputs]
        return reports, job

    def _left(self, outputs: "list[FrameFolder]") -> Iterator[SplatFrame]:
        """Frames that some output lacks."""
        with self.stages.stage("frames", len(self.frames)) as advance:
            for frame in self.frames:
                if not all(output.has(frame) for output in outputs):
                    yield frame
                advance(1)

    def _write_pages(self, outputs: "list[FrameFolder]", lit: list[Shaded], job: Job) -> None:
        """Write a page that plays the frames, for each angle."""
        title = f"{self.frames[0].path.parent.name}, relit"
        with self.stages.stage("write"):
            for output, shaded in zip(outputs, lit, strict=True):
                behind = shaded.exposure * shaded.backdrop
                output.page(self.frames, Played(job.known.scene, shaded.sky, behind, self.request.fps, title))

    def _check_light(self, look: Appearance) -> None:
        """Raise InputError for frames in a light that their mesh cannot take over."""
        first = {state: frame.number for frame in reversed(self.frames) for state in [self.states[frame.number]]}
        if ALONE in first and look.place is not Place.OPEN:
            raise InputError(f"`sequence`: frame {first[ALONE]} has other splats, and a closed room must keep them")


class FrameFolder:
    """The folder of a light: a splat for each frame, by the name of its file, and the report, which says of each what
    it was made from. It is written after each frame, so that an interrupted run goes on there. pictured: whether each
    frame has a picture too."""

    def __init__(self, folder: Path, report: dict[str, Any], messages: list[str], pictured: bool) -> None:
        self._folder, self.report, self._messages, self.pictured = folder, report, messages, pictured

    @classmethod
    def of(cls, request: RelightRequest, folder: Path, job: Job, shaded: Shaded, messages: list[str]) -> "FrameFolder":
        """Open it. Raises InputError where it holds results of other settings that may not be replaced."""
        settings = settings_of(request, job.request.light, shaded.light.rotation_deg)
        kept = Earlier(folder, settings, request.overwrite).kept.get("frames")
        report = {**report_of(job, shaded), "settings": settings, "frames": kept if isinstance(kept, dict) else {}}
        folder.mkdir(parents=True, exist_ok=True)
        made = cls(folder, report, messages, "png" in (request.formats or ()))
        made._save()
        return made

    def has(self, frame: SplatFrame) -> bool:
        """Whether the frame was written, from the file as it is now."""
        entry = self.report["frames"].get(frame.path.name)
        if not isinstance(entry, dict) or entry.get("sha256") != fingerprint(frame.path):
            return False
        wanted = ("file", "picture") if self.pictured else ("file",)
        return all((self._folder / str(entry.get(kind))).is_file() for kind in wanted)

    def film(self, frames: list[SplatFrame], fps: float) -> str:
        """Join the pictures of frames. Returns "" when it worked, else why it did not."""
        names = [self.report["frames"].get(frame.path.name, {}).get("picture") for frame in frames]
        note = joined([self._folder / name for name in names if name], self._folder / FILM, fps)
        self.report["film"] = None if note else FILM
        self._save()
        return note

    def page(self, frames: list[SplatFrame], played: Played) -> None:
        """Write the page that plays the relit frames."""
        names = [self.report["frames"].get(frame.path.name, {}).get("file") for frame in frames]
        relit = (read_splats(self._folder / name) for name in names if name)
        self.report["page"] = write_player(self._folder, relit, played)
        self._save()

    def write(
        self, frame: SplatFrame, relit: Splats, state: str, picture: NDArray[np.uint8] | None, started: float
    ) -> None:
        """Write the relit splats of a frame in its format, or as a PLY where that has no writer, and its picture."""
        name = frame.path.name
        if frame.kind == "ply":
            write_relit_ply(self._folder / name, relit, frame.path)
        elif can_hold(frame.kind, relit):
            write_splats(self._folder / name, relit, frame.kind)
        else:
            name = f"{frame.path.stem}.ply"
            write_relit_ply(self._folder / name, relit)
        entry = {"file": name, "sha256": fingerprint(frame.path), "state": state}
        if picture is not None:
            entry["picture"] = f"{frame.path.stem}.png"
            write_png(self._folder / entry["picture"], picture)
        self.report["frames"][frame.path.name] = {**entry, "seconds": round(time.monotonic() - started, 2)}
        self._save()

    def _save(self) -> None:
        entries = [self.report["frames"][name] for name in sorted(self.report["frames"])]
        files = [each[kind] for kind in ("file", "picture") for each in entries if kind in each]
        film = [self.report["film"]] if self.report.get("film") else []
        film += self.report.get("page") or []
        self.report.update(files=files + film, warnings=list(self._messages))
        with staged_file(self._folder / REPORT) as staging:
            staging.write_text(text_of(self.report, indent=1) + "\n", encoding="utf-8")
