"""probes/probes.json: what it says of lights that are known, and of which places."""

import json

import numpy as np
import open3d as o3d
import pytest
from probe_lights import AXIS, LOBE_ERROR, lobe, lobe_irradiance, picture

from relight.insert.probe import LightAround, ProbedScene, ProbeGrid
from relight.insert.surroundings import Sky
from relight.light.environment import Environment
from relight.output.probe_files import NAME, irradiance_of, places_of, write_probe_set, write_probes
from relight.request import RelightRequest
from relight.sh import harmonics
from relight.transfer.occluder import Occluder
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.sphere import fibonacci_sphere
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

NORMALS = fibonacci_sphere(200)
UPSIDE_DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def ball(matrix=UPSIDE_DOWN):
    """A scene that is a ball of radius 1 at the middle."""
    made = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    points = np.asarray(made.vertices, np.float32)
    mesh = Mesh(points, points, np.asarray(made.triangles, np.int32), np.zeros(points.shape, np.uint8))
    return Scene([mesh], scene_from_splat=matrix), Occluder(points, points, mesh.faces)


def speck():
    """A splat that hides nothing."""
    one = np.ones((1, 3), np.float32)
    return Splats(99 * one, 0.01 * one, np.float32([[1, 0, 0, 0]]), np.float32([0.01]), np.zeros((1, 1, 3), np.float32))


def read(folder):
    content = json.loads((folder / NAME).read_text())
    assert (content["format"], content["version"]) == ("relight-probes", 1)
    return np.array([each["position"] for each in content["probes"]]), np.array([p["sh"] for p in content["probes"]])


def irradiance(sh):
    """By the sentence of the documents: the sum of the nine rows times the basis, at NORMALS."""
    return harmonics.evaluate(NORMALS, 3) @ sh


def test_a_constant_sky_is_its_radiance_whatever_the_normal():
    sh = irradiance_of(np.full((32, 64, 3), 0.7, np.float32))
    np.testing.assert_allclose(irradiance(sh), 0.7, rtol=1e-6)
    np.testing.assert_allclose(sh[0], 0.7 * np.sqrt(4 * np.pi), rtol=1e-6)  # Y00 = 1 / sqrt(4 pi)


def test_light_of_the_first_two_degrees_is_exact():
    linear = irradiance_of(picture(lambda d: (1.0 + d @ AXIS)[..., None] * np.ones(3)))
    # A texel counts as its middle: 64 rows are off by (pi / 64)^2 / 24 at most.
    np.testing.assert_allclose(irradiance(linear), (1 + 2 / 3 * NORMALS @ AXIS)[:, None] * np.ones(3), atol=1e-3)
    square = irradiance_of(picture(lambda d: ((d @ AXIS) ** 2)[..., None] * np.ones(3)))
    known = 1 / 3 + 1 / 4 * ((NORMALS @ AXIS) ** 2 - 1 / 3)
    np.testing.assert_allclose(irradiance(square), known[:, None] * np.ones(3), atol=1e-3)


def test_a_single_lobe_lights_as_its_closed_form():
    np.testing.assert_allclose(irradiance(irradiance_of(picture(lobe))), lobe_irradiance(NORMALS), atol=LOBE_ERROR)


@pytest.mark.parametrize("matrix", [np.eye(4), UPSIDE_DOWN], ids=["upright", "upside down"])
def test_the_file_is_in_the_frame_of_the_scene_whatever_that_of_the_splat(tmp_path, matrix):
    scene, occluder = ball(matrix)
    light = LightAround([Sky(Environment(picture(lobe), "sky"), 1.0)], None)
    places = [(0.0, 3.0, 0.5), (2.0, 0.0, -3.0)]
    names = write_probes(tmp_path, ProbedScene(speck(), scene, occluder, light, 2.0), list(map(np.array, places)))
    assert names[-1] == NAME and "probe_2.exr" in names
    positions, sh = read(tmp_path)
    np.testing.assert_allclose(positions, places @ matrix[:3, :3].T)
    # Far from the ball, which hides 4% of the sphere or less, light is that of the sky, exposed.
    for each in sh:
        assert np.abs(irradiance(each) - 2 * lobe_irradiance(NORMALS)).mean() < 0.03


