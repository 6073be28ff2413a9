"""What a folder of splat files means: the output of a trainer, or tiles of one capture, which hardly overlap."""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InputError
from ..splats import Splats

SAME_PLACE = 0.5
"""Share of the space of two files, together, that both fill, from which they show the same: two checkpoints have .9 and
more, tiles that overlap by a tenth of their sides .05."""

_ITERATION = re.compile(r"^iteration_(\d+)$")


def trained_in(folder: Path) -> list[Path]:
    """Find the checkpoints in the output folder of INRIA's trainer, or in its folder point_cloud, oldest first. Returns
    a list of Path of point_cloud.ply files; empty for any other folder."""
    found = {}
    for above in (folder / "point_cloud", folder):
        for each in above.iterdir() if above.is_dir() else ():
            match, file = _ITERATION.match(each.name), each / "point_cloud.ply"
            if match and file.is_file():
                found[int(match[1])] = file
        if found:
            break
    return [found[number] for number in sorted(found)]


def check_tiles(folder: Path, tiles: Mapping[Path, Splats]) -> None:
    """Check that files lie side by side. folder: for the message. tiles: at least one. Raises InputError for two in the
    same place: checkpoints, formats or frames of one capture, or other things."""
    paths, bounds = list(tiles), np.stack([_bounds(splats) for splats in tiles.values()])
    # Flat ones get a thickness, so they have a volume.
    pad = 1e-3 * max(float(np.linalg.norm(bounds[:, 1] - bounds[:, 0], axis=1).max()), 1e-12)
    low, high = bounds[:, 0] - pad, bounds[:, 1] + pad
    volume = np.prod(high - low, axis=1)
    for i in range(1, len(paths)):
        shared = np.prod(np.maximum(np.minimum(high[i], high[:i]) - np.maximum(low[i], low[:i]), 0), axis=1)
        same = np.flatnonzero(shared > SAME_PLACE * (volume[i] + volume[:i] - shared))
        if len(same):
            newest = max((paths[i], *(paths[other] for other in same)), key=lambda path: path.stat().st_mtime_ns)
            raise InputError(
                f"{folder}: {paths[same[0]].name} and {paths[i].name} lie in the same place, so they are no tiles of "
                f"one capture: give one file, such as the newest, {newest}"
            )


def _bounds(splats: Splats) -> NDArray[np.float64]:
    """(2, 3) of what lies within the first and last percent of each axis: what floats about does not count."""
    places = splats.means[:: 1 + len(splats) // 4096].astype(np.float64)
    places = places[np.isfinite(places).all(axis=1)]
    return np.percentile(places, [1, 99], axis=0) + splats.facts.offset if len(places) else np.zeros((2, 3))
