"""Where a capture stood: rooms from within, gardens from within and around, objects from around; hints are obeyed."""

import numpy as np
import pytest
from ball_splats import solid_ball
from place_splats import box, garden, joined, room

from splat2mesh.base.errors import InputError
from splat2mesh.splats.foreground import far_background
from splat2mesh.views.eyes import around
from splat2mesh.views.standpoints import standpoints
from splat2mesh.views.viewpoints import bounds_of


def found(splats, *args, **settings):
    return standpoints(splats, bounds_of(splats.take(~far_background(splats))), *args, **settings)


@pytest.fixture(scope="module")
def in_the_room():
    return found(room())


def test_a_room_is_seen_from_within(in_the_room):
    assert in_the_room.kind == "inside"
    centers = np.array([eye.center for eye in in_the_room.eyes])
    assert (np.abs(centers[:, 0]) < 2).all() and (np.abs(centers[:, 2]) < 1.5).all()
    assert (centers[:, 1] > 0).all() and (centers[:, 1] < 2.4).all()
    assert len(np.unique(centers, axis=0)) == len(centers)
    # Nobody stands in the crate, and nothing that a visitor sees lies before the near plane.
    in_crate = (centers[:, 0] > 0.5) & (centers[:, 0] < 1) & (centers[:, 1] < 0.5) & (centers[:, 2] > 0)
    assert not (in_crate & (centers[:, 2] < 0.5)).any()
    assert all(eye.near < 0.75 for eye in in_the_room.eyes)


def test_a_garden_is_seen_from_within_and_around():
    assert found(garden()).kind == "both"


def test_nobody_stands_under_the_lawn():
    # What reaches below the ground, such as a well, stretches the box in which places are tried.
    deep = joined(garden(), box([-3.5, -1.5, -3.5], [-2.5, -0.1, -2.5], 0.05))
    lowest = {up: min(eye.center[1] for eye in found(deep, up=up).eyes) for up in (None, (0.0, 1.0, 0.0))}
    assert lowest[None] < 0 < lowest[0.0, 1.0, 0.0]


def test_a_room_may_have_a_cellar(in_the_room):
    # Below the ground of a garden is nothing to see; rooms are left alone, whatever is above or below.
    again = found(room(), up=np.array([0.0, -1.0, 0.0]))
    np.testing.assert_array_equal([e.center for e in again.eyes], [e.center for e in in_the_room.eyes])


def test_an_object_is_seen_from_around():
    standing = found(solid_ball())
    assert standing.kind == "outside" and standing.eyes == []


def test_the_choice_overrules_what_the_splat_says():
    assert found(room(), "outside").kind == "outside"
    assert found(garden(), "inside").kind == "inside"


def test_the_same_again(in_the_room):
    again = found(room())
    np.testing.assert_array_equal([e.center for e in again.eyes], [e.center for e in in_the_room.eyes])


def test_an_eye_that_is_given_comes_first():
    standing = found(room(), "auto", [(-1.0, 1.2, 0.5)])
    np.testing.assert_array_equal(standing.eyes[0].center, [-1.0, 1.2, 0.5])
    assert len(standing.eyes) > 1


def test_an_eye_inside_a_wall_or_outside_is_refused():
    with pytest.raises(InputError, match=r"`eyes` 2,1\.2,0\.1 lies inside a surface"):
        found(room(), "auto", [(2.0, 1.2, 0.1)])
    with pytest.raises(InputError, match="outside the scene"):
        found(room(), "auto", [(20.0, 1.2, 0.1)])


def test_the_views_from_an_eye_see_every_direction(in_the_room):
    views, near = around(in_the_room.eyes[:1], 64, np.array([0.0, 1.0, 0.0]))
    assert len(views) == len(near) == 6
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((500, 3))
    seen = np.zeros(500, bool)
    for view in views:
        pixels, z = view.project(view.center + directions)
        seen |= (z > 0) & (pixels >= 0).all(axis=1) & (pixels < 64).all(axis=1)
    assert seen.all()
