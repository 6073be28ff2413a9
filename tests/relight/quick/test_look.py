"""The first look against colours computed from normals: a ball of known albedo under one light, relit by another."""

import numpy as np
import pytest
from ball_splats import RADIUS, solid_ball
from disc_splats import plain
from place_splats import room

from relight.albedo.said import Said
from relight.light.environment import Environment
from relight.light.projections import texel_directions
from relight.quick.look import CapturedDay
from splat2mesh.base.errors import InputError
from splat2mesh.base.progress import Stages
from splat2mesh.base.sphere import row_solid_angles
from splat2mesh.capture import capture_of
from splat2mesh.options import ConvertOptions
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.splats.formats.encoding import sh_from_color
from splat2mesh.splats.splats import SH_C0

DIRECTIONS = texel_directions(32, 64).reshape(-1, 3)
TO_SCENE = np.diag([1.0, -1.0, -1.0])  # of a splat whose y points down


def soft(toward, color):
    """A soft lamp on a dim sky."""
    toward = np.asarray(toward, float) / np.linalg.norm(toward)
    lobe = np.exp(4.0 * (DIRECTIONS @ toward - 1.0))[:, None] * np.asarray(color)
    return Environment((0.15 + lobe).reshape(32, 64, 3).astype(np.float32), "soft")


def irradiance(environment, normals):
    """(N, 3) over pi, by a sum over texels."""
    area = np.repeat(row_solid_angles(32, 64).ravel(), 64)[:, None]
    cosine = np.maximum(normals @ DIRECTIONS.T, 0.0)
    return cosine @ (area * environment.lookup(DIRECTIONS)) / np.pi


@pytest.fixture(scope="module")
def lit(tmp_path_factory):
    """A striped ball under a lamp from the left: (capture, normals of splats, albedo, light)."""
    folder = tmp_path_factory.mktemp("lit")
    ball, light = solid_ball(6000), soft([-1, 0.6, 0.3], [2.0, 1.6, 1.2])
    normals = ball.means / np.linalg.norm(ball.means, axis=1, keepdims=True) @ TO_SCENE.T
    albedo = np.where(np.sin(6.0 * ball.means[:, 1:2]) > 0, 0.5, 0.25) * np.ones(3)
    ball.sh[:, 0] = sh_from_color(srgb_from_linear((albedo * irradiance(light, normals)).astype(np.float32)))
    write_inria_ply(folder / "ball.ply", ball)
    capture = capture_of(folder / "ball.ply", ConvertOptions(up="-y", stand="outside"), Stages())
    return capture, normals, albedo, light


def test_a_known_light_is_replaced(lit):
    capture, normals, albedo, light = lit
    day = CapturedDay.of(capture, Said(), light)
    new = soft([1, 0.4, -0.5], [0.8, 1.2, 2.0])
    look = day.under(new, exposure=1.0)
    shell = np.linalg.norm(capture.loaded.means, axis=1) > 0.97 * RADIUS
    found = linear_from_srgb(np.clip(look.splats.sh[shell, 0] * SH_C0 + 0.5, 0, 1).astype(np.float32))
    expected = (albedo * irradiance(new, normals))[shell]
    level = np.median(found / expected)  # the exposure of the known light is estimated
    error = np.sqrt(np.mean((srgb_from_linear((level * expected).astype(np.float32)) - srgb_from_linear(found)) ** 2))
    assert -20 * np.log10(error) > 28.0


def test_the_captured_light_changes_nothing_much(lit):
    capture, _, _, light = lit
    day = CapturedDay.of(capture, Said(), light)
    brightness = day.brightness / light.mean_luminance
    look = day.under(light, exposure=float(brightness))
    change = np.abs(look.splats.sh[:, 0] - capture.loaded.sh[:, 0]) * SH_C0
    assert np.median(change) < 0.01


def test_rows_keep_all_but_their_colours(lit):
    capture, _, _, light = lit
    look = CapturedDay.of(capture, Said(), light).under(soft([0, 1, 0], [1, 1, 1]))
    for name in ("means", "scales", "quats_wxyz", "opacities"):
        np.testing.assert_array_equal(getattr(look.splats, name), getattr(capture.loaded, name))
    assert look.picture.dtype == np.uint8 and look.picture.shape[1] == 960


def test_a_closed_room_has_no_first_look(tmp_path):
    write_inria_ply(tmp_path / "room.ply", room())
    capture = capture_of(tmp_path / "room.ply", ConvertOptions(up="+y"), Stages())
    with pytest.raises(InputError, match="it is closed"):
        CapturedDay.of(capture, Said())


@pytest.mark.parametrize("opacity", [0.02, 0.25])
def test_what_has_no_surface_has_no_first_look(tmp_path, opacity):
    write_inria_ply(tmp_path / "fog.ply", plain(np.random.default_rng(0).normal(size=(500, 3)), 0.05, opacity=opacity))
    capture = capture_of(tmp_path / "fog.ply", ConvertOptions(up="+y"), Stages())
    with pytest.raises(InputError, match="only 0 of its splats are solid"):
        CapturedDay.of(capture, Said())
