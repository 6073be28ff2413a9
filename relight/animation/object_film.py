"""The film of animated objects in a static place: each frame retraces only their reach."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.outputs import check_output, staged_folder

from ..insert.inserts import InsertedLight, Inserts
from ..output.images import write_png
from .acting import Acting
from .film import MARKER, FilmRequest, Frames, encode, frame_times


def film_objects(
    acting: Acting,
    lit: Callable[[Inserts], InsertedLight],
    painter: Callable[[list[InsertedLight]], Callable[[InsertedLight], NDArray[np.uint8]]],
    asked: FilmRequest,
    exposure: float,
    advance: Callable[[int], Any] = lambda count: None,
    finish: Callable[[Path, Frames], Any] = lambda folder, frames: None,
) -> Frames:
    """Light and draw every frame from the time 0 to the end of the longest animation.

    lit: objects in the light of the place. painter: takes some of the poses and returns the function that draws a
    frame. The rest as of `film.animate`. Raises InputError for a folder that may not be replaced and a rate that is not
    above 0.
    """
    times = frame_times(acting.duration_s, asked.fps)
    check_output(asked.folder, asked.overwrite, MARKER)
    draw = painter([lit(pose) for pose in acting.sampled])
    with staged_folder(asked.folder, asked.overwrite, MARKER) as staging:
        for number, time_s in enumerate(times):
            write_png(staging / f"{number:04d}.png", draw(lit(acting.at(float(time_s)))))
            advance(1)
        note = encode(staging, asked.fps)
        written = Frames(len(times), not note, exposure, note)
        finish(staging, written)
    return written
