"""Usable splats: which rows of a file are usable, and the repair or removal of the others."""

import warnings
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..base.errors import DataWarning, InputError
from .splats import ABSURD_LENGTH, FLATTEST, INVISIBLE_OPACITY, MIN_SPLATS, NUMBERS, Splats

REASONS = {
    "non_finite": "a NaN or infinite value",
    "absurd": "a position or scale out of any useful range",
    "zero_quaternion": "a zero quaternion",
    "invisible": "an opacity below 1/255",
}
"""Why splats are dropped, by the names of their counts."""


def usable(splats: Splats) -> tuple[NDArray[np.bool_], dict[str, int]]:
    """Find the splats that `clean` keeps. Returns keep: (N,) bool; counts: those that are dropped, by reason; each
    counts once."""
    counts, keep = {}, np.ones(len(splats), bool)
    for name, rows in _faults(splats).items():
        counts[name] = int(np.count_nonzero(rows & keep))
        keep &= ~rows
    return keep, counts


def sound(splats: Splats) -> NDArray[np.bool_]:
    """Find the splats whose centre, scales, rotation and colour can be used, however faint they are: (N,) bool."""
    return ~np.logical_or.reduce([rows for name, rows in _faults(splats).items() if name != "invisible"])


def _faults(splats: Splats) -> dict[str, NDArray[np.bool_]]:
    """Which splats have which fault, (N,) bool each."""
    finite = np.ones(len(splats), bool)
    for value in (getattr(splats, name) for name in NUMBERS):
        if not np.isfinite([value.min(initial=0.0), value.max(initial=0.0)]).all():  # NaN passes through both
            finite &= np.isfinite(value).all(axis=tuple(range(1, value.ndim)))
    with np.errstate(invalid="ignore"):
        # Column by column: along rows of three it takes ten times as long.
        least, largest = (each.reduce([*splats.scales.T]) for each in (np.minimum, np.maximum))
        too_large = (np.maximum.reduce([*np.abs(splats.means.T)]) > ABSURD_LENGTH) | (largest > ABSURD_LENGTH)
        return {
            "non_finite": ~finite,
            "absurd": too_large | (least < 0) | (largest <= 0),
            "zero_quaternion": ~splats.quats_wxyz.any(axis=1),
            "invisible": splats.opacities < INVISIBLE_OPACITY,
        }


def clean(splats: Splats) -> tuple[Splats, dict[str, int]]:
    """Drop the splats that cannot be used.

    splats: as a file has them. Returns splats: those that are left. A zero scale beside a positive one is raised to
    `FLATTEST` of the largest; counts: those dropped, each counted once: `non_finite` (a NaN or an infinity in any
    field), `absurd` (a coordinate or scale beyond `ABSURD_LENGTH`, a negative scale, or no extent at all),
    `zero_quaternion`, and `invisible` (opacity below 1/255: normal in trained files). Raises InputError when fewer than
    `MIN_SPLATS` remain. Warns with a DataWarning about all that are dropped but the invisible, and about those that
    were thickened.
    """
    keep, counts = usable(splats)
    kept = splats if keep.all() else splats.take(keep)
    if len(kept) < MIN_SPLATS:
        lost = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in counts.items() if count)
        raise InputError(
            f"{len(kept)} of {len(splats)} splats are usable ({lost or 'none dropped'}), "
            f"at least {MIN_SPLATS} are needed: check that the file holds a trained splat"
        )
    say_dropped(counts, len(splats))
    return _thickened(kept), counts


def _thickened(splats: Splats) -> Splats:
    flat = (splats.scales == 0).any(axis=1)
    if not flat.any():
        return splats
    scales = np.maximum(splats.scales, np.where(flat, FLATTEST * splats.scales.max(axis=1), 0)[:, None])
    warnings.warn(f"thickened {np.count_nonzero(flat)} splats with a scale of zero", DataWarning, stacklevel=3)
    return replace(splats, scales=scales)


def say_dropped(counts: Mapping[str, int], total: int) -> None:
    """Give one DataWarning of broken splats. counts: by reason; that of the invisible, which are usual, is not said."""
    parts = [f"{counts[name]} with {why}" for name, why in REASONS.items() if counts[name] and name != "invisible"]
    if parts:
        warnings.warn(f"dropped splats: {', '.join(parts)} (of {total})", DataWarning, stacklevel=3)
