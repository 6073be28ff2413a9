"""Sky in the panes of a room: white splats with the far background behind them, and no other white ones."""

import dataclasses

import numpy as np
import pytest
from place_splats import box, joined, wall

from splat2mesh import convert
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.foreground import foreground_ball
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.splats.splats import SH_C0
from splat2mesh.surface.extract import EFFORTS, Effort
from splat2mesh.views import standpoints
from splat2mesh.views.panes import sky_in_panes
from splat2mesh.views.viewpoints import bounds_of

EYES = [standpoints.Eye(np.array(center, float), 0.1) for center in ([-1, 1.2, -0.5], [0, 1.4, 0.6], [0.5, 1, 0])]


def painted(splats, srgb):
    sh = np.zeros_like(splats.sh)
    sh[:, 0] = (srgb - 0.5) / SH_C0
    return dataclasses.replace(splats, sh=sh)


def windowed(pane=1.0, lamp=1.0, spacing=0.06, sky=True):
    """A grey room of 4 x 2.4 x 3 units whose wall at x = 2 has a window, with a pane behind it, a lamp under its
    ceiling and a white crate on its floor; and the number of splats of each part."""
    low, high = np.array([-2, 0, -1.5]), np.array([2, 2.4, 1.5])
    x, y, z = np.diag(high - low)
    closed = [(low, x, y), (low, z, x), (low, y, z), (high, -y, -x), (high, -x, -z)]
    shut = [wall(corner, a, b, spacing) for corner, a, b in closed]
    for at, width in (([2, 0, -1.5], 1.0), ([2, 0, 0.5], 1.0)):
        shut.append(wall(at, [0, 0, width], [0, 2.4, 0], spacing))
    for at, height in (([2, 0, -0.5], 0.8), ([2, 1.8, -0.5], 0.6)):
        shut.append(wall(at, [0, 0, 1.0], [0, height, 0], spacing))
    parts = [
        painted(joined(*shut), 0.5),
        painted(wall([2.15, 1.1, -0.4], [0, 0, 0.8], [0, 0.6, 0], 0.2), pane),
        painted(wall([-0.3, 2.3, -0.3], [0.6, 0, 0], [0, 0, 0.6], spacing), lamp),
        painted(box([0.5, 0, 0], [1, 0.5, 0.5], spacing), 1.0),
    ]
    if sky:
        parts.append(painted(box([-40, -40, -40], [40, 40, 40], 2.0, inwards=True), 0.9))
    return joined(*parts), [len(part) for part in parts]


def found(splats):
    far = foreground_ball(splats)[2]
    return sky_in_panes(splats, far, bounds_of(splats.take(np.flatnonzero(~far))), EYES), far


def test_the_white_pane_is_sky_lamp_and_crate_are_not():
    splats, (walls, pane, *_) = windowed()
    sky, far = found(splats)
    assert far.any() and not (sky & far).any()
    np.testing.assert_array_equal(np.flatnonzero(sky), walls + np.arange(pane))


def test_a_pane_that_was_not_clipped_stays():
    assert not found(windowed(pane=0.9)[0])[0].any()


def test_a_room_without_far_background_has_no_sky():
    splats, _ = windowed(sky=False)
    assert not found(splats)[0].any()


def test_nobody_sees_no_sky():
    splats, _ = windowed()
    far = foreground_ball(splats)[2]
    assert not sky_in_panes(splats, far, bounds_of(splats.take(np.flatnonzero(~far))), []).any()


@pytest.fixture(scope="module")
def meshed(tmp_path_factory):
    """Scenes of that room with a white pane, and without any."""
    folder = tmp_path_factory.mktemp("panes")
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        patch.setattr(standpoints, "EYES", 4)
        scenes: list[Scene] = []
        splats, (walls, pane, *_) = windowed()
        rest = np.delete(np.arange(len(splats)), walls + np.arange(pane))
        for name, some in (("pane", splats), ("none", splats.take(rest))):
            write_inria_ply(folder / f"{name}.ply", some)
            with pytest.warns(DataWarning, match="far background"):
                scenes.append(convert(folder / f"{name}.ply", detail="draft", up="+y", texture="none", stand="inside"))
    return *scenes, np.arange(walls, walls + pane)


@pytest.mark.slow
def test_the_window_is_open_and_its_sky_background(meshed):
    scene, without, pane = meshed
    assert np.isin(pane, scene.background_splats).all()
    assert len(scene.background_splats) == len(without.background_splats) + len(pane)
    before = (np.abs(scene.vertices - [2.15, 1.4, 0.0]) < [0.1, 0.2, 0.3]).all(axis=1)
    assert not before.any(), "nothing hangs in the window"


@pytest.mark.slow
def test_the_rest_is_as_without_it(meshed):
    scene, without, _ = meshed
    assert len(scene.vertices) == pytest.approx(len(without.vertices), rel=0.02)
