"""The frames of a sequence: numbered splat files of one format in a folder. How each is to the first."""

import math
import os
import re
import warnings
from collections import Counter
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ..base.arrays import Mask
from ..base.errors import DataWarning, InputError
from .cleaning import sound
from .formats import read_splats
from .formats.register import BY_KIND
from .splats import INVISIBLE_OPACITY, Splats

AT_REST, MOVING, ALONE = "at rest", "moving", "alone"
"""What mesh a frame has: that of the first, the same as the splats carry it, one of its own."""

_NUMBER = re.compile(r"(.*?)(\d+)", re.DOTALL)
_SUFFIXES = {suffix: kind for kind, each in BY_KIND.items() for suffix in each.suffixes if each.read is not None}


@dataclass(frozen=True)
class SplatFrame:
    """A file of a sequence. kind: of its format."""

    number: int
    path: Path
    kind: str


def frames_in(folder: str | os.PathLike[str]) -> list[SplatFrame]:
    """The frames in a folder, in order.

    Raises InputError for a folder without two frames, with files of several formats, or with several sequences. Warns
    with a DataWarning about splat files without a number, and about numbers that are missing.
    """
    if not Path(folder).is_dir():
        raise InputError(f"`sequence`: expected a folder of numbered splat files, found {folder}")
    found, unnumbered = _by_name(Path(folder))
    if not found:
        raise InputError(f"`sequence`: {folder} holds no numbered splat files, such as frame_0001.ply")
    if len(found) > 1:
        names = " and ".join(f"{frames[0].path.name} ({len(frames)})" for frames in list(found.values())[:2])
        raise InputError(f"`sequence`: {folder} holds {len(found)} sequences, {names}; give each a folder of its own")
    (frames,) = found.values()
    frames = sorted(frames, key=lambda frame: frame.number)
    _check_one_each(folder, frames)
    if unnumbered:
        message = f"{folder}: splat files without a number are no frames, and left out: {' '.join(unnumbered)}"
        warnings.warn(message, DataWarning, stacklevel=2)
    _warn_of_gaps(folder, [frame.number for frame in frames])
    return frames


def _by_name(folder: Path) -> tuple[dict[str, list[SplatFrame]], list[str]]:
    """The numbered splat files in a folder, by what stands before the number, and the names of the others."""
    found: dict[str, list[SplatFrame]] = {}
    unnumbered = []
    for path in sorted(folder.iterdir()):
        suffix = next((s for s in sorted(_SUFFIXES, key=len, reverse=True) if path.name.lower().endswith(s)), None)
        if suffix is None or not path.is_file() or path.name.startswith("."):
            continue
        match = _NUMBER.fullmatch(path.name[: -len(suffix)])
        if match is None:
            unnumbered.append(path.name)
        else:
            found.setdefault(match[1], []).append(SplatFrame(int(match[2]), path, _SUFFIXES[suffix]))
    return found, unnumbered


def _check_one_each(folder: str | os.PathLike[str], frames: list[SplatFrame]) -> None:
    """Raise InputError for frames, in order, of several formats, for two of one number, and for a single one."""
    kinds = Counter(frame.kind for frame in frames)
    if len(kinds) > 1:
        counts = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
        raise InputError(f"`sequence`: {folder} holds frames of several formats ({counts}); expected one")
    twice = next((second for first, second in pairwise(frames) if first.number == second.number), None)
    if twice is not None:
        raise InputError(f"`sequence`: {folder} holds frame {twice.number} twice")
    if len(frames) < 2:
        raise InputError(f"`sequence`: {folder} holds one frame; expected two or more")


def _warn_of_gaps(folder: str | os.PathLike[str], numbers: list[int]) -> None:
    """Warn of numbers that are missing, where the others are so many apart."""
    step = step_of(numbers)
    gaps = [(first + step, second - step) for first, second in pairwise(numbers) if second - first > step]
    if gaps:
        words = ", ".join(str(low) if low == high else f"{low} to {high}" for low, high in gaps[:8])
        more = f" and {len(gaps) - 8} more gaps" if len(gaps) > 8 else ""
        warnings.warn(f"{folder}: frames are missing: {words}{more}; the others are kept", DataWarning, stacklevel=3)


def step_of(numbers: list[int]) -> int:
    """How far apart the numbers of frames are: 1 for a single one."""
    return math.gcd(*(second - first for first, second in pairwise(numbers))) or 1


def frame_splats(frame: SplatFrame) -> Splats | None:
    """The splats of a frame; None, with a DataWarning, where it cannot be read."""
    try:
        return read_splats(frame.path)
    except InputError as error:
        warnings.warn(f"frame {frame.number} is left out: {error}", DataWarning, stacklevel=2)
        return None


def has_moved(splats: Splats, first: Splats) -> Mask:
    """(N,) bool: which of Splats are seen and have moved, row by row, by more than their standard deviation along their
    longest axis."""
    far = ((splats.means.astype(float) - first.means) ** 2).sum(axis=1)
    return np.asarray((far > first.scales.max(axis=1).astype(float) ** 2) & (first.opacities >= INVISIBLE_OPACITY))


def state_of(splats: Splats, first: Splats) -> str:
    """How a frame is to the first one: ALONE where it has other rows, MOVING where any has moved, else AT_REST."""
    whole = sound(first)
    if splats.sh.shape != first.sh.shape or not (whole == sound(splats)).all():
        return ALONE
    return MOVING if has_moved(splats.take(whole), first.take(whole)).any() else AT_REST
