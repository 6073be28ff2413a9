"""The reference: closed forms, brute force over every texel, and that more directions change little."""

import numpy as np
import open3d as o3d
import pytest

from relight import Environment
from relight.light.projections import row_solid_angles, texel_directions
from relight.sh import harmonics
from relight.transfer.occluder import Occluder
from relight.transfer.reference import light_directions, reference
from scenes.plain_rays import raytraced
from splat2mesh.base.errors import InputError

EVERY = slice(None)


def mesh_arrays(mesh):
    mesh.compute_vertex_normals()
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.vertex_normals), np.asarray(mesh.triangles)


@pytest.fixture(scope="module")
def torus():
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, 24, 16)
    return mesh_arrays(mesh + o3d.geometry.TriangleMesh.create_sphere(0.3, 8))


def convex():
    vertices, _, faces = mesh_arrays(o3d.geometry.TriangleMesh.create_sphere(1.0, 10))
    return Occluder(vertices, vertices, faces)


def spiky(height=64, seed=0):
    """Noise of which a few texels hold half the energy."""
    image = np.random.default_rng(seed).exponential(size=(height, 2 * height, 3)).astype(np.float32)
    image[np.random.default_rng(seed).random((height, 2 * height)) < 0.002] *= 300
    return image


def difference(a, b):
    return np.linalg.norm(a - b) / np.linalg.norm(b)


def test_constant_sky_gives_one_where_nothing_hides_it():
    radiance = reference(convex(), EVERY, Environment(np.ones((32, 64, 3))))
    assert radiance.dtype == np.float32
    np.testing.assert_allclose(radiance, 1.0, atol=1e-3)  # the kink of the cosine, 1 / directions and the cells' noise


@pytest.mark.parametrize("angle_deg", [0.0, 130.0])
def test_one_texel_gives_the_cosine_law(angle_deg):
    image = np.zeros((128, 256, 3), np.float32)
    image[30, 50] = [3e6, 2e6, 1e6]
    occluder = convex()
    angle = np.radians(angle_deg)
    x, y, z = texel_directions(128, 256)[30, 50]
    toward = np.array([np.cos(angle) * x + np.sin(angle) * z, y, np.cos(angle) * z - np.sin(angle) * x])
    expected = (
        np.maximum(occluder.normals @ toward, 0)[:, None] * image[30, 50] * row_solid_angles(128, 256)[30] / np.pi
    )
    found = reference(occluder, EVERY, Environment(image).rotated(angle_deg))
    # A patch of 1.4 degrees averages the cosine: 1e-4 of it, and 0.6 degrees of penumbra at the terminator.
    np.testing.assert_allclose(found, expected, atol=4e-3 * expected.max())


@pytest.mark.parametrize("count", [64, 1000, 8192])
@pytest.mark.parametrize("height", [8, 64, 256])
def test_every_texels_energy_counts_and_keeps_its_place(count, height):
    environment = Environment(spiky(height)).rotated(25.0)
    lights = light_directions(environment, count)
    assert len(lights) <= 3 * count
    areas = row_solid_angles(height, 2 * height)[..., None]
    total = (environment.radiance.astype(np.float64) * areas).sum(axis=(0, 1))
    np.testing.assert_allclose(lights.weights.sum(axis=0), total, rtol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(lights.directions, axis=1), 1.0, atol=1e-12)
    # Directions are centroids: a linear function of them is short by the square of a cell's radius, 1 / count.
    moment = environment.sh(2)[[3, 1, 2]] / np.sqrt(3 / (4 * np.pi))
    np.testing.assert_allclose(lights.directions.T @ lights.weights, moment, atol=2.0 / count * total.max())


def test_black_light_has_no_directions():
    environment = Environment(np.zeros((8, 16, 3)))
    assert len(light_directions(environment, 64)) == 0
    assert not reference(convex(), EVERY, environment, 64).any()


def test_point_under_a_ball_against_every_texel():
    """Visibility in closed form: rays from a plane against a sphere, over all texels and their quarters."""
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 100)
    ball.translate((0.0, 1.5, 0.0))
    vertices, normals, faces = mesh_arrays(ball)
    points = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 1.0], [0.0, 0, -1.5]], np.float32)
    offsets = np.array([[[0.0, 0, 0]], [[1e-3, 0, 0]], [[0, 0, 1e-3]]], np.float32)
    corners = (points + offsets).reshape(12, 3)
    below = np.stack([np.arange(4), np.arange(4) + 8, np.arange(4) + 4], axis=1)
    up = np.tile([0.0, 1.0, 0.0], (12, 1))
    mesh = np.concatenate([corners, vertices]), np.concatenate([up, normals]), np.concatenate([below, faces + 12])
    image = spiky()
    found = reference(Occluder(*mesh), slice(0, 4), Environment(image), 8192)

    toward = texel_directions(512, 1024).reshape(-1, 3)  # 8 x 8 parts of each texel
    weight = (image.repeat(8, axis=0).repeat(8, axis=1) * row_solid_angles(512, 1024)[..., None]).reshape(-1, 3)
    for point, radiance in zip(points.astype(float), found, strict=True):
        center = np.array([0.0, 1.5, 0.0]) - point
        along = toward @ center
        hidden = (along > 0) & (center @ center - along**2 < 1.0)
        expected = (np.maximum(toward[:, 1], 0) * ~hidden) @ weight / np.pi
        # The ball's facets stand 5e-4 inside it; cells that its outline cuts hold 1 / 8192 each.
        np.testing.assert_allclose(radiance, expected, rtol=4e-3)


def test_more_directions_converge(torus):
    occluder = Occluder(*torus)
    environment = Environment(spiky(128, seed=1))
    best = reference(occluder, EVERY, environment, 32768)
    errors = [difference(reference(occluder, EVERY, environment, count), best) for count in (512, 2048, 8192)]
    assert errors[2] < 3e-3
    assert errors[1] < 0.5 * errors[0] and errors[2] < 0.5 * errors[1]  # fourfold directions: 4^-0.75 = 0.35


def test_smooth_light_agrees_with_its_harmonics(torus):
    """Light of three bands loses nothing to them: transfer and reference share no part but the visibility."""
    coefficients = np.random.default_rng(2).normal(size=(9, 3)) * 0.15
    coefficients[0] = 3.5
    directions = texel_directions(256, 512)
    image = (harmonics.evaluate(directions.reshape(-1, 3), 3) @ coefficients).reshape(256, 512, 3)
    assert image.min() > 0
    occluder = Occluder(*torus)
    expected = raytraced(occluder, EVERY, 3, 2**14) @ coefficients
    assert difference(reference(occluder, EVERY, Environment(image)), expected) < 2e-3


def test_turning_the_light_is_turning_the_mesh_back(torus):
    vertices, normals, faces = torus
    angle = np.radians(40.0)
    turn = np.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]])
    environment = Environment(spiky(64, seed=3))
    turned = reference(Occluder(vertices, normals, faces), EVERY, environment.rotated(40.0))
    back = reference(Occluder((vertices @ turn).astype(np.float32), normals @ turn, faces), EVERY, environment)
    # The same rays but for float32, so that a few meet an edge on its other side.
    assert difference(turned, back) < 1e-3


@pytest.mark.parametrize("count", [63, 1000.5, 2**18])
def test_direction_counts_out_of_range_are_refused(count):
    with pytest.raises(InputError, match="from 64 to 65536"):
        reference(convex(), EVERY, Environment(np.ones((4, 8, 3))), count)
