"""The light that arrives at a place."""

import warnings

import numpy as np
import open3d as o3d
import pytest

from relight.insert.probe import LightAround, ProbedScene, usual_place
from relight.insert.surroundings import Sky
from relight.light.environment import Environment
from relight.output.probe_files import balls, irradiance_of
from relight.sh import harmonics
from relight.transfer.occluder import Occluder
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.sphere import fibonacci_sphere, row_solid_angles, texel_directions
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

PLACE = np.array([1.0, 2.0, 3.0])
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def irradiance(image, normals):
    """Irradiance over pi of unit normals (N, 3) in a lat-long picture."""
    return harmonics.evaluate(normals, 3) @ irradiance_of(image)


def shell(display, radius=5.0, count=6000):
    """Splats all around PLACE. display: function of unit directions (N, 3), colours (N, 3)."""
    directions = fibonacci_sphere(count)
    sh = ((display(directions) - 0.5) / SH_C0).astype(np.float32)[:, None]
    quats = np.tile(np.float32([1, 0, 0, 0]), (count, 1))
    scales = np.full((count, 3), 0.15, np.float32)
    means = (PLACE + radius * directions).astype(np.float32)
    return Splats(means, scales, quats, np.full(count, 0.99, np.float32), sh)


def around(matrix):
    """A scene of one small triangle, far below, in a frame."""
    back = np.linalg.inv(matrix)
    points = np.float32([[-0.1, -40, 0], [0.1, -40, 0], [0, -40, 0.1]]) + back[:3, 3].astype(np.float32)
    normals = np.tile(np.float32([0, 1, 0]), (3, 1))
    mesh = Mesh(points, normals, np.int32([[0, 2, 1]]), np.zeros((3, 3), np.uint8))
    return Scene([mesh], scene_from_splat=matrix), Occluder(points, normals, mesh.faces)


@pytest.mark.parametrize("matrix", [np.eye(4), UPSIDE_DOWN], ids=["upright", "upside down"])
def test_each_direction_shows_what_the_splats_show_there(matrix):
    scene, occluder = around(matrix)
    image = ProbedScene(shell(lambda d: 0.4 + 0.3 * d), scene, occluder, LightAround([], None), 1.0).picture(PLACE)
    found = Environment(image, "probe").lookup(fibonacci_sphere(200))
    display = 0.4 + 0.3 * fibonacci_sphere(200) @ matrix[:3, :3]  # directions of the splats' own frame
    wanted = np.where(display <= 0.04045, display / 12.92, ((display + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(found, wanted, atol=0.03)  # a splat in four degrees


def test_a_clipped_sky_takes_what_is_known_of_it_and_any_other_stays():
    scene, occluder = around(np.eye(4))
    sky = Environment(np.full((8, 16, 3), 4.0, np.float32), "sky")
    light = LightAround([Sky(sky, 0.5)], None)
    white = ProbedScene(shell(lambda d: np.ones_like(d)), scene, occluder, light, 2.0).picture(PLACE)
    np.testing.assert_allclose(np.median(white, axis=(0, 1)), 4.0, rtol=1e-3)
    grey = ProbedScene(shell(lambda d: np.full_like(d, 0.6)), scene, occluder, light, 2.0).picture(PLACE)
    np.testing.assert_allclose(np.median(grey, axis=(0, 1)), ((0.6 + 0.055) / 1.055) ** 2.4, atol=0.08)


def test_a_place_inside_of_a_body_is_warned_of_and_one_beside_it_is_not():
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    points = np.asarray(ball.vertices, np.float32)
    mesh = Mesh(points, points, np.asarray(ball.triangles, np.int32), np.zeros(points.shape, np.uint8))
    scene, occluder = Scene([mesh]), Occluder(points, points, mesh.faces)
    splats = shell(np.ones_like).take(slice(0, 1))
    with pytest.warns(DataWarning, match="the probe at 0.2,0,0 stands inside something"):
        ProbedScene(splats, scene, occluder, LightAround([], None), 1.0).picture((0.2, 0.0, 0.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        ProbedScene(splats, scene, occluder, LightAround([], None), 1.0).picture((1.1, 0.0, 0.0))


def test_where_no_splat_is_the_sky_is_seen():
    scene, occluder = around(np.eye(4))
    sky = Environment(np.random.default_rng(1).random((8, 16, 3)).astype(np.float32), "sky")
    splats, light = shell(np.ones_like).take(slice(0, 1)), LightAround([Sky(sky, 1.0)], None)
    image = ProbedScene(splats, scene, occluder, light, 3.0).picture(PLACE)
    found = Environment(image, "probe").lookup(fibonacci_sphere(100)[:90])
    np.testing.assert_allclose(found, 3.0 * sky.lookup(fibonacci_sphere(100)[:90]), atol=0.05)


def test_a_lamp_is_as_bright_as_it_was_solved_for():
    scene, occluder = around(np.eye(4))
    glow = np.full((3, 3), 20.0, np.float32)
    splats, light = shell(np.ones_like).take(slice(0, 1)), LightAround([], glow)
    image = ProbedScene(splats, scene, occluder, light, 0.5).picture((0.0, -39.9, 0.03))
    assert image.max() == pytest.approx(10.0, rel=1e-4)
    assert image[:128].max() < 1.0


def test_an_even_light_gives_a_grey_ball_its_albedo_on_all_sides():
    np.testing.assert_allclose(irradiance(np.full((32, 64, 3), 0.7, np.float32), fibonacci_sphere(50)), 0.7, rtol=1e-3)
    assert balls(np.full((32, 64, 3), 0.7, np.float32)).shape == (360, 720, 3)


def test_one_lit_texel_lights_the_ball_from_its_direction():
    image = np.zeros((64, 128, 3), np.float32)
    image[20, 100] = 100.0
    share = row_solid_angles(64, 128)[20, 0] / np.pi * 100.0
    directions = fibonacci_sphere(400)
    best = directions[irradiance(image, directions)[:, 0].argmax()]
    assert best @ texel_directions(64, 128)[20, 100] > 0.98  # of 400, 6 degrees apart
    # Nine harmonics of a clamped cosine: 17/16 of it where it faces the light.
    assert irradiance(image, directions).max() == pytest.approx(17 / 16 * share, rel=0.05)


def test_a_probe_that_nobody_places_stands_where_the_capture_stood():
    scene, occluder = around(UPSIDE_DOWN)
    scene.capture.update({"from": "inside", "eyes": [[0, 1, 4], [9, 9, 9], [1, 1, 1]]})
    np.testing.assert_allclose(usual_place(scene, occluder), [0, -1, -4])
