"""A sequence of splats under a new light: one captured light, exposure and up axis for all frames.

The first frame is meshed and its captured light estimated, as of any splat. Frames of the same splats take the light of
that mesh, which moves with them; others are meshed by themselves, and lit by the same captured and new light.
"""

import os
import time
from collections.abc import Iterator
from dataclasses import replace
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
from ..engine.appearance import Place
from ..engine.relighter import Shaded
from ..live.played import Played, write_player
from ..output.images import write_png
from ..request import AnyLight, RelightRequest
from ..splats import write_relit_ply
from .earlier_results import REPORT, Earlier, check_heeded, settings_of
from .job import Job
from .lit_frames import LitFrames
from .meshing import scene_at_hand
from .writer import report_of

HEEDED = "scene env lighting angles_deg sun at north_deg capture_env white_at exposure_ev formats sky only keep parts"
HEEDED += " meshing output overwrite caching clear_cache sequence fps"
"""Fields of a request that a sequence obeys."""

Work = list[tuple[AnyLight, list[Path]]]
"""Each light, and a folder for each of its angles."""


class SplatSequence:
    """A folder of frames, the first of which is meshed. request: for the scene of that one. frames: all that can be
    read, in order. notes: lines of a summary. Raises InputError for a request or a folder that is no sequence."""

    def __init__(self, request: RelightRequest, stages: Stages) -> None:
        check_heeded(request, HEEDED, "a sequence does not heed it; leave it out")
        formats, folder = {*(request.formats or ())}, Path(os.fspath(request.scene))  # type: ignore[arg-type]
        if formats - {"splat", "png", "web"}:
            raise InputError("`formats`: a sequence has splat, and png and web on request")
        frame_times(0.0, request.fps)  # or an InputError
        self.frames: list[SplatFrame] = []
        self._states: dict[int, str] = {}  # of `frames.state_of`, by number
        first: Splats | None = None
        for frame in frames_in(folder):
            with stages.stage("read"):
                splats = frame_splats(frame)
            if splats is None:
                continue
            first = splats if first is None else first
            self.frames.append(frame)
            self._states[frame.number] = state_of(splats, first)
        if not self.frames:
            raise InputError(f"`sequence`: {folder} holds no frame that can be read")
        self._alone = [number for number, state in self._states.items() if state == ALONE]
        meshed = scene_at_hand(self.frames[0].path, request.meshing, stages, folder=Path(default_folder(folder)))
        self._first, self.notes = meshed
        self._stages, self._paged, self._title = stages, "web" in formats, f"{folder.name}, relit"
        pictured = ("png",) * ("png" in formats)
        self.request = replace(request, scene=self._first.folder, formats=("splat", *pictured))

    @property
    def counted(self) -> str:
        """How many frames move, in words."""
        moving = list(self._states.values()).count(MOVING)
        return f"{len(self.frames)} frames, of which {moving} move and {len(self._alone)} have splats of their own"

    def write(self, work: Work, messages: list[str]) -> tuple[list[dict[str, Any]], Job]:
        """Light every frame in every light: the report of each folder, and the last Job.

        Frames that an earlier run of the same settings wrote stay. Raises InputError for folders with other results.
        """
        job = Job(self.request.under(work[0][0]), self._stages, self._first)
        if self.request.clear_cache:
            job.known.relighter.cache.clear()
        if self._alone and job.known.appearance.place is not Place.OPEN:
            raise InputError(f"`sequence`: frame {self._alone[0]} has other splats, and a closed room must keep them")
        reports = []
        for light, folders in work:
            job = job if light is work[0][0] else job.under(light)
            outputs, lit = [], list(job.shaded())
            for shaded, folder in zip(lit, folders, strict=True):
                outputs.append(FrameFolder(self.request, folder, job, shaded, messages))
            frames = LitFrames(self.request, job, lit)
            for frame in self._left(outputs):
                started, state, splats = time.monotonic(), self._states[frame.number], frame_splats(frame)
                if splats is None:
                    continue
                for output, shaded, relit in zip(outputs, lit, frames.relit(frame, splats, state), strict=True):
                    picture = frames.picture(relit, shaded) if output.pictured else None
                    output.write(frame, relit, state, picture, started)
                    started = time.monotonic()
            notes = [output.film(self.frames, self.request.fps) for output in outputs if output.pictured]
            self.notes.extend(note for note in dict.fromkeys(notes) if note)
            for output, shaded in zip(outputs, lit, strict=True) if self._paged else ():
                with self._stages.stage("write"):
                    behind = shaded.exposure * shaded.backdrop
                    output.page(self.frames, Played(job.known.scene, shaded.sky, behind, self.request.fps, self._title))
            reports += [output.report for output in outputs]
        return reports, job

    def _left(self, outputs: "list[FrameFolder]") -> Iterator[SplatFrame]:
        """Frames that some output lacks."""
        with self._stages.stage("frames", len(self.frames)) as advance:
            for frame in self.frames:
                if not all(output.has(frame) for output in outputs):
                    yield frame
                advance(1)


class FrameFolder:
    """The folder of a light: a splat for each frame, by the name of its file, and the report, which says of each what
    it was made from. It is written after each frame, so that an interrupted run goes on there. pictured: whether each
    frame has a picture too. Raises InputError where it holds results of other settings that may not be replaced."""

    def __init__(self, request: RelightRequest, folder: Path, job: Job, shaded: Shaded, messages: list[str]) -> None:
        settings = settings_of(request, job.request.light, shaded.light.rotation_deg)
        kept = Earlier(folder, settings, request.overwrite).kept.get("frames")
        self.report = {**report_of(job, shaded), "settings": settings, "frames": kept if isinstance(kept, dict) else {}}
        self._folder, self._messages, self.pictured = folder, messages, "png" in (request.formats or ())
        folder.mkdir(parents=True, exist_ok=True)
        self._save()

    def has(self, frame: SplatFrame) -> bool:
        """Whether the frame was written, from the file as it is now."""
        entry = self.report["frames"].get(frame.path.name)
        if not isinstance(entry, dict) or entry.get("sha256") != fingerprint(frame.path):
            return False
        wanted = ("file", "picture") if self.pictured else ("file",)
        return all((self._folder / str(entry.get(kind))).is_file() for kind in wanted)

    def film(self, frames: list[SplatFrame], fps: float) -> str:
        """Join the pictures of frames. Returns "" when it worked, else why it did not."""
        note = joined(self._files(frames, "picture"), self._folder / FILM, fps)
        self.report["film"] = None if note else FILM
        self._save()
        return note

    def page(self, frames: list[SplatFrame], played: Played) -> None:
        """Write the page that plays the relit frames."""
        self.report["page"] = write_player(self._folder, map(read_splats, self._files(frames, "file")), played)
        self._save()

    def _files(self, frames: list[SplatFrame], kind: str) -> list[Path]:
        names = [self.report["frames"].get(frame.path.name, {}).get(kind) for frame in frames]
        return [self._folder / name for name in names if name]

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
