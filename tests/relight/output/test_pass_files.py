"""Render passes: together they are the picture, in both colour spaces, from any camera."""

import numpy as np
import OpenEXR
import pytest
import trimesh
from hard_scenes import joined as joined_parts
from hard_scenes import knobbed_torus, sheet

from relight import Environment, LightingOptions, RelightRequest
from relight.cli import main
from relight.jobs.folders import relight_files
from relight.jobs.job import Job
from relight.light.color_spaces import SPACES
from relight.output.picture import in_frame
from relight.output.preview import NOWHERE, Preview
from scenes.cameras import write_inria_cameras
from splat2mesh.base.errors import InputError
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

WAYS = ("direct", "bounced", "lamps", "captured")
LAMP = "0,2,0 radius=.1 color=2700K"


@pytest.fixture(scope="module")
def scene():
    """A coloured torus with a knob over a floor."""
    vertices, normals, faces = joined_parts(knobbed_torus(), sheet(np.linspace(-2.5, 2.5, 12), -0.8))
    colors = np.random.default_rng(3).integers(20, 230, vertices.shape).astype(np.uint8)
    return Scene([Mesh(vertices.astype(np.float32), normals, faces.astype(np.int32), colors)])


def sunny():
    image = np.full((32, 64, 3), 0.4, np.float32)
    image[8, 20] = (900.0, 800.0, 600.0)
    return Environment(image, "sunny")


def request(scene, output=None, lamps=(), **more):
    lighting = LightingOptions(tolerance=0.2, effects="shadows,sun,bounces", placed=lamps)
    asked = {"formats": ("passes",), "albedo": "captured", "caching": "none", "output": output}
    return RelightRequest(scene, lighting=lighting, **{"env": sunny(), **asked, **more})


def channels(path):
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: each.pixels for name, each in file.channels().items()}, file.header()


def layer(found, name, letters="RGB"):
    return np.stack([found[f"{name}.{letter}" if name else letter] for letter in letters], axis=2)


@pytest.fixture(scope="module", params=list(SPACES))
def made(request, scene, tmp_path_factory):
    """A colour space, and the channels and header of passes in it."""
    asked = globals()["request"](scene, tmp_path_factory.mktemp("out") / "out", (LAMP,), color_space=request.param)
    return request.param, *channels(relight_files(asked).files[0])


def assert_add_up(found):
    light = sum(layer(found, name) for name in WAYS if f"{name}.R" in found)
    for each in (light, layer(found, "irradiance")):
        # A product, a quotient and three sums of float32.
        np.testing.assert_allclose(layer(found, "albedo") * each / np.pi, layer(found, ""), rtol=1e-6, atol=1e-7)


def test_albedo_times_all_light_over_pi_is_the_picture(made):
    _, found, _ = made
    assert {"direct.R", "bounced.R", "lamps.R", "sun.R"} <= found.keys() and "captured.R" not in found
    assert_add_up(found)
    assert all(layer(found, name).max() > 0.05 for name in ("direct", "bounced", "lamps", "sun"))
    assert (layer(found, "sun") <= layer(found, "direct") * (1 + 1e-5) + 1e-6).all()


def test_the_picture_is_what_the_preview_shows(made, scene):
    space, found, _ = made
    job = Job(request(scene, lamps=(LAMP,)))
    shaded = next(job.shaded())
    height, width = found["A"].shape
    image, alpha = Preview(scene, None, width, height).values(shaded.shading.radiance * np.float32(shaded.exposure))
    np.testing.assert_array_equal(found["A"], alpha)
    wanted = image @ SPACES[space].matrix.T
    np.testing.assert_allclose(layer(found, ""), wanted, rtol=1e-5, atol=1e-5)
    assert 0.2 < alpha.mean() < 1.0 and ((alpha > 0.0) & (alpha < 1.0)).any()


def test_the_file_names_its_primaries_and_holds_floats(made):
    space, found, header = made
    np.testing.assert_allclose(header["chromaticities"], SPACES[space].chromaticities, rtol=1e-6)
    assert {each.dtype for each in found.values()} == {np.dtype(np.float32)}
    assert all(np.isfinite(each).all() for each in found.values())


def test_normals_and_depth_are_the_meshs(scene, tmp_path):
    floor = Scene([Mesh(*(np.asarray(a) for a in (*_floor(), np.full((4, 3), 127, np.uint8))))])
    cameras = [View.look_at([0, 3, 0], [0, 0, 0], [0, 0, -1], 60.0, 48, 32)]
    write_inria_cameras(tmp_path / "cameras.json", cameras)
    done = relight_files(request(floor, tmp_path / "out", cameras=tmp_path / "cameras.json"))
    found, _ = channels(done.files[0])
    assert done.reports[0]["files"] == ["passes.exr"] and found["A"].shape == (32, 48)
    inside = found["A"] == 1.0
    np.testing.assert_allclose(layer(found, "normals", "XYZ")[inside], [[0, 1, 0]] * inside.sum(), atol=1e-6)
    np.testing.assert_allclose(found["Z"][inside], 3.0, rtol=1e-5)
    assert (found["Z"][found["A"] == 0.0] == NOWHERE).all() and (found["A"] == 0.0).any()


