"""The sky of a relit splat: the new light at the right angle, as captured, or gone."""

from types import SimpleNamespace

import numpy as np
import pytest
from splat_samples import open_air

from relight import Environment
from relight.light.projections import texel_directions
from relight.splats import shown_as_sky, write_relit_ply
from relight.splats.sky import FarSplats, sky_rows
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.splats import Splats

AXES = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-1, 0, 0], [0, 0, -1]])


def captured():
    """Near splats about the origin, then one far along each axis, with colours that depend on the view."""
    rng = np.random.default_rng(0)
    means = np.concatenate([rng.uniform(-1, 1, (40, 3)), [[0.0, 0, 0]], -rng.uniform(-1, 1, (0, 3)), 50.0 * AXES])
    count = len(means)
    sh = rng.normal(0, 0.3, (count, 4, 3))
    far = np.arange(count) >= count - len(AXES)
    splats = Splats(means, np.full((count, 3), 0.1), np.tile([1.0, 0, 0, 0], (count, 1)), np.full(count, 0.7), sh)
    return splats, np.flatnonzero(far)


def striped():
    """A light whose display value is below 0.8 everywhere and differs in every direction."""
    x, y, z = np.moveaxis(texel_directions(64, 128), -1, 0)
    return Environment(np.stack([0.3 + 0.2 * x, 0.3 + 0.2 * y, 0.3 + 0.2 * z], axis=-1), "striped")


def under_sky(splats, rows, light, frame, factor, choice="new"):
    return FarSplats(splats, rows, rows, frame, choice).under(splats, light, factor)


def shown(splats, rows):
    return linear_from_srgb(splats.colors_diffuse[rows])


@pytest.mark.parametrize("angle", [0.0, 90.0, -37.5])
@pytest.mark.parametrize("frame", [np.eye(4), np.diag([1.0, -1, -1, 1]), np.diag([-1.0, -1, 1, 1])])
def test_far_splats_show_the_new_light_at_its_angle(angle, frame):
    splats, far = captured()
    light = striped().rotated(angle)
    relit = under_sky(splats, far, light, frame, 1.5)
    near = np.delete(splats.means, far, axis=0)
    expected = 1.5 * light.lookup((splats.means[far] - np.median(near, axis=0)) @ frame[:3, :3].T)
    np.testing.assert_allclose(shown(relit, far), expected, rtol=1e-4)
    assert not relit.sh[far, 1:].any()
    rest = np.delete(np.arange(len(splats)), far)
    np.testing.assert_array_equal(relit.sh[rest], splats.sh[rest])


def test_keep_changes_no_bit_and_no_far_splats_are_no_change():
    splats, far = captured()
    assert under_sky(splats, far, striped(), np.eye(4), 1.0, "keep") is splats
    assert under_sky(splats, far[:0], striped(), np.eye(4), 1.0) is splats


def test_dropped_splats_are_hidden_in_the_file_and_keep_their_row(tmp_path):
    splats, far = captured()
    source = tmp_path / "source.ply"
    write_inria_ply(source, splats)
    for origin in (source, None):
        write_relit_ply(tmp_path / "relit.ply", under_sky(splats, far, striped(), np.eye(4), 1.0, "drop"), origin)
        found = read_splats(tmp_path / "relit.ply")
        assert found.opacities[far].max() < 1e-6
        np.testing.assert_array_equal(found.means, splats.means)
        rest = np.delete(np.arange(len(splats)), far)
        np.testing.assert_allclose(found.opacities[rest], splats.opacities[rest], rtol=1e-6)


def test_a_sun_in_the_sky_stays_in_range():
    splats, far = captured()
    relit = under_sky(splats, far, Environment(np.full((8, 16, 3), 1e6, np.float32), "sun"), np.eye(4), 1.0)
    assert (shown(relit, far) <= 1.0 + 1e-5).all()


def test_other_choices_are_refused():
    splats, far = captured()
    with pytest.raises(InputError, match="new, keep, drop"):
        under_sky(splats, far, striped(), np.eye(4), 1.0, "old")


def test_rows_of_another_splat_are_refused():
    splats, far = captured()
    with pytest.raises(InputError, match=f"there are {len(splats)}"):
        under_sky(splats, far + 1, striped(), np.eye(4), 1.0)


@pytest.mark.parametrize("flip", [1.0, -1.0])
def test_far_lawns_hedges_and_bricks_are_no_sky(flip):
    splats, far, sky = open_air()
    turn = np.diag([1.0, flip, flip, 1.0])
    splats.means[:] = splats.means @ turn[:3, :3]
    found = sky_rows(splats, far, turn)
    assert len(np.setdiff1d(found, sky)) == 0  # no surface is taken for sky
    assert len(found) > 0.98 * len(sky)  # a few stand among the hedge, and follow their neighbours


def test_a_far_background_of_ground_alone_has_no_sky():
    splats, far, _ = open_air()
    assert len(sky_rows(splats, far[:300], np.eye(4))) == 0


def test_pale_facades_with_dark_windows_are_no_sky():
    splats, far, sky = open_air()
    count = len(sky)
    rng = np.random.default_rng(2)
    for dark, none in ((0.3, True), (0.0, False)):
        shaded = splats.sh.copy()
        windows = sky[rng.permutation(count)[: int(dark * count)]]
        shaded[windows] = -1.2
        place = Splats(splats.means, splats.scales, splats.quats_wxyz, splats.opacities, shaded)
        assert (len(sky_rows(place, far, np.eye(4))) == 0) == none


def test_windows_of_rooms_and_what_stays_as_captured_show_all_of_it():
    splats, far, sky = open_air()
    scene = SimpleNamespace(background_splats=far, scene_from_splat=np.eye(4), vertices=np.eye(3), is_place=False)
    for look in (SimpleNamespace(room=object(), as_captured=False), SimpleNamespace(room=None, as_captured=True)):
        np.testing.assert_array_equal(shown_as_sky(splats, scene, look), far)
    assert len(shown_as_sky(splats, scene, SimpleNamespace(room=None, as_captured=False))) <= len(sky)
