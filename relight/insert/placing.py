"""The pose of an object in a scene: its own frame turned, scaled, shifted, dropped onto the floor."""

import warnings

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.scene import Scene

from ..transfer.occluder import Occluder
from .asked import AskedInsert

MOST_OF_SCENE = 0.5
"""Largest size of an object without a given scale, in diagonals of the scene. Files in centimetres and millimetres
exceed it."""

LEAST_OF_SCENE = 2e-4
"""Smallest size, in diagonals of the scene: a smaller object and its shadow are invisible."""

COLUMNS = 9
"""Points along a side of the grid from which rays search for the floor."""


def placed_by(
    asked: AskedInsert,
    vertices: NDArray[np.float32],  # (V, 3) of the object, y up
    scene: Scene,
    occluder: Occluder,  # of that scene
) -> NDArray[np.float64]:
    """Return scene_from_object, (4, 4). Warns with a DataWarning of an object of another unit than the scene's.

    An object stands upright whichever way the splat's own frame is turned; its unit is the splat's.
    """
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    unit = float(np.cbrt(abs(np.linalg.det(matrix[:3, :3])))) or 1.0
    size = float(np.linalg.norm(np.ptp(vertices.astype(np.float64), axis=0))) * unit
    scale, diagonal = asked.scale, occluder.frame.diagonal
    if scale is None:
        scale = _guessed_scale(asked.name, size, diagonal)
    elif size * scale > diagonal:
        _warn(f"{asked.name} is {size * scale / diagonal:.3g} times as large as the scene: give a smaller scale")
    if size * scale < LEAST_OF_SCENE * diagonal:
        _warn(f"{asked.name} is too small to be seen, {size * scale / diagonal:.1g} of the scene: scale it up")
    angle = np.radians(asked.turn_deg)
    cos, sin = np.cos(angle), np.sin(angle)
    placed = np.eye(4)
    placed[:3, :3] = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]) * scale * unit
    placed[:3, 3] = matrix[:3, :3] @ np.asarray(asked.at) + matrix[:3, 3]
    if asked.on == "floor":
        placed[1, 3] += _drop(vertices.astype(np.float64) @ placed[:3, :3].T + placed[:3, 3], occluder)
    return placed


def _guessed_scale(name: str, size: float, diagonal: float) -> float:
    """1, or the power of ten that fits an object of another unit into the scene."""
    if size <= MOST_OF_SCENE * diagonal:
        return 1.0
    scale = 10.0 ** -np.ceil(np.log10(size / (MOST_OF_SCENE * diagonal)))
    _warn(
        f"{name} is {size / diagonal:.3g} times as large as the scene, so its unit is assumed to differ, and it is "
        f"scaled by {scale:g}; give its scale"
    )
    return float(scale)


def _drop(vertices: NDArray[np.float64], occluder: Occluder) -> float:
    """Height by which an object (V, 3) moves up to stand on the highest surface below it, searched from its middle."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    share = (np.arange(COLUMNS) + 0.5) / COLUMNS
    x, z = (grid.ravel() for grid in np.meshgrid(*(low[axis] + share * (high - low)[axis] for axis in (0, 2))))
    middle = 0.5 * (low[1] + high[1])
    rays = np.zeros((len(x), 6), np.float32)
    rays[:, :3] = occluder.frame.unit(np.stack([x, np.full_like(x, middle), z], axis=1))
    rays[:, 4] = -1.0
    distance = occluder.first_hits(rays).distance * occluder.frame.diagonal
    # A surface under one corner alone, such as a table's edge, does not support it: most columns must be no lower.
    met = np.sort(distance[np.isfinite(distance)])
    if not len(met):
        _warn("found no floor below the object: it stays at its position")
        return 0.0
    return float(middle - met[len(met) // 4] - low[1])


def _warn(message: str) -> None:
    warnings.warn(message, DataWarning, stacklevel=5)