def _floor():
    vertices = np.float32([[-1, 0, -1], [-1, 0, 1], [1, 0, -1], [1, 0, 1]])
    return vertices, np.tile(np.float32([0, 1, 0]), (4, 1)), np.int32([[0, 1, 2], [1, 3, 2]])


def test_several_cameras_give_a_file_each(scene, tmp_path):
    views = [View.look_at([x, 2, 4], [0, 0, 0], [0, 1, 0], 50.0, 40, 30) for x in (-1, 0, 2)]
    write_inria_cameras(tmp_path / "cameras.json", views)
    done = relight_files(request(scene, tmp_path / "out", cameras=tmp_path / "cameras.json"))
    assert done.reports[0]["files"] == ["passes/0001.exr", "passes/0002.exr", "passes/0003.exr"]
    seen = [channels(path)[0] for path in done.files]
    assert len({each["Z"].tobytes() for each in seen}) == 3
    for each in seen:
        assert_add_up(each)


def test_captured_light_is_a_pass_of_its_own(scene, tmp_path):
    done = relight_files(request(scene, tmp_path / "out", (LAMP,), env="captured"))
    found, _ = channels(done.files[0])
    assert "captured.R" in found and "direct.R" not in found
    assert_add_up(found)


def test_a_view_sees_a_moved_scene_as_it_saw_it_before():
    view = View.look_at([1, 2, 3], [0.2, 0, 0], [0, 1, 0], 50.0, 40, 30)
    turn = np.array([[0, 0, 2.0, 1], [0, -2.0, 0, 2], [2.0, 0, 0, -3], [0, 0, 0, 1]])
    points = np.random.default_rng(0).normal(size=(20, 3))
    pixels, depth = view.project(points)
    again, farther = in_frame(view, np.linalg.inv(turn))[0].project(points @ turn[:3, :3].T + turn[:3, 3])
    np.testing.assert_allclose(again, pixels, atol=1e-9)
    np.testing.assert_allclose(farther, 2 * depth, atol=1e-9)  # a unit is two


def test_cameras_and_colour_space_belong_to_passes():
    for more in ({"cameras": "sparse/0"}, {"color_space": "acescg"}):
        with pytest.raises(InputError, match="it belongs to the format passes"):
            RelightRequest("garden", **more)
    with pytest.raises(InputError, match="color_space"):
        RelightRequest("garden", formats=("passes",), color_space="rec2020")


def test_the_command_takes_them(scene, tmp_path, capsys):
    scene.save(tmp_path / "scene")
    write_inria_cameras(tmp_path / "cameras.json", [View.look_at([0, 2, 4], [0, 0, 0], [0, 1, 0], 50.0, 40, 30)])
    words = [
        str(tmp_path / "scene"),
        "--format",
        "passes",
        "--albedo",
        "captured",
        "--method",
        "analytic",
        "--no-cache",
    ]
    words += ["--color-space", "acescg", "-o", str(tmp_path / "out")]
    assert main([*words, "--cameras", str(tmp_path / "cameras.json")]) == 0
    found, header = channels(tmp_path / "out" / "passes.exr")
    assert found["A"].shape == (30, 40) and header["chromaticities"][0] == pytest.approx(0.713)
    capsys.readouterr()
    assert main([*words, "--cameras", str(tmp_path / "none.json"), "--overwrite"]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1


@pytest.mark.filterwarnings("ignore:the light of the capture is unknown")
@pytest.mark.parametrize("env", [sunny(), "captured"], ids=["environment", "captured"])
def test_parts_are_all_light_with_shadows_of_what_is_put_in(scene, tmp_path, env):
    box = trimesh.creation.box((0.6, 0.6, 0.6))
    (tmp_path / "box.obj").write_text(trimesh.exchange.obj.export_obj(box, include_normals=False))
    asked = request(scene, None, (LAMP,), env=env, inserted=[f"{tmp_path / 'box.obj'} at=1.9,0,1.9"])
    job = Job(asked)
    shaded = next(job.shaded())
    assert shaded.inserted.ratio.min() < 0.9
    parts = job.light_parts(shaded)
    total = sum(part for name, part in parts.items() if name != "sun")
    np.testing.assert_allclose(total, shaded.shading.radiance, rtol=1e-5, atol=1e-6)
    assert all((part >= -1e-6).all() for part in parts.values())
