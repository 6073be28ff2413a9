"""Record a turn of the light as a film, each frame with all effects."""

import os
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from splat2mesh.base.choices import DEFAULT_FPS
from splat2mesh.base.errors import InputError

from .request import Turntable

KINDS = ".gif", ".mp4"


class Recording:
    """Take a picture whenever the light of an angle is complete, then go on to the next; the window stays usable.

    path: .gif, or .mp4 where imageio-ffmpeg is installed; by default a free name in this folder.
    Raises InputError for another kind of file and for one that cannot be written.
    """

    def __init__(
        self,
        window: Any,  # a Window
        path: str | os.PathLike[str] | None = None,
        turn: Turntable | None = None,
    ) -> None:
        free = "turn_{:04d}" + (".mp4" if find_spec("imageio_ffmpeg") else ".gif")
        path, turn = free_name(free) if path is None else Path(path), turn or Turntable()
        check_film(path, turn)
        import imageio

        self.path, self._window, self._asked = path, window, turn
        self._state, self._done = window.session.state, 0
        self._started, self.asked = time.perf_counter(), False
        self._shape: tuple[int, ...] | None = None
        window.session.change(turning=False, help=False)
        options = {"fps": DEFAULT_FPS} if path.suffix == ".mp4" else {"duration": 1000 / DEFAULT_FPS, "loop": 0}
        try:
            self._writer = imageio.get_writer(path, mode="I", **options)
        except OSError as error:
            raise InputError(f"cannot write {path}: {error}") from None

    def tick(self) -> None:
        """Take the picture of this angle if its light is complete, else wait for it."""
        session, window = self._window.session, self._window
        if session.failure:
            self.stop(session.failure)
            return
        session.change(angle_deg=self._state.angle_deg + 360.0 * self._done / self._asked.frames)
        if not session.settled:
            session.hurry()
            return
        image = window.picture(panel=False)
        self._shape = self._shape or image.shape[:2]
        self._writer.append_data(fit_to(image, self._shape))
        self._done += 1
        window.note = self._describe()
        if self._done == self._asked.frames:
            self._end()
            window.recorded(f"saved {self.path.absolute()}")

    def _describe(self) -> str:
        """The line on the window: progress, remaining time, and how to stop."""
        each = (time.perf_counter() - self._started) / self._done
        left = each * (self._asked.frames - self._done)
        ends = "q again drops it" if self.asked else "v stops it"
        return f"recording {self._done} of {self._asked.frames}, about {left:.0f} s left; {ends}"

    def stop(self, reason: str = "stopped") -> None:
        """Drop the recording."""
        self._end()
        self.path.unlink(missing_ok=True)
        self._window.recorded(f"recording dropped: {reason}")

    def _end(self) -> None:
        self._writer.close()
        self._window.session.change(angle_deg=self._state.angle_deg, turning=self._state.turning)


def fit_to(image: NDArray, shape: tuple[int, ...]) -> NDArray:
    """A picture, (H, W, 3) uint8, in the size that a film began with: cut, and filled with black, about its middle."""
    (height, width), (tall, wide) = image.shape[:2], shape
    left, top = (width - wide) // 2, (height - tall) // 2
    return np.asarray(Image.fromarray(image).crop((left, top, left + wide, top + tall)))


def check_film(path: str | os.PathLike[str], turn: Turntable) -> None:
    """Raises InputError unless a film of this name and length can be recorded."""
    path, frames = Path(path), turn.frames
    if path.suffix not in KINDS:
        raise InputError(f"{path}: a film is one of {' '.join(KINDS)}, found {path.suffix or 'no suffix'}")
    if path.suffix == ".mp4" and not find_spec("imageio_ffmpeg"):
        raise InputError(f"{path}: films in .mp4 need imageio-ffmpeg: pip install imageio-ffmpeg; or record a .gif")
    if frames != int(frames) or frames < 2:
        raise InputError(f"a film needs a whole number of frames, 2 or more, found {frames}")
    if path.exists() and not turn.overwrite:
        raise InputError(f"{path} exists: choose another name, or pass overwrite")
    if not path.parent.is_dir():
        raise InputError(f"{path}: its folder does not exist")


def free_name(pattern: str) -> Path:
    """The first path of this pattern, counted from 1, that does not exist."""
    number = 1
    while Path(pattern.format(number)).exists():
        number += 1
    return Path(pattern.format(number))
