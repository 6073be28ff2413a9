"""A sequence of splats as meshes: the scene of the first frame, and a mesh of the same vertices and faces for each.

The splats carry the mesh of the first frame. What rests keeps every bit; faces that tear in any frame have corners of
their own in all, and lie at one point where they are torn.
"""

import os
import warnings
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .base.arrays import Mask
from .base.errors import DataWarning, InputError
from .base.progress import Stages
from .capture import capture_of
from .options import ConvertOptions
from .pipeline import meshed
from .scene.drawn import Drawn
from .scene.mesh import Mesh
from .scene.morphs import PlayedGlb, glb_of
from .scene.scene import Scene
from .splats.cleaning import sound
from .splats.frames import ALONE, MOVING, SplatFrame, frame_splats, frames_in, state_of, step_of
from .splats.splats import INVISIBLE_OPACITY, Splats
from .surface.carried import Carrier

FRAMES, PLAYED = "frames", "sequence.glb"
"""In the scene folder: the folder of a mesh for each frame, and the file that plays them."""


class Change(NamedTuple):
    """What a frame changes of the first mesh: rows (R,) of its vertices, vertices and normals (R, 3) there, and the
    numbers of the faces that tear."""

    rows: NDArray[np.intp]
    vertices: NDArray[np.float32]
    normals: NDArray[np.float32]
    torn: NDArray[np.intp]


