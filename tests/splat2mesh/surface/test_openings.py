"""Which holes are openings: a window frame before nothing, before a wall, and with a pane."""

import numpy as np
import pytest

from splat2mesh.render.view import View
from splat2mesh.surface.album import TOLERANCE_OBJECT, RenderedPicture
from splat2mesh.surface.clean import fill_holes
from splat2mesh.surface.openings import SMALLEST, openings

RADIUS = 2.0**0.5


def frame(inner: float, count: int = 12) -> tuple[np.ndarray, np.ndarray]:
    """A flat frame in z = 0 from a square of side 2 inwards to one of side `inner`, facing -z: points and faces."""
    t = np.linspace(-1, 1, count, endpoint=False)
    one = np.ones(count)
    outer = np.concatenate([np.stack(side, 1) for side in ((t, -one), (one, t), (-t, one), (-one, -t))])
    around = len(outer)
    points = np.zeros((2 * around, 3))
    points[:around, :2], points[around:, :2] = outer, outer * inner / 2
    here, after = np.arange(around), (np.arange(around) + 1) % around
    quads = [np.stack(face, 1) for face in ((here, here + around, after), (after, here + around, after + around))]
    return points, np.concatenate(quads).astype(np.int32)


def pictures(depth_of) -> list[RenderedPicture]:
    """Five views from z = -4, with the frame's depth where they meet it and `depth_of(ways, eye)` inside."""
    found = []
    for x, y in ((0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)):
        eye = np.array([x, y, -4.0])
        view = View.look_at(eye, [0, 0, 0], [0, 1, 0], 50.0, 120)
        ways = view.ray_directions()
        met = eye + ways * (-eye[2] / ways[..., 2:])
        side = np.abs(met[..., :2]).max(axis=-1)
        frame_depth = -eye[2] / ways[..., 2]  # the rays' own axis component is 1, so this is camera z
        depth = np.where(side > 1, np.nan, np.where(side > 0.5, frame_depth, depth_of(frame_depth)))
        nothing = np.zeros_like(depth)
        found.append(RenderedPicture(view, nothing, depth.astype(np.float32), nothing))
    return found


INSIDE = {
    "nothing": lambda depth: np.full_like(depth, np.nan),
    "a wall behind": lambda depth: depth + 1.0,
    "a pane": lambda depth: depth,
}


@pytest.mark.parametrize(("inside", "is_open"), [("nothing", True), ("a wall behind", False), ("a pane", False)])
def test_what_views_see_nothing_through_stays_open(inside, is_open):
    points, faces = frame(1.0)
    seen = pictures(INSIDE[inside])
    filled_points, filled, count = fill_holes(
        points, faces, 5.0, are_open=lambda borders: openings(borders, seen, RADIUS)
    )
    assert count == (0 if is_open else 1)
    assert len(filled) == len(faces) + (0 if is_open else 48) and len(filled_points) == len(points) + count


def test_pinholes_are_none_and_no_picture_says_nothing():
    seen = pictures(INSIDE["nothing"])
    side = SMALLEST * TOLERANCE_OBJECT * RADIUS / 4
    square = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) / 2
    borders = [0.99 * side * square, 1.01 * side * square, square]
    np.testing.assert_array_equal(openings(borders, seen, RADIUS), [False, True, True])
    np.testing.assert_array_equal(openings(borders, [], RADIUS), False)
    np.testing.assert_array_equal(openings(borders, seen[:1], RADIUS), False)  # one picture alone may err
    assert openings([], seen, RADIUS).shape == (0,)
