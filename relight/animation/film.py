"""Draw the frames of an animation as NNNN.png, and encode them as a film where there is an encoder."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Floats, Radiance
from splat2mesh.base.choices import DEFAULT_FPS, MOST_STEPS
from splat2mesh.base.errors import InputError
from splat2mesh.base.gltf import GltfData
from splat2mesh.base.outputs import check_output, staged_file, staged_folder
from splat2mesh.scene.mesh import Mesh, unit
from splat2mesh.scene.scene import Scene

from ..insert.asked import AskedInsert
from ..insert.inserts import InsertedLight, Inserts
from ..insert.objects import InsertedObject, Part
from ..light.environment import Environment
from ..light.tonemap import auto_exposure
from ..output.images import write_png
from ..output.preview import Preview, default_camera
from .animation import POSES, Animation

FILM = "animation.mp4"
MARKER = "0000.png"
"""Only folders that hold this file are replaced."""


class Frames(NamedTuple):
    """The results of `animate`. frames: their number. film: whether there is a FILM. exposure: the factor used.

    note: why there is no film, or "".
    """

    frames: int
    film: bool
    exposure: float
    note: str


@dataclass(frozen=True)
class FilmRequest:
    """The destination of a film. folder: of its pictures. fps: pictures per second. overwrite: replace an existing
    film. encoded: make a FILM of the pictures too."""

    folder: str | os.PathLike[str]
    fps: float = DEFAULT_FPS
    overwrite: bool = False
    encoded: bool = True


@dataclass(frozen=True)
class Shot:
    """How a picture is taken. camera: as of `preview`; one that holds the whole motion without. width, height: pixels.
    samples: along the side of one. exposure: that of the first frame without."""

    camera: dict[str, Any] | None = None
    width: int = 640
    height: int = 480
    samples: int = 2
    exposure: float | None = None


class Acting:
    """Inserts of which some move.

    first: their first pose, in which they are placed. duration_s: of the longest animation; those that end before hold
    their last pose. name: of the first animation.
    Raises InputError where none has an animation.
    """

    def __init__(self, inserts: Inserts) -> None:
        self._rest = inserts
        self._animations = [_animation(asked) for asked in inserts.asked]
        found = [each for each in self._animations if each is not None]
        if not found:
            raise InputError("`animated`: no inserted object has an animation; leave it out")
        self.duration_s = max(each.duration_s for each in found)
        self.name = found[0].name
        self.first = inserts.posed(self._objects(0.0), anew=True)

    def at(self, time_s: float) -> Inserts:
        """The objects at a time."""
        return self.first.posed(self._objects(time_s))

    def _objects(self, time_s: float) -> list[InsertedObject]:
        pairs = zip(self._rest.objects, self._animations, strict=True)
        return [each if animation is None else _posed(each, animation, time_s) for each, animation in pairs]

    @property
    def sampled(self) -> list[Inserts]:
        """The objects in some poses, evenly over the time."""
        return [self.at(float(time_s)) for time_s in np.linspace(0.0, self.duration_s, POSES)]


def _animation(asked: AskedInsert) -> Animation | None:
    source = asked.source
    if isinstance(source, Mesh) or Path(source).suffix.lower() not in (".glb", ".gltf"):
        return None
    return Animation(str(source)) if GltfData(str(source)).document.animations else None


def _posed(each: InsertedObject, animation: Animation, time_s: float) -> InsertedObject:
    poses: dict[int, list[tuple[NDArray[np.float32], NDArray[np.float32]]]] = {}
    for chunk, pose in zip(animation.chunks, animation.at(time_s), strict=True):
        poses.setdefault(chunk.node, []).append(pose)
    return replace(each, parts=[_part(part, poses[part.node].pop(0)) for part in each.parts if part.node is not None])


def _part(part: Part, pose: tuple[NDArray[np.float32], NDArray[np.float32]]) -> Part:
    vertices, normals = pose
    return replace(part, vertices=part.carried(vertices), normals=unit(part.carried(normals)).astype(np.float32))


def animate(
    animation: Animation,
    radiance_of: Callable[[Scene, float], Radiance],  # of each frame's Scene and time in s: (V, 3) linear radiance
    environment: Environment,  # shown behind; see `Preview.render`
    asked: FilmRequest,
    shot: Shot = Shot(),
    advance: Callable[[int], Any] = lambda count: None,
    finish: Callable[[Path, Frames], Any] = lambda folder, frames: None,  # called with the folder before it appears
) -> Frames:
    """Light and draw every frame from the time 0 to the animation's end: Frames.

    Raises InputError for a folder that is not to be replaced and a rate that is not above 0; an encoder that fails is
    no error: the pictures are there.
    """
    times = frame_times(animation.duration_s, asked.fps)
    check_output(asked.folder, asked.overwrite, MARKER)
    camera, exposure = shot.camera or fitted_camera(animation, shot.width / shot.height), shot.exposure

    def drawn(time_s: float) -> tuple[NDArray[np.uint8], float]:
        nonlocal exposure
        scene = animation.frame(time_s)
        radiance = radiance_of(scene, time_s)
        exposure = auto_exposure(radiance) if exposure is None else exposure
        picture = Preview(scene, camera, shot.width, shot.height, shot.samples)
        return picture.render(radiance, environment, exposure), exposure

    return _filmed(drawn, times, asked, advance, finish)


def film_objects(
    acting: Acting,
    lit: Callable[[Inserts], InsertedLight],  # objects in the light of the place
    painter: Callable[[list[InsertedLight]], Callable[[InsertedLight], NDArray[np.uint8]]],  # of some of the poses
    asked: FilmRequest,
    exposure: float,
    advance: Callable[[int], Any] = lambda count: None,
    finish: Callable[[Path, Frames], Any] = lambda folder, frames: None,
) -> Frames:
    """The same of animated objects in a static place, to the end of the longest animation: each frame retraces only
    their reach. painter: returns the function that draws a frame. The rest as of `animate`."""
    times = frame_times(acting.duration_s, asked.fps)
    check_output(asked.folder, asked.overwrite, MARKER)
    draw = painter([lit(pose) for pose in acting.sampled])
    return _filmed(lambda time_s: (draw(lit(acting.at(time_s))), exposure), times, asked, advance, finish)


def _filmed(
    drawn: Callable[[float], tuple[NDArray[np.uint8], float]],  # picture and exposure of a time
    times: Floats,  # s
    asked: FilmRequest,
    advance: Callable[[int], Any],
    finish: Callable[[Path, Frames], Any],
) -> Frames:
    exposure = 1.0
    with staged_folder(asked.folder, asked.overwrite, MARKER) as staging:
        for number, time_s in enumerate(times):
            picture, exposure = drawn(float(time_s))
            write_png(staging / f"{number:04d}.png", picture)
            advance(1)
        note = encode(staging, asked.fps) if asked.encoded else ""
        written = Frames(len(times), asked.encoded and not note, float(exposure), note)
        finish(staging, written)
    return written


def frame_times(duration_s: float, fps: float) -> NDArray[np.float64]:
    """Times of the frames, s: from 0 on, the last one not after the end. Raises InputError for a rate not above 0."""
    if not (np.isfinite(fps) and fps > 0.0):
        raise InputError(f"frames per second must be above 0, found {fps}")
    count = int(np.floor(duration_s * fps + 1e-6)) + 1
    if count > MOST_STEPS:
        raise InputError(f"{duration_s:g} s at {fps:g} frames a second are {count} frames; expected up to {MOST_STEPS}")
    return np.arange(count) / fps


def fitted_camera(animation: Animation, aspect: float) -> dict:
    """The default camera for all vertices of 16 poses of the animation."""
    times = np.linspace(0.0, animation.duration_s, POSES)
    points = np.concatenate([vertices for time_s in times for vertices, _ in animation.at(time_s)])
    nothing = np.zeros((0, 3), np.int32)
    swept = Scene([Mesh(points, np.zeros_like(points), nothing, np.zeros(points.shape, np.uint8))])
    return default_camera(swept, aspect)


def encoder() -> str | None:
    """The path of an ffmpeg, on the PATH or that of imageio-ffmpeg, or None."""
    found = shutil.which("ffmpeg")
    if found is None and find_spec("imageio_ffmpeg"):
        import imageio_ffmpeg

        found = imageio_ffmpeg.get_ffmpeg_exe()
    return found


def joined(pictures: Sequence[Path], target: Path, fps: float) -> str:
    """Encode pictures, in order, as a film, which is replaced. Returns "" when it worked, else why it did not."""
    with tempfile.TemporaryDirectory() as work:
        for number, picture in enumerate(pictures):
            shutil.copy(picture, Path(work) / f"{number:04d}.png")
        note = encode(Path(work), fps)
        if not note:
            with staged_file(target) as staging:
                shutil.copy(Path(work) / FILM, staging)
    return note


def encode(folder: Path, fps: float) -> str:
    """Encode the frames in a folder as FILM. Returns "" when it worked, else why it did not."""
    ffmpeg = encoder()
    if ffmpeg is None:
        return f"no {FILM}: install ffmpeg, or imageio-ffmpeg with pip, or join the pictures with another tool"
    # H.264 in 4:2:0 needs even sizes: a column or row is repeated where it must.
    even = "pad=ceil(iw/2)*2:ceil(ih/2)*2"
    command = [ffmpeg, "-v", "error", "-y", "-framerate", f"{fps:g}", "-i", "%04d.png", "-vf", even]
    command += ["-c:v", "libx264", "-pix_fmt", "yuv420p", FILM]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode == 0 and (folder / FILM).is_file():
        return ""
    (folder / FILM).unlink(missing_ok=True)
    reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
    return f"no {FILM}: {ffmpeg} failed ({reason}); the pictures are complete"
