"""The absorption of light by leaves, grass and everything else in coarse cells of space: nested grids."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

MOST = 8.0
"""Optical depth of a cell that counts as opaque: 0.03% of the light is left."""


class OpticalDepth(NamedTuple):
    """Nested grids, innermost first, in the scene frame. L levels.

    origins: (L, 3) float64, lowest corners. cells: (L,) float64, side of a cell. shapes: (L, 3) int64. starts: (L,)
    int64, where each level begins in depth. depth: (C,) float32, of a ray that crosses the cell from side to side.
    """

    origins: np.ndarray
    cells: np.ndarray
    shapes: np.ndarray
    starts: np.ndarray
    depth: np.ndarray

    @classmethod
    def of_levels(cls, origins: ArrayLike, cells: ArrayLike, levels: Sequence[NDArray[Any]]) -> "OpticalDepth":
        """Make it of grids, rounded as they are kept. origins: (L, 3), lowest corners. cells: (L,), sides of cells.
        levels: sequence of (X, Y, Z)."""
        shapes = np.array([level.shape for level in levels], np.int64)
        starts = np.concatenate([[0], np.cumsum(shapes.prod(axis=1))[:-1]]).astype(np.int64)
        kept = _bytes(np.concatenate([level.ravel() for level in levels]))
        return cls(np.asarray(origins, np.float64), np.asarray(cells, np.float64), shapes, starts, _depths(kept))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays to keep, small ones."""
        return {
            "depth_origins": self.origins,
            "depth_cells": self.cells,
            "depth_shapes": self.shapes,
            "depth_bytes": _bytes(self.depth),
        }

    @classmethod
    def restored(cls, arrays: Mapping[str, NDArray[Any]]) -> "OpticalDepth | None":
        """Make it of what `arrays` gave. None where it is not among them. Raises ValueError for parts that do not
        fit."""
        if "depth_bytes" not in arrays:
            return None
        origins, cells, shapes = (arrays[f"depth_{name}"] for name in ("origins", "cells", "shapes"))
        counts = shapes.prod(axis=1)
        kept = arrays["depth_bytes"]
        if not (origins.shape == shapes.shape == (len(cells), 3)) or kept.shape != (counts.sum(),):
            raise ValueError("the parts of its optical depth differ in size")
        starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
        return cls(origins, cells, shapes, starts, _depths(kept))


def _bytes(depth: NDArray[Any]) -> NDArray[np.uint8]:
    """By the square root: thin cells, of which a ray meets many, need the finer steps."""
    return np.rint(np.sqrt(np.clip(depth, 0.0, MOST) / MOST) * 255.0).astype(np.uint8)


def _depths(kept: NDArray[np.uint8]) -> NDArray[np.float32]:
    return np.square(kept.astype(np.float32) / np.float32(255.0)) * np.float32(MOST)
