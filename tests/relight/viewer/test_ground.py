"""An object of a session stands on the ground: its shadow is that of the picture, and follows the light."""

import numpy as np
import pytest

pytest.importorskip("pyvista")

from dataclasses import replace

from viewer_scenes import SIZE, ball_on_plate, bare, session_of

from relight.light.environment import Environment
from relight.output.catcher import Catcher
from relight.viewer.lighting import SessionLight
from relight.viewer.stage import SIDE, StandingGround
from relight.viewer.window import Window
from splat2mesh.render.raycaster import RayCaster

pytestmark = pytest.mark.usefixtures("vtk_is_silent")


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


@pytest.fixture
def window(scene):
    opened = Window(session_of(scene), SIZE, off_screen=True)
    opened.finish()
    yield opened
    opened.close()


def light_of(name):
    environment = Environment.load(name)
    return SessionLight(np.zeros((100, 3)), environment.radiance, ""), environment


@pytest.mark.parametrize("angle", [0.0, 75.0])
def test_the_shadow_is_that_of_the_picture(scene, angle):
    """On a grid half as fine, from a sky as coarse as its directions."""
    ground = StandingGround(scene)
    ground.wait()
    light, environment = light_of("noon")
    found = ground.under(light, angle)
    expected = Catcher(scene, RayCaster(scene.vertices, scene.faces)).under(environment.rotated(angle))
    ground.close()
    assert (found.height, found.reach) == (expected.height, expected.reach) and len(found.shares) == SIDE
    rng = np.random.default_rng(0)
    places = found.middle + found.reach * rng.uniform(-0.7, 0.7, (4000, 2))
    difference = found.share(places) - expected.share(places)
    assert np.abs(difference).mean() < 0.015 and expected.share(places).min() < 0.7


def test_the_shadow_follows_when_the_light_rests(scene):
    ground = StandingGround(scene)
    ground.wait()
    light, _ = light_of("noon")
    assert ground.under(light, 10.0, rests=False) is None
    first = ground.under(light, 10.0)
    assert ground.under(light, 10.0, rests=False) is first  # while the camera moves
    assert ground.under(light, 11.0, rests=False) is None
    assert ground.under(light_of("sunset")[0], 10.0, rests=False) is None
    ground.close()


def test_the_ground_darkens_under_the_object_and_nothing_else_does(window):
    window.session.change(sky=True)
    shaded = bare(window).astype(int)
    ground, window._stage.ground = window._stage.ground, None
    plain = bare(window).astype(int)
    window._stage.ground = ground
    darker = plain - shaded
    assert darker.min() >= -1 and (darker.max(axis=2) > 8).mean() > 0.02  # a byte of rounding
    seen = window._stage._raster._face
    size = seen.shape[0] // SIZE[1]
    covered = (seen >= 0).reshape(SIZE[1], size, SIZE[0], size).all(axis=(1, 3))
    assert covered.any() and not darker[covered].any()
    window.session.change(sky=False)  # before plain grey there is no ground, as in pictures
    assert (bare(window)[:5] == bare(window)[:5, :1]).all()


def test_a_place_has_its_own_ground(scene):
    place = replace(scene, capture={"from": "inside", "eyes": [[0.0, 0.0, 0.0]]})
    assert place.is_place
    window = Window(session_of(place), SIZE, off_screen=True)
    assert window._stage.ground is None
    window.close()
