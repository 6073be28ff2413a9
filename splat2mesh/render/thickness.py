"""The optical depth of a scene in coarse cells, made from the opacities of its splats, with solid ground below."""

import math
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from ..base.arrays import Floats, Matrix4
from ..scene.optical_depth import MOST, OpticalDepth
from ..splats.placing import placed
from ..splats.splats import Splats
from .opacitygrid import GROWTH, MOST_LEVELS, OCCUPIED, nested

CELLS = 500_000
"""Cells of each grid: a leaf does not matter, a bush does."""

LEVELS = 3
"""How many grids, at least: marches use the wider ones far from where they begin."""

OUTSIDE = 2.0
"""Percent of the thick splats' places along each axis that lie beyond either end of the innermost box."""

ASKEW = 0.5
"""Of its face, what a leaf that may be turned any way hides on the mean: a flat thing's mean projected area is half of
it. In a generated garden the whole face, and three quarters of a cell less before it, were a tenth worse."""

OVERHANG = 9
"""Cells: an overhang without ground below it that is narrower than this takes the ground from beside it."""


def optical_depth(
    splats: Splats,  # without the far background, finite, in their own frame
    volume: Floats,  # (N,) in [0, 1], how far each is a volume
    scene_from_splat: Matrix4,
) -> OpticalDepth:
    """The OpticalDepth around the leaves and grass of a scene, scene frame, y up. What lies below the lowest splats of
    a column counts as opaque: light that comes from below the ground is none."""
    bare = placed(replace(splats, sh=splats.sh[:, :1]), scene_from_splat)
    thick = bare.means[volume > np.percentile(volume, 50.0)] if len(volume) else bare.means
    low, high = np.percentile(thick if len(thick) else bare.means, [OUTSIDE, 100.0 - OUTSIDE], axis=0)
    center, size = (low + high) / 2.0, np.maximum(high - low, 1e-6)
    size = np.maximum(size, 0.1 * size.max())
    reach = np.abs(np.percentile(bare.means, [0.1, 99.9], axis=0) - center).max(axis=0)
    widest = float((2.0 * reach / size).max())
    reaching = 1 + math.ceil(math.log(max(widest, 1.0)) / math.log(GROWTH))
    levels = int(np.clip(reaching, LEVELS, MOST_LEVELS))
    hiding = bare.opacities * (1.0 - (1.0 - ASKEW) * np.asarray(volume, np.float32))
    origins, cells, grids = nested(bare, hiding, center, size, [CELLS] * levels)
    return OpticalDepth.of_levels(origins, cells, [_grounded(grid) for grid in grids])


def _grounded(depth: NDArray[np.float32]) -> NDArray[np.float32]:
    """(X, Y, Z) with all that lies below the lowest occupied cell of a column opaque; narrow overhangs have none."""
    occupied = depth > OCCUPIED  # one may be the ground of its column
    height = depth.shape[1]
    lowest = np.where(occupied.any(axis=1), occupied.argmax(axis=1), height)
    lowest = scipy.ndimage.grey_opening(lowest, size=(OVERHANG, OVERHANG), mode="nearest")
    lowest[lowest >= height] = 0
    below = np.arange(height)[None, :, None] < lowest[:, None, :]
    return np.where(below, np.float32(MOST), depth)
