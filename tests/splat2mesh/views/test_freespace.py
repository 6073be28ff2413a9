"""Views of a place stand where its standpoints see them: above its ground, over its walls, not below."""

import numpy as np
from place_splats import box, garden, joined

from splat2mesh.splats.foreground import far_background
from splat2mesh.views.eyes import Eye
from splat2mesh.views.freespace import FreeSpace
from splat2mesh.views.viewpoints import bounds_of, candidate_views, virtual_views

UP = np.array([0.0, 1.0, 0.0])
EYES = [Eye(np.array([x, 1.2, z]), 0.1) for x in (-2.5, 0.0, 2.5) for z in (-2.5, 2.5)]


def of_the_garden(lawn_and_all):
    return FreeSpace(lawn_and_all, bounds_of(lawn_and_all.take(~far_background(lawn_and_all))), EYES, UP, 0.0)


def test_what_lies_above_the_lawn_is_free_and_what_lies_below_is_not():
    space = of_the_garden(garden())
    x, z = np.random.default_rng(0).uniform(-3.5, 3.5, (2, 200))
    above = space.holds(np.stack([x, np.linspace(1.0, 12.0, 200), z], axis=1))
    below = space.holds(np.stack([x, np.linspace(-0.5, -1.8, 200), z], axis=1))
    assert above.all() and not below.any()


def test_the_space_under_a_table_is_free():
    # Nobody stands there, but people see it: what is seen from above the ground stays.
    assert of_the_garden(garden()).holds(np.array([[0.0, 0.4, 0.0]])).all()


def test_a_look_past_the_edge_of_the_lawn_reaches_no_free_space():
    # The lawn has no wall at z = 4: from an eye at z = 2.5 a line of sight leads down there.
    splats, past = garden(), np.array([[0.0, -1.2, 6.0]])
    bounds = bounds_of(splats.take(~far_background(splats)))
    assert FreeSpace(splats, bounds, EYES[1:2]).holds(past).all()
    assert not FreeSpace(splats, bounds, EYES[1:2], UP, 0.0).holds(past).any()


def test_a_standpoint_is_in_its_own_sight():
    assert of_the_garden(garden()).holds(np.stack([eye.center for eye in EYES])).all()


def test_chosen_views_stand_there():
    splats = garden()
    foreground = splats.take(np.flatnonzero(~far_background(splats)))
    space = of_the_garden(splats)
    candidates = np.stack([view.center for view in candidate_views(foreground, 16, UP)])
    chosen = np.stack([view.center for view in virtual_views(foreground, 16, 64, UP, space=space)])
    assert (candidates[:, 1] < 0).any() and (chosen[:, 1] > 0).all()
    assert np.isin(chosen.round(9), candidates.round(9)).all()


def test_where_nothing_is_in_sight_no_view_is_chosen():
    sealed = joined(garden(), box([-0.2, -1.2, -0.2], [0.2, -0.8, 0.2], 0.05))
    space = FreeSpace(sealed, bounds_of(garden()), [Eye(np.array([0.0, -1.0, 0.0]), 0.1)])
    assert virtual_views(garden(), 8, 64, UP, space=space) == []
