"""A capture from one side is sharp from there and a blur from behind; others have no side."""

import numpy as np
import pytest
from disc_splats import discs, plain

from splat2mesh.base.errors import DataWarning
from splat2mesh.splats.joining import joined
from splat2mesh.splats.splats import Splats
from splat2mesh.views.oneside import CONTRAST, sharp_side
from splat2mesh.views.viewpoints import SKETCH_SPLATS, even_directions, first_views

UP = np.array([0.0, 1.0, 0.0])
AROUND = even_directions(64)


def blur_behind(front, factor):
    """Blur 1 in front, `factor` behind, and nothing seen from straight above."""
    blur = np.where(AROUND @ np.asarray(front, float) < 0.0, factor, 1.0)
    return np.where(AROUND[:, 1] > 0.9, np.inf, blur)


@pytest.mark.parametrize("front", [[0, 0, 1], [1, 0, 0], [-0.6, 0, -0.8]])
def test_the_side_is_where_it_is_sharp(front):
    found = sharp_side(AROUND, blur_behind(front, 1.5 * CONTRAST), UP)
    assert found @ front > np.cos(np.radians(45.0)) and abs(found @ UP) < 1e-12
    assert sharp_side(AROUND, blur_behind(front, 0.9 * CONTRAST), UP) is None


def test_any_up_serves():
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    found = sharp_side(AROUND @ turn.T, blur_behind([0, 0, 1], 2.5), turn @ UP)
    assert found @ turn @ [0, 0, 1] > np.cos(np.radians(45.0))


def test_without_views_there_is_no_side():
    assert sharp_side(np.zeros((0, 3)), np.zeros(0), UP) is None
    assert sharp_side(AROUND, np.full(64, np.inf), UP) is None


def relief(behind, apart=0.04):
    """A painted wall with a step, which faces +z, before large faint blobs where no camera looked."""
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(-1, 1, apart), np.arange(-1, 1, apart))
    points = np.stack([x.ravel(), y.ravel(), np.where(x.ravel() > 0, 0.2, 0.0)], axis=1)
    wall = discs(points, np.tile([1e-6, 0, 1.0], (len(points), 1)), 0.75 * apart, 1e-3)
    paint = rng.normal(0, 1, (len(points), 1, 3)).astype(np.float32)
    wall = Splats(wall.means, wall.scales, wall.quats_wxyz, wall.opacities, paint)
    if not behind:
        return wall
    blobs = plain(rng.uniform([-1, -1, -1.2], [1, 1, -0.1], (400, 3)), 0.15, opacity=0.35)
    return joined([wall, blobs])


def test_views_of_such_a_capture_stay_on_its_side():
    with pytest.warns(DataWarning, match="captured from one side"):
        views = first_views(relief(True), 24, 64, UP, 0)
    assert views and all(view.forward[2] < 0.0 for view in views)


def test_a_capture_larger_than_the_sketch_has_its_side_too():
    # The side is known to 15 degrees, so a view may look along the wall and that far past it.
    large = relief(True, 0.012)
    assert len(large) > SKETCH_SPLATS
    with pytest.warns(DataWarning, match="captured from one side"):
        views = first_views(large, 24, 64, UP, 0)
    assert views and all(view.forward[2] < np.sin(np.radians(16.0)) for view in views)


def test_a_sheet_that_is_as_sharp_from_behind_is_seen_from_both_sides():
    views = first_views(relief(False), 24, 64, UP, 0)
    assert {np.sign(view.forward[2]) for view in views} >= {-1.0, 1.0}
