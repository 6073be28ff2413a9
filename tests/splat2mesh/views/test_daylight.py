"""Up from the light on an object, without other evidence: a hint in words, never a turn by itself."""

import numpy as np
import pytest
from ball_splats import solid_ball

from relight import Environment
from scenes import bake, build, exposure, splats_from
from splat2mesh.splats.formats.encoding import sh_from_color
from splat2mesh.splats.placing import placed, similarity
from splat2mesh.splats.splats import Splats
from splat2mesh.views.daylight import CLEAR, brightness_from_above
from splat2mesh.views.upright import upright

OVER = similarity(rotation=np.diag([1.0, -1.0, -1.0]))
"""What turns a splat upside down."""


def shaded_ball(above, below):
    """A ball, -y up, with a display value for each of its halves."""
    ball = solid_ball(1500)
    values = np.where(ball.means[:, 1:2] < 0, above, below) * np.ones(3)
    return Splats(ball.means, ball.scales, ball.quats_wxyz, ball.opacities, sh_from_color(values)[:, None])


def test_an_even_thing_is_as_bright_from_everywhere():
    for up in np.vstack([np.eye(3), -np.eye(3)]):
        assert brightness_from_above(shaded_ball(0.5, 0.5), up) == pytest.approx(1.0, abs=0.01)


def test_turning_a_thing_over_inverts_the_ratio():
    ball, up = shaded_ball(0.6, 0.3), np.array([0.0, -1.0, 0.0])
    ratio = brightness_from_above(ball, up)
    assert ratio > 1.3
    assert brightness_from_above(ball, -up) == pytest.approx(1 / ratio, rel=1e-6)
    assert brightness_from_above(placed(ball, OVER), up) == pytest.approx(1 / ratio, rel=0.01)
    assert brightness_from_above(shaded_ball(0.0, 0.0), up) == 1.0


@pytest.fixture(scope="module", params=["object", "tabletop"])
def thing(request):
    """A generated capture under a sky, -y up."""
    truth = build(request.param, 0, 2000)
    radiance = bake(truth, Environment.load("overcast"))
    return splats_from(truth, radiance * exposure(radiance), 4000, 0)


def test_an_object_upside_down_is_reported_and_turned_where_pictures_show_it(thing, request):
    matrix, reason = upright("auto", [], thing)
    assert reason.startswith("the floor") or (
        reason.startswith("assumed -y") and reason.endswith("times brighter from above")
    )
    turned, doubted = upright("auto", [], placed(thing, OVER))
    assert brightness_from_above(thing, matrix[1, :3]) > CLEAR
    if request.node.callspec.params["thing"] == "tabletop":
        # Its pictures from below are much blurred: no camera stood there, and it is put back on its feet.
        assert doubted.startswith("the floor")
        np.testing.assert_allclose(turned[1, :3], -matrix[1, :3], atol=0.02)
        return
    assert "; but" in doubted and "brighter from below, so it may be upside down" in doubted
    np.testing.assert_allclose(turned[1, :3], matrix[1, :3], atol=0.02)  # the side is the usual one, right or wrong
