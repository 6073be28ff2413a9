"""Measured distributions of light: IESNA LM-63 of 1986, 1991, 1995 and 2002, photometry of type C, without a tilt.

Source: ANSI/IESNA LM-63-02, "Standard File Format for the Electronic Transfer of Photometric Data".
"""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import InputError
from splat2mesh.base.inputs import LARGEST_TEXT, file_size

from ..light import MOST_RADIANCE

_TYPES = {1: "C", 2: "B", 3: "A"}
_TILT = re.compile(r"\s*TILT\s*=", re.IGNORECASE)
_AFTER_TILT = 13
"""Numbers between TILT and the angles."""


@dataclass(frozen=True, eq=False)
class Profile:
    """A distribution of light about an axis.

    vertical_deg (A,): angles to the axis, from 0, which points down as a lamp hangs. horizontal_deg (B,): about it,
    from 0 to 360. table (A, B): relative, at most 1. candela: where the table says 1.
    """

    vertical_deg: NDArray[np.float64]
    horizontal_deg: NDArray[np.float64]
    table: NDArray[np.float64]
    candela: float


def read_profile(path: str | os.PathLike[str]) -> Profile:
    """The profile of an .ies file, all round: what its symmetry leaves out is filled in.

    Candela are multiplied by the multiplier and the ballast factor of the file. Raises InputError for another kind of
    file, for photometry of type A or B, for a tilt, and for what is broken.
    """
    if file_size(path, ".ies file") > LARGEST_TEXT:
        raise InputError(f"{path} takes over {LARGEST_TEXT >> 20} MB: too large for an IES profile")
    text = Path(path).read_bytes().decode("latin-1").replace("\0", "").replace("\x1a", "")
    try:
        return _parsed(text)
    except ValueError as error:
        raise InputError(f"{path}: not a readable IES profile: {error}") from None


def _parsed(text: str) -> Profile:
    """Raises ValueError that says what is wrong."""
    lines = text.splitlines()
    numbers = _numbers(_after_tilt(lines))
    if len(numbers) < _AFTER_TILT:
        raise ValueError(f"it ends after {len(numbers)} numbers")
    verticals, horizontals = _counts(numbers)
    across = _AFTER_TILT + verticals
    around = across + horizontals
    vertical, horizontal = _angles(numbers[_AFTER_TILT:across], 180.0), _angles(numbers[across:around], 360.0)
    multiplier, (ballast, second) = numbers[2], numbers[10:12]
    # The second factor belongs to the ballast until 1991; since then its place is for future use.
    since_1995 = lines[0].strip().upper().startswith(("IESNA:LM-63", "IES:LM-63"))
    candela = (
        numbers[around:].reshape(horizontals, verticals).T * multiplier * ballast * (1.0 if since_1995 else second)
    )
    if candela.min() < 0.0 or not candela.max() <= MOST_RADIANCE:
        raise ValueError(f"its candela go from {candela.min():g} to {candela.max():g}")
    if candela.max() == 0.0:
        raise ValueError("it gives no light")
    horizontal, candela = _all_round(horizontal, candela)
    if vertical[0] > 0.0:
        vertical = np.concatenate([[0.0, np.nextafter(vertical[0], 0.0)], vertical])
        candela = np.concatenate([np.zeros((2, len(horizontal))), candela])
    return Profile(vertical, horizontal, candela / candela.max(), float(candela.max()))


def _after_tilt(lines: list[str]) -> list[str]:
    """The words after TILT=NONE; before it, any words until 1986."""
    tilts = [number for number, line in enumerate(lines) if _TILT.match(line)]
    if not tilts:
        raise ValueError("it has no line TILT=")
    tilt = next((number for number in tilts if _untilted(lines[number])), tilts[0])
    if not _untilted(lines[tilt]):
        raise ValueError(f"expected TILT=NONE, found {lines[tilt].strip()[:40]}")
    return " ".join(lines[tilt + 1 :]).replace(",", " ").split()


def _counts(numbers: NDArray[np.float64]) -> tuple[int, int]:
    """How many vertical and horizontal angles follow, for a table of which every number is there."""
    verticals, horizontals, kind = numbers[3:6].tolist()
    if kind not in _TYPES:
        raise ValueError(f"its photometric type is {kind:g}")
    if kind != 1:
        raise ValueError(f"its photometry is of type {_TYPES[int(kind)]}, expected C")
    if not (verticals.is_integer() and horizontals.is_integer() and verticals >= 2 and horizontals >= 1):
        raise ValueError(f"it announces {verticals:g} vertical and {horizontals:g} horizontal angles")
    count = _AFTER_TILT + verticals + horizontals + verticals * horizontals
    if len(numbers) != count:
        raise ValueError(f"it announces {count:.0f} numbers, found {len(numbers)}")
    return int(verticals), int(horizontals)


def _untilted(line: str) -> bool:
    return "".join(line.split()).upper() == "TILT=NONE"


def _numbers(words: list[str]) -> NDArray[np.float64]:
    """Raises ValueError that names the first word that is no finite number."""
    for word in words:
        try:
            if np.isfinite(float(word)):
                continue
        except ValueError:
            pass
        raise ValueError(f"expected numbers after TILT, found {word[:40]}")
    return np.array(words, np.float64)


def _angles(angles: NDArray[np.float64], most: float) -> NDArray[np.float64]:
    if angles[0] < 0.0 or angles[-1] > most or not (np.diff(angles) > 0.0).all():
        raise ValueError(f"expected rising angles from 0 to {most:g}, found {angles[0]:g} to {angles[-1]:g}")
    return angles


def _all_round(angle: NDArray[np.float64], candela: NDArray[np.float64]) -> tuple[NDArray, NDArray]:
    """Horizontal angles from 0 to 360 and their columns: by the symmetry that the last angle gives."""
    first, last = angle[0], angle[-1]
    if len(angle) == 1:
        return np.array([0.0, 360.0]), np.repeat(candela, 2, axis=1)
    if first == 90.0 and last == 270.0:  # on both sides of the plane through 90 and 270
        return _joined([angle, 180.0 - angle], [candela, candela])
    if first != 0.0:
        raise ValueError(f"its horizontal angles begin at {first:g}, expected 0")
    if last == 90.0:
        return _joined([angle, 180.0 - angle, 180.0 + angle, -angle], [candela] * 4)
    if last == 180.0:
        return _joined([angle, -angle], [candela] * 2)
    if last <= 180.0:
        raise ValueError(f"its horizontal angles end at {last:g}, expected 0, 90, 180 or 360")
    if last == 360.0:
        return angle, candela
    return _joined([angle], [candela])


def _joined(angles: list[NDArray], columns: list[NDArray]) -> tuple[NDArray, NDArray]:
    """Columns by their angle, each once, and the first again at 360."""
    every, column = np.concatenate(angles) % 360.0, np.concatenate(columns, axis=1)
    angle, first = np.unique(every, return_index=True)
    table = column[:, first]
    if angle[0] > 0.0:  # between the last and the first
        share = angle[0] / (angle[0] + 360.0 - angle[-1])
        start = (1.0 - share) * table[:, :1] + share * table[:, -1:]
        angle, table = np.concatenate([[0.0], angle]), np.concatenate([start, table], axis=1)
    return np.append(angle, 360.0), np.concatenate([table, table[:, :1]], axis=1)