def test_places_inside_of_something_are_dropped_with_a_warning_that_counts_them(tmp_path):
    scene, occluder = ball()
    asked = []

    def light_at(number, place):
        asked.append((number, *np.round(place, 6)))
        return np.full((8, 16, 3), float(number), np.float32)

    places = np.array([[0.0, 3.0, 0.0], [0.3, 0.1, 0.0], [0.0, 0.0, 1.3]])
    with pytest.warns(DataWarning, match="dropped 1 of 3 probes"):
        assert write_probe_set(tmp_path, scene, occluder, places, light_at) == [NAME]
    positions, sh = read(tmp_path)
    np.testing.assert_allclose(positions, places[[0, 2]])
    assert asked == [(0, 0, -3, 0), (2, 0, 0, -1.3)]  # in the frame of the splats
    np.testing.assert_allclose(sh[1, 0], 2.0 * np.sqrt(4 * np.pi), rtol=1e-5)
    with pytest.warns(DataWarning, match="dropped 1 of 1 probes, .*: no probes/probes.json"):
        assert write_probe_set(tmp_path / "none", scene, occluder, places[1:2], light_at) == []


def test_a_grid_lies_between_two_corners_or_about_the_scene():
    scene, _ = ball()
    corners = [(1.0, 2.0, 3.0), (-1.0, 0.0, 3.0)]
    np.testing.assert_allclose(
        places_of(ProbeGrid((2, 1, 2)), corners, scene),  # the frame of the scene is upside down
        [[-1, -1, -3], [1, -1, -3], [-1, -1, -3], [1, -1, -3]],
    )
    inside = places_of(ProbeGrid((3, 3, 3)), [], scene)
    assert len(inside) == 27 and 0.9 < np.abs(inside).max() <= 1.0
    assert len(places_of(None, corners[:1], scene)) == 0 == len(places_of(None, [], scene))
    np.testing.assert_allclose(places_of(None, corners, scene), np.array(corners) * [1, -1, -1])


def test_a_grid_leaves_probe_exr_where_the_capture_stood(tmp_path):
    scene, occluder = ball()
    light, corners = LightAround([Sky(Environment(picture(lobe), "sky"), 1.0)], None), [np.ones(3), 3 * np.ones(3)]
    names = write_probes(tmp_path, ProbedScene(speck(), scene, occluder, light, 1.0), corners, ProbeGrid((1, 1, 2)))
    assert names == ["probe.exr", "probe.png", NAME]
    positions, _ = read(tmp_path)
    np.testing.assert_allclose(positions, [[2, -2, -3], [2, -2, -1]])


def test_a_grid_that_cannot_be_is_refused():
    probe = {"formats": ("probe",)}
    for words, more, message in (
        ("4x2x4", {}, "belongs to the format probe"),
        ("4x2x4", {**probe, "probe_at": ["0,0,0"]}, "a box has two corners"),
        ("4x2", probe, "expected counts along x, y and z"),
        ("0x1x1", probe, "0 probes; expected 1 to 4,096"),
        ("40x40x40", probe, "64,000 probes"),
        ("-1", probe, "a spacing above 0"),
        ("nan", probe, "a spacing above 0"),
    ):
        with pytest.raises(InputError, match=message):
            RelightRequest("garden", probes=words, **more)
    with pytest.raises(InputError, match="larger spacing"):
        ProbeGrid.parse("0.01").within(np.zeros(3), np.ones(3))
    assert ProbeGrid.parse("1.5") == ProbeGrid(None, 1.5)


def test_a_spacing_is_the_largest_between_two_neighbours():
    places = ProbeGrid.parse(".4").within(np.zeros(3), np.array([1.0, 0.4, 0.0]))
    assert len(places) == 4 * 2 * 1
    np.testing.assert_allclose(np.diff(places[:4, 0]), 1 / 3)