class FrameMeshes:
    """The meshes of the frames in a folder. scene: of the first. states: of each frame, as of `frames.state_of`.

    Raises InputError for a folder that is no sequence, and where none of its frames can be read or meshed.
    """

    def __init__(self, folder: str | os.PathLike[str], asked: ConvertOptions, stages: Stages) -> None:
        self._asked, self._stages = asked, stages
        frames = frames_in(folder)
        first = next((frame for frame in frames if frame_splats(frame) is not None), None)
        if first is None:
            raise InputError(f"`sequence`: {folder} holds no frame that can be read")
        capture = capture_of(first.path, asked, stages)
        self.scene = meshed(first.path, capture, asked, stages)
        self._first, self._drawn = capture.loaded, Drawn(self.scene).scene
        self.states: dict[SplatFrame, str] = {}
        self._changes: dict[SplatFrame, Change] = {}
        with stages.stage("frames", len(frames)) as advance:
            for frame in frames[frames.index(first) :]:
                splats = self._first if frame is first else frame_splats(frame)
                if splats is not None:
                    self._add(frame, splats)
                advance(1)

    def _add(self, frame: SplatFrame, splats: Splats) -> None:
        self.states[frame] = state_of(splats, self._first)
        if self.states[frame] == MOVING:
            pose = self._carrier.at(splats)
            vertices, normals = pose.vertices(self._drawn, np.arange(self._drawn.vertex_count))
            rows, torn = np.flatnonzero(pose.moved), np.flatnonzero(pose.torn(self._drawn.faces))
            self._changes[frame] = Change(rows, vertices[rows], normals[rows], torn)

    @cached_property
    def _carrier(self) -> Carrier:
        back = np.linalg.inv(np.asarray(self.scene.scene_from_splat, np.float64))
        points = (self._drawn.vertices @ back[:3, :3].T + back[:3, 3]).astype(np.float32)
        normals = (self._drawn.normals @ back[:3, :3].T).astype(np.float32)
        seen = sound(self._first) & (self._first.opacities >= INVISIBLE_OPACITY)
        seen[self.scene.background_splats] = False
        return Carrier(points, normals, self.scene.diagonal, self._first, np.flatnonzero(seen))

    @property
    def alone(self) -> int:
        """How many frames have splats, and so a mesh, of their own."""
        return list(self.states.values()).count(ALONE)

    def write(self, folder: Path, fps: float) -> None:
        """Write a mesh for each frame and, where none has one of its own and any moves, the file that plays them."""
        (folder / FRAMES).mkdir()
        played = PlayedGlb(self._chunks_at(None)) if self._changes and not self.alone else None
        with self._stages.stage("write frames", len(self.states)) as advance:
            for number, frame in enumerate(self.states):
                own = self.states[frame] == ALONE
                chunks = self._alone(frame) if own else self._chunks_at(self._changes.get(frame))
                if chunks:
                    glb_of(chunks).save(folder / FRAMES / f"{frame.path.stem}.glb")
                if played is not None and number:
                    played.add(chunks)
                advance(1)
        if played is not None:
            numbers = [frame.number for frame in self.states]
            times = (np.array(numbers) - numbers[0]) / step_of(numbers) / fps
            (folder / PLAYED).write_bytes(played.content(times))

    @cached_property
    def _apart(self) -> Mask:
        """(F,) bool: the faces that tear in any frame."""
        apart = np.zeros(len(self._drawn.faces), bool)
        for change in self._changes.values():
            apart[change.torn] = True
        return apart

    def _chunks_at(self, change: Change | None) -> list[Mesh]:
        """The chunks of a frame, those of the first one without a change."""
        drawn, torn = self._drawn, np.zeros_like(self._apart)
        vertices, normals = drawn.vertices.copy(), drawn.normals.copy()
        if change is not None:
            vertices[change.rows], normals[change.rows], torn[change.torn] = change.vertices, change.normals, True
        chunks, start, first = [], 0, 0
        for chunk in drawn.chunks:
            count, numbers = len(chunk.vertices), slice(first, first + len(chunk.faces))
            apart = np.flatnonzero(self._apart[numbers])
            corners, faces = chunk.faces[apart], chunk.faces.copy()
            faces[apart] = count + np.arange(3 * len(apart)).reshape(-1, 3)
            lost = torn[numbers][apart]
            corners[lost] = corners[lost, :1]
            rows = np.concatenate([np.arange(count), corners.ravel()])
            colors = np.concatenate([chunk.colors_srgb, chunk.colors_srgb[chunk.faces[apart].ravel()]])
            chunks.append(Mesh(vertices[start + rows], normals[start + rows], faces, colors))
            start, first = start + count, numbers.stop
        return chunks

    def _alone(self, frame: SplatFrame) -> list[Mesh]:
        """The chunks of a frame with splats of its own; none, with a DataWarning, where it cannot be meshed."""
        try:
            return Drawn(meshed_like(self.scene, frame.path, self._asked, self._stages)).scene.chunks
        except InputError as error:
            warnings.warn(f"frame {frame.number} is left out: {error}", DataWarning, stacklevel=2)
            return []

    def lines(self, output: Path) -> list[str]:
        """Lines of a summary."""
        count, seconds = len(self.states), sum(self._stages.seconds[label] for label in ("frames", "write frames"))
        moving = list(self.states.values()).count(MOVING)
        lines = [f"  {output / FRAMES}: {count} meshes, {moving} of which move, {seconds / count:.2f} s each"]
        if self.alone:
            lines.append(
                f"  {self.alone} of {count} frames have splats of their own: each is meshed alone; no {PLAYED}"
            )
        elif not moving:
            lines.append(f"  nothing moves: no {PLAYED}")
        else:
            lines.append(f"  {output / PLAYED}: plays them, {os.path.getsize(output / PLAYED) / 1e6:.1f} MB")
        return lines

    def report(self) -> dict[str, Any]:
        """What was written, JSON-clean."""
        frames = {frame.path.name: state for frame, state in self.states.items()}
        return {"frames": frames, "played": bool(self._changes) and not self.alone}


def meshed_like(first: Scene, path: Path, asked: ConvertOptions, stages: Stages) -> Scene:
    """The scene of another frame, meshed by itself, with the axes of the first. Errors as of `api.convert`."""
    capture = replace(capture_of(path, asked, stages), rotation=np.asarray(first.scene_from_splat, np.float64))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # the first frame has warned of the same
        return meshed(path, capture, asked, stages)
