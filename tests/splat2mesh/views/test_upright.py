"""The rotation into the y-up scene frame, chosen by hand or read off the cameras."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from splat_samples import make_splats

from splat2mesh.base.errors import InputError
from splat2mesh.render.view import View
from splat2mesh.splats.facts import FileFacts
from splat2mesh.views.upright import UP_CHOICES, scene_from_splat, up_from_cameras, upright

AXES = {"+y": [0, 1, 0], "-y": [0, -1, 0], "+z": [0, 0, 1], "-z": [0, 0, -1]}


def orbit(count=24, pitch_deg=0.0, world=None, roll_deg=0.0, seed=0):
    """Cameras on a circle about the origin, image top towards +y, all in a world turned by `world`."""
    rng = np.random.default_rng(seed)
    world = np.eye(3) if world is None else world
    pitch = np.radians(pitch_deg)
    views = []
    for angle in np.arange(count) * 2 * np.pi / count:
        eye = 3 * np.array([np.cos(angle) * np.cos(pitch), np.sin(pitch), np.sin(angle) * np.cos(pitch)])
        up = Rotation.from_rotvec(np.radians(rng.normal(0, roll_deg)) * eye / 3).apply([0, 1, 0])
        views.append(View.look_at(world @ eye, [0, 0, 0], world @ up, 50.0, 16))
    return views


def angle_deg(a, b):
    return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


def assert_rigid(matrix):
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-14)
    assert np.linalg.det(matrix[:3, :3]) == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_array_equal(matrix[3], [0, 0, 0, 1])
    np.testing.assert_array_equal(matrix[:, 3], [0, 0, 0, 1])


@pytest.mark.parametrize("up", AXES)
def test_each_choice_takes_that_axis_to_plus_y_by_a_rotation(up):
    matrix = scene_from_splat(up)
    np.testing.assert_array_equal(matrix[:3, :3] @ AXES[up], [0, 1, 0])
    np.testing.assert_array_equal(matrix[:3, 0], [1, 0, 0])  # x stays: turns are about x
    assert_rigid(matrix)
    assert matrix.dtype == np.float64
    assert set(AXES) | {"auto"} == set(UP_CHOICES)


def test_minus_y_is_exactly_half_a_turn_about_x_and_the_default_without_cameras():
    np.testing.assert_array_equal(scene_from_splat("-y"), np.diag([1.0, -1.0, -1.0, 1.0]))
    np.testing.assert_array_equal(scene_from_splat("auto"), scene_from_splat("-y"))
    np.testing.assert_array_equal(scene_from_splat(), scene_from_splat("-y"))


def test_another_up_is_refused_with_the_choices():
    with pytest.raises(InputError, match=r"`up` up: expected one of auto \+y -y \+z -z"):
        scene_from_splat("up")


# Pitches from above and from below, as far as photographers tilt; near 90 degrees "level" means nothing.
@pytest.mark.parametrize("pitch_deg", [0, 20, 45, 60, -30])
@pytest.mark.parametrize("seed", range(3))
def test_up_of_an_orbit_in_a_tilted_world(pitch_deg, seed):
    world = Rotation.random(random_state=seed).as_matrix()
    up = up_from_cameras(orbit(pitch_deg=pitch_deg, world=world))
    np.testing.assert_allclose(up, world @ [0, 1, 0], atol=1e-12)


def test_half_an_orbit_looking_down_is_still_level_where_the_mean_of_the_up_axes_is_not():
    views = orbit(pitch_deg=40)[:12]
    mean_up = -np.mean([view.camera_from_world[1, :3] for view in views], axis=0)
    assert angle_deg(mean_up, np.array([0, 1, 0])) > 20
    np.testing.assert_allclose(up_from_cameras(views), [0, 1, 0], atol=1e-12)


def test_cameras_held_by_hand_give_up_to_within_their_own_scatter():
    up = up_from_cameras(orbit(count=60, pitch_deg=25, roll_deg=5.0))
    # Each camera witnesses one of two tilts, so a roll of 5 degrees leaves 5 sqrt(2 / 60) = 0.91 degrees in each.
    assert angle_deg(up, np.array([0, 1, 0])) < 3 * 0.91
    assert np.linalg.norm(up) == pytest.approx(1.0, abs=1e-12)


def test_cameras_that_all_face_one_way_fall_back_on_the_mean_of_their_up_axes():
    views = [View.look_at([x, 1.0, -4.0], [x, 0.0, 0.0], [0, 1, 0], 50.0, 16) for x in np.linspace(-1, 1, 9)]
    expected = -views[0].camera_from_world[1, :3]
    np.testing.assert_allclose(up_from_cameras(views), expected, atol=1e-12)


def test_auto_brings_the_up_of_the_cameras_exactly_to_plus_y():
    for seed in range(20):
        world = Rotation.random(random_state=seed).as_matrix()
        matrix = scene_from_splat("auto", orbit(pitch_deg=15, world=world))
        np.testing.assert_allclose(matrix[:3, :3] @ world @ [0, 1, 0], [0, 1, 0], atol=1e-12)
        assert_rigid(matrix)


def test_auto_with_cameras_of_a_nearly_upright_world_changes_little():
    world = Rotation.from_euler("x", 180 + 3, degrees=True).as_matrix()  # -y up, tilted by 3 degrees
    matrix = scene_from_splat("auto", orbit(pitch_deg=15, world=world))
    np.testing.assert_allclose(matrix[:3, :3] @ world, np.eye(3), atol=1e-12)


def test_an_explicit_up_wins_over_the_cameras():
    views = orbit(world=Rotation.random(random_state=3).as_matrix())
    np.testing.assert_array_equal(scene_from_splat("+z", views), scene_from_splat("+z"))


def test_auto_takes_what_the_file_says_after_the_cameras_and_before_the_floor():
    facts = FileFacts(up=(0.0, 0.0, 1.0), up_from="'Vertical axis: z'")
    splats = replace(make_splats(50, 0), facts=facts)
    matrix, source = upright("auto", (), splats)
    np.testing.assert_allclose(matrix, scene_from_splat("+z"), atol=1e-12)
    assert source == "the file, by 'Vertical axis: z'"
    assert upright("auto", orbit(), splats)[1] == "the cameras"
    assert upright("-y", (), splats)[1] == "asked for"
    tilted = replace(splats, facts=replace(facts, up=(0.6, 0.0, 0.8)))
    np.testing.assert_allclose(upright("auto", (), tilted)[0][:3, :3] @ [0.6, 0, 0.8], [0, 1, 0], atol=1e-12)
