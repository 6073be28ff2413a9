"""The up direction: the rotation from a splat file's frame into the y-up scene frame."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from ..base.arrays import Matrix3, Matrix4, Vector
from ..base.choices import UP_CHOICES
from ..base.errors import InputError
from ..render.view import View
from ..splats.splats import Splats
from .ground import ground_of

_QUARTER_TURNS = {
    "+y": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
    "+z": [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
    "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
}

LEVEL_DISAGREEMENT = np.radians(30.0)
"""Largest angle between the level direction of the cameras and their mean up; beyond it the mean is used."""


def upright(
    up: str, views: Sequence[View], splats: Splats, is_place: Callable[[], bool] = lambda: False
) -> tuple[Matrix4, str]:
    """The rotation of `scene_from_splat`, and what source it: one phrase.

    up: one of UP_CHOICES. "auto" asks the trained cameras `views` where there are any, else what the file of `splats`
    says, else their floor, else assumes the usual frame of trained files. A
    largest plane that faces along z is the floor of a place, but not of an object; `is_place` is called then, and
    tells. Raises InputError for another `up`.
    """
    if up != "auto" or len(views):
        return scene_from_splat(up, views), "asked for" if up != "auto" else "the cameras"
    if splats.facts.up is not None:
        return scene_from_splat(floor_up=np.asarray(splats.facts.up)), f"the file, by {splats.facts.up_from}"
    ground = ground_of(splats)
    if ground.of_place is not None and is_place():
        matrix = scene_from_splat(floor_up=ground.of_place)
        leans = np.degrees(np.arccos(min(1.0, float(ground.of_place[2]))))
        return matrix, f"the floor, {leans:.1f} degrees from +z, since the capture looked from within"
    source = f"assumed -y, since {ground.reason}" if ground.up is None else ground.reason
    return scene_from_splat(up, floor_up=ground.up), source


def scene_from_splat(up: str = "auto", views: Sequence[View] = (), floor_up: Vector | None = None) -> Matrix4:
    """The (4, 4) float64 rotation that takes the splat's frame to the scene frame (right-handed, y up).

    up: one of UP_CHOICES, the direction in the splat's frame that points up. "auto" takes it from the trained
    cameras `views` where there are any, else from the floor where that is known, `floor_up`, (3,) unit, else assumes
    the usual frame of trained files, -y up, that is Rx(180).
    Raises InputError for another `up`.
    """
    if up not in UP_CHOICES:
        raise InputError(f"`up` {up}: expected one of {' '.join(UP_CHOICES)}")
    matrix = np.eye(4)
    if up == "auto" and len(views):
        matrix[:3, :3] = _upright(up_from_cameras(views))
    elif up == "auto" and floor_up is not None:
        matrix[:3, :3] = _upright(floor_up)
    else:
        matrix[:3, :3] = _QUARTER_TURNS["-y" if up == "auto" else up]
    return matrix


def up_from_cameras(views: Sequence[View]) -> NDArray[np.float64]:
    """The up direction that level cameras agree on: (3,) unit float64 in the splat's frame.

    Photographers hold cameras level but tilt them, so the image x axes are the better witnesses: up is the direction
    that is most nearly orthogonal to all of them. Where they do not span a plane, it is the mean of the image up axes.
    """
    axes = np.stack([view.camera_from_world[:3, :3] for view in views])
    mean_up = -axes[:, 1].mean(axis=0)
    mean_up /= max(np.linalg.norm(mean_up), 1e-12)
    spread, directions = np.linalg.eigh(axes[:, 0].T @ axes[:, 0] / len(axes))
    level = directions[:, 0] * np.sign(directions[:, 0] @ mean_up)
    spans_a_plane = spread[1] > 10 * max(spread[0], 1e-3)
    agrees = level @ mean_up > np.cos(LEVEL_DISAGREEMENT)
    return level if spans_a_plane and agrees else mean_up


def _upright(up: Vector) -> Matrix3:
    """The nearest quarter turn to +y, followed by the smallest rotation that takes `up` exactly there."""
    turn = max(_QUARTER_TURNS.values(), key=lambda matrix: np.asarray(matrix)[1] @ up)
    source = np.asarray(turn) @ up
    axis = np.cross(source, [0.0, 1.0, 0.0])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    tilt = np.eye(3) + cross + cross @ cross / max(1.0 + source[1], 1e-12)
    return tilt @ turn + 0.0  # no zero is negative
