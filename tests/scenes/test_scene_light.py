"""The light that generated scenes are seen by, and the score that meshes of them get."""

import numpy as np
import pytest

from relight.light.environment import Environment
from scenes.light import WHITE_PERCENTILE, WHITE_POINT, distant_lights, exposure
from scenes.score import DISTANCES, score
from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import fibonacci_sphere


def test_distant_lights_of_a_constant_sky_are_its_irradiance():
    sky = Environment(np.full((32, 64, 3), [1.0, 2.0, 0.5], np.float32), "even")
    toward, light, texels = distant_lights(sky, 4096)
    np.testing.assert_allclose(np.linalg.norm(toward, axis=1), 1.0, atol=1e-6)
    assert len(np.unique(texels)) == len(texels) == len(light)
    # All of 4 pi; the sum over rows by their middles is 1 + (pi / H)^2 / 24 of it.
    np.testing.assert_allclose(light.sum(axis=0), 4 * np.pi * np.array([1.0, 2.0, 0.5]), rtol=1e-3)
    for normal in fibonacci_sphere(7):
        received = np.maximum(toward @ normal, 0) @ light
        np.testing.assert_allclose(received, np.pi * np.array([1.0, 2.0, 0.5]), rtol=0.02)


def test_one_lit_texel_is_one_light_from_its_direction_and_black_is_none():
    radiance = np.zeros((8, 16, 3), np.float32)
    radiance[2, 5] = 3.0
    sky = Environment(radiance, "one")
    toward, light, texels = distant_lights(sky)
    strongest = int(light.sum(axis=1).argmax())
    assert texels[strongest] == 2 * 16 + 5
    latitude, longitude = np.pi * (0.5 - 2.5 / 8), np.pi * (1 - 2 * 5.5 / 16)
    expected = [np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)]
    np.testing.assert_allclose(toward[strongest], expected, atol=1e-6)
    with pytest.raises(InputError, match="night: black"):
        distant_lights(Environment(np.zeros((8, 16, 3), np.float32), "night"))


def test_exposure_takes_the_bright_part_to_the_white_point_whatever_its_unit():
    radiance = np.random.default_rng(0).gamma(1.0, 1.0, (500, 3))
    exposed = radiance * exposure(radiance)
    assert np.percentile(exposed.max(axis=1), WHITE_PERCENTILE) == pytest.approx(WHITE_POINT)
    np.testing.assert_allclose(exposed, 7 * radiance * exposure(7 * radiance))


def ball(radius=1.0, rings=24):
    """A sphere of latitude rings, faces outwards: points (V, 3), faces (F, 3)."""
    u, v = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(2 * rings) * np.pi / rings, indexing="ij")
    points = radius * np.stack([np.sin(u) * np.cos(v), np.cos(u), -np.sin(u) * np.sin(v)], axis=-1).reshape(-1, 3)
    index = np.arange(len(points)).reshape(u.shape)
    after = np.roll(index, -1, axis=1)
    quads = np.stack([index[:-1], index[1:], after[1:], after[:-1]], axis=-1).reshape(-1, 4)
    faces = quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    a, b, c = (points[faces[:, k]] for k in range(3))
    return points, faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 1e-9]


def test_a_mesh_scores_by_how_far_off_it_is_and_by_how_its_faces_turn():
    true = ball()
    same = score(true, true, samples=40_000)
    assert (
        same[f"F@{DISTANCES[-1]}"] > 0.999
        and same["normal"] > 0.995
        and same["signed"] == pytest.approx(same["normal"], abs=1e-3)
    )
    points, faces = true
    inside_out = score((points, faces[:, ::-1]), true, samples=40_000)
    assert inside_out["signed"] == pytest.approx(-same["signed"], abs=2e-3)
    assert inside_out["normal"] == pytest.approx(same["normal"], abs=2e-3)
    # Off by .75% of the diagonal: too far for the two strict distances, near enough for the last one.
    diagonal = 2 * np.sqrt(3)
    off = score(ball(1 + 0.0075 * diagonal), true, samples=40_000)
    assert off[f"F@{DISTANCES[0]}"] == off[f"F@{DISTANCES[1]}"] == 0.0 and off[f"F@{DISTANCES[2]}"] > 0.9


def test_only_what_two_cameras_see_counts():
    true = ball()
    points, faces = true
    half = points, faces[(points[faces].mean(axis=1)[:, 2] > -0.2)]
    front = np.array([[0.0, 0.0, 4.0], [0.3, 0.0, 4.0]])
    assert score(half, true, front, samples=20_000)[f"F@{DISTANCES[-1]}"] > 0.99
    assert score(half, true, samples=20_000)[f"F@{DISTANCES[-1]}"] < 0.9
