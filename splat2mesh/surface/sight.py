"""The data of one view on a surface, ready for fusion: depth, normal, weight, spread, and the wanted cell size."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Floats
from ..render.opacityfield import FIELD_LEVEL, FieldDepth, field_depth
from ..render.view import View
from ..splats.splats import Splats

LEAST_COSINE = 0.05
"""Cosine of the angle at which a point must at least be seen for its colour, and the weight of a surface that is seen
at a more grazing one: floors far away are seen no other way."""

CELL_PIXELS, THICK_CELLS, MOST_THICK = 1.5, 4.0, 3.0
"""Side of a cell in pixels of the view that saw it, cells across a thick surface, and how far its thickness may enlarge
the cells over what they are elsewhere at its distance."""

NARROW, WIDE = 2.0, 2.0 * THICK_CELLS
"""Cells within which the distance field is kept on either side of the surface: least, and most where it is thick, twice
its thickness."""


class Sighting(NamedTuple):
    """A view, what it shows, and how thick the surface is along its normal, (H, W) in world units, NaN where there is
    none."""

    view: View
    seen: FieldDepth
    thickness: Floats

    @classmethod
    def taken(cls, splats: Splats, view: View, near: float, level: float = FIELD_LEVEL) -> "Sighting":
        """What a view shows of splats, as of `field_depth`."""
        seen = field_depth(splats, view, float(near), level)
        return cls(view, seen, seen.spread * -(view.ray_directions() * seen.normal).sum(axis=-1))


class Truncation(NamedTuple):
    """The distance from a surface within which a view gives evidence of space.

    finest: side of the smallest cell, world units. narrow, wide: cells on either side of a surface, least and most.
    carve: along z, world units, how far in front of a surface space counts as seen to be free.
    """

    finest: float
    narrow: float = NARROW
    wide: float = WIDE
    carve: float = np.inf


@dataclass(frozen=True)
class FusionSight:
    """One view's surface, ready for fusion. H, W are the view's size.

    plane: (H, W, 4) float32: unit normal in the world towards the camera, and camera z (NaN where there is none).
    weight: (H, W) float32 in [0, 1]. spread: (H, W) float32 in world units along z. step: (H, W) float32 wanted side
    of the cells, world units.
    """

    view: View
    plane: NDArray[np.float32]
    weight: NDArray[np.float32]
    spread: NDArray[np.float32]
    step: NDArray[np.float32]

    @classmethod
    def of(cls, shot: Sighting, distance: float, finest: float, fog: float) -> "FusionSight":
        """From a Sighting. distance: typical of the place, world units: what is much farther away counts less. finest:
        least side of a cell, world units. fog: typical thickness of the surfaces over their distance."""
        view, seen, thickness = shot
        rays = view.ray_directions().astype(np.float32)
        cosine = -(rays * seen.normal).sum(axis=-1) / np.linalg.norm(rays, axis=-1)
        weight = np.maximum(cosine, LEAST_COSINE)
        with np.errstate(invalid="ignore"):
            weight = weight * seen.sharpness() / (1 + (seen.depth / (2 * distance)) ** 2)
            pixel = np.float32(max(CELL_PIXELS / view.fx, fog / THICK_CELLS)) * seen.depth
            step = np.maximum(np.clip(thickness / THICK_CELLS, pixel, MOST_THICK * pixel), finest)
        known = np.isfinite(seen.depth) & np.isfinite(seen.spread) & np.isfinite(step)
        plane = np.concatenate([seen.normal, np.where(known, seen.depth, np.nan)[..., None]], axis=-1)
        weight = np.where(known, weight, 0).astype(np.float32)
        return cls(view, plane.astype(np.float32), weight, seen.spread, step.astype(np.float32))
