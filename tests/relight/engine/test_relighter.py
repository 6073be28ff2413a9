"""The Relighter, and the relight command around it."""

import json
import subprocess
import sys

import numpy as np
import open3d as o3d
import pytest

from relight import Environment, Relighter, cli
from relight.options import DEFAULT_TOLERANCE
from relight.transfer import DEFAULT_BANDS, METHODS
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import write_mesh_ply
from splat2mesh.scene.scene import Scene


def mesh_of(shape, seed=0):
    shape.compute_vertex_normals()
    vertices = np.asarray(shape.vertices, np.float32)
    colors = np.random.default_rng(seed).integers(0, 256, vertices.shape).astype(np.uint8)
    faces = np.asarray(shape.triangles, np.int32)
    return Mesh(vertices, np.asarray(shape.vertex_normals, np.float32), faces, colors)


def turned(mesh, angle_deg):
    """The mesh after an active Ry(+angle): +z goes to +x."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    matrix = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    vertices, normals = ((a @ matrix.T).astype(np.float32) for a in (mesh.vertices, mesh.normals))
    return Mesh(vertices, normals, mesh.faces, mesh.colors_srgb)


@pytest.fixture(scope="module")
def torus():
    return mesh_of(o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, 24, 16))


@pytest.fixture(scope="module")
def sphere():
    return mesh_of(o3d.geometry.TriangleMesh.create_sphere(1.0, 24))


@pytest.fixture(scope="module")
def light():
    """A rough random sky, with colour and direction."""
    return Environment(np.random.default_rng(1).gamma(1.0, 1.0, (8, 16, 3)).astype(np.float32), "rough")


def constant(color):
    return Environment(np.tile(np.float32(color), (4, 8, 1)), "constant")


# -- Relighter


@pytest.mark.parametrize("method", [method for method in METHODS if method != "neural-gash"])  # it guesses
def test_constant_sky_gives_its_radiance_times_albedo(sphere, method):
    relighter = Relighter(Scene([sphere]), method, rays=32)
    sky = np.array([0.5, 1.0, 3.0], np.float32)
    # float32 rounding of 100 coefficients, of which 99 are rounding themselves
    np.testing.assert_allclose(relighter.shade(constant(sky)), np.tile(sky, (len(sphere.vertices), 1)), rtol=2e-6)
    albedo = linear_from_srgb(sphere.colors_srgb / 255.0)
    np.testing.assert_allclose(relighter.shade(constant(sky), albedo), sky * albedo, rtol=2e-6)


@pytest.mark.parametrize("limit", [10**6, 250, 80])
def test_chunks_change_no_bit(torus, limit):
    whole = Relighter(Scene([torus]), bands=4, rays=32).transfer
    scene = Scene.from_mesh(torus, limit)
    row = {vertex.tobytes(): index for index, vertex in enumerate(torus.vertices)}
    rows = [row[vertex.tobytes()] for vertex in scene.vertices]
    assert (len(scene.chunks) > 1) == (limit < len(torus.vertices))
    np.testing.assert_array_equal(Relighter(scene, bands=4, rays=32).transfer, whole[rows])


def test_chunks_shadow_each_other(sphere):
    # A sphere of radius 1 straight above, at distance d = 1.1 of its centre, hides 1 / d^2 of the lobe.
    above = Mesh(sphere.vertices + np.float32([0, 2.1, 0]), sphere.normals, sphere.faces, sphere.colors_srgb)
    radiance = Relighter(Scene([sphere, above]), rays=1024).shade(constant([1, 1, 1]))
    lower, height = radiance[: len(sphere.vertices), 0], sphere.vertices[:, 1]
    # The facets lie up to 1% inside the sphere; the silhouette crosses few of 1024 strata.
    assert lower[height.argmax()] == pytest.approx(1 - 1 / 1.1**2, abs=0.025)
    np.testing.assert_allclose(lower[height < -0.1], 1.0, rtol=2e-6)


def test_transfer_is_computed_once(torus, light):
    relighter = Relighter(Scene([torus]), rays=8)
    before = relighter.transfer
    relighter.shade(light)
    relighter.shade(light.rotated(30.0))
    assert relighter.transfer is before
    assert before.shape == (len(torus.vertices), DEFAULT_BANDS**2) and before.dtype == np.float32


@pytest.mark.parametrize(("method", "tolerance"), [("analytic", 1e-5), ("raytraced", 0.05)])
def test_turning_the_light_is_turning_the_mesh_back(torus, light, method, tolerance):
    # Ray traced, the turned mesh has other ray sets: 128 rays leave 2 to 3% noise on either side.
    def shade(mesh, environment):
        return Relighter(Scene([mesh]), method, bands=6, rays=128).shade(environment)

    lit, back = shade(torus, light.rotated(75.0)), shade(turned(torus, -75.0), light)
    assert np.linalg.norm(lit - back) < tolerance * np.linalg.norm(lit)
    wrong = shade(turned(torus, 75.0), light)
    assert np.linalg.norm(lit - wrong) > 0.1 * np.linalg.norm(lit)


@pytest.mark.parametrize("method", ["analytic", "raytraced"])
@pytest.mark.parametrize(("row", "column"), [(1, 3), (8, 8), (14, 30), (8, 20)])
def test_one_lit_pixel_lights_the_side_it_shines_on(sphere, method, row, column):
    image = np.zeros((16, 32, 3), np.float32)
    image[row, column] = 100.0
    latitude, longitude = np.pi * (0.5 - (row + 0.5) / 16), np.pi * (1 - 2 * (column + 0.5) / 32)
    toward = [np.sin(longitude) * np.cos(latitude), np.sin(latitude), np.cos(longitude) * np.cos(latitude)]
    radiance = Relighter(Scene([sphere]), method, rays=64).shade(Environment(image))[:, 0]
    facing = sphere.normals @ toward
    assert facing[radiance.argmax()] > np.cos(np.radians(10))  # vertices are 7.5 degrees apart
    expected = np.maximum(facing, 0) * radiance.max()
    assert np.abs(radiance - expected).max() < 0.05 * radiance.max()  # 10 bands ring by 2 to 3%


def test_ringing_below_zero_is_zero(sphere):
    image = np.zeros((16, 32, 3), np.float32)
    image[8, 8] = 100.0
    relighter = Relighter(Scene([sphere]), "analytic", bands=3)
    assert (relighter.transfer @ Environment(image).sh(3)).min() < 0
    assert relighter.shade(Environment(image)).min() == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"method": "magic"}, "expected one of auto"),
        ({"bands": 0}, "from 1 to 10"),
        ({"bands": 11}, "from 1 to 10"),
        ({"rays": 0}, "from 1 to 65536"),
        ({"seed": -1}, "seed"),
    ],
)
def test_options_out_of_range_are_refused(torus, options, message):
    with pytest.raises(InputError, match=message):
        Relighter(Scene([torus]), **options)


def test_albedo_of_another_mesh_is_refused(torus, light):
    with pytest.raises(InputError, match=r"shape \(384, 3\), found \(3,\)"):
        Relighter(Scene([torus]), "analytic").shade(light, np.ones(3))


# -- the command


@pytest.fixture
def scene_folder(tmp_path, torus):
    folder = tmp_path / "ring"
    Scene.from_mesh(torus, 250).save(folder)
    return folder


def relight(*arguments):
    """Exit code of the command, run in this process with few rays."""
    return cli.main(["--albedo", "captured", *map(str, arguments), "--rays", "8"])


def test_writes_what_was_asked_for(scene_folder, capsys):
    assert relight(scene_folder, "--format", "glb", "ply", "npy", "png", "--rotate", "405") == 0
    folder = scene_folder / "relit" / "studio_45"
    files = {"relit.glb", "relit.ply", "radiance.npy", "preview.png"}
    assert {path.name for path in folder.iterdir()} == files | {"report.json"}
    assert set(capsys.readouterr().out.split()) == {str(folder / name) for name in files}

    scene = Scene.load(scene_folder)
    radiance = np.load(folder / "radiance.npy")
    albedo = linear_from_srgb(scene.colors_srgb / np.float32(255))
    relighter = Relighter(scene, rays=8, tolerance=DEFAULT_TOLERANCE)
    expected = relighter.shading(Environment.load("studio").rotated(45.0), albedo)
    np.testing.assert_array_equal(radiance, expected.radiance)

    report = json.loads((folder / "report.json").read_text())
    assert report["vertices"] == len(radiance) and report["chunks"] == len(scene.chunks) > 1
    settings = expected.settings
    assert (report["method"], report["rays"], report["seed"]) == ("raytraced", 8, 0)
    assert (report["bands"], set(report["effects"])) == (settings.bands, settings.effects)
    assert report["plan"]["settings"]["bands"] == settings.bands and report["plan"]["checked_error"] > 0
    assert report["rays_traced"] > 0
    assert report["angle_deg"] == 45.0 and set(report["files"]) == files
    assert report["exposure"] > 0 and report["peak_mb"] > 10 and report["warnings"] == []
    assert {"load", "environment", "transfer", "shade", "preview"} <= set(report["seconds"])


def test_whole_turns_write_equal_bytes(scene_folder, tmp_path):
    outputs = [tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    for angle, output in zip(("45", "405", "-315"), outputs, strict=True):
        assert relight(scene_folder, "--rotate", angle, "-o", output, "--format", "npy") == 0
    first, *others = [(output / "radiance.npy").read_bytes() for output in outputs]
    assert others == [first, first]


def test_a_range_writes_a_folder_for_each_angle(scene_folder, tmp_path):
    output = tmp_path / "turntable"
    assert relight(scene_folder, "--rotate", "0:360:120", "-o", output, "--format", "npy", "--env", "noon") == 0
    assert sorted(path.name for path in output.iterdir()) == ["noon_0", "noon_120", "noon_240"]
    alone = tmp_path / "alone"
    assert relight(scene_folder, "--rotate", "120", "-o", alone, "--format", "npy", "--env", "noon") == 0
    assert (alone / "radiance.npy").read_bytes() == (output / "noon_120" / "radiance.npy").read_bytes()


@pytest.mark.parametrize(
    ("text", "angles"),
    [
        ("405", [45.0]),
        ("-90", [270.0]),
        ("0:1:0.25", [0.0, 0.25, 0.5, 0.75, 1.0]),
        ("0:0.3:0.1", [0.0, 0.1, 0.2, 0.3]),
        ("20:-20:-20", [20.0, 0.0, 340.0]),
        ("0:720:180", [0.0, 180.0]),
        ("-1e-12", [0.0]),
    ],
)
def test_angles(text, angles):
    assert cli.angles_from(text) == angles


@pytest.mark.parametrize(
    "text", ["", "north", "nan", "inf", "1:2", "0:90:0", "0:90:-10", "0:90:nan", "0:360:1e-9", "1:2:3:4"]
)
def test_angles_that_make_no_sense_are_refused(text):
    with pytest.raises(InputError, match="--rotate"):
        cli.angles_from(text)


def test_albedo_file_and_white(scene_folder, tmp_path):
    """Direct light is proportional to the albedo, to the bit; what bounces is not."""
    count, direct = len(Scene.load(scene_folder).vertices), ("--effects", "shadows,sun", "--format", "npy")
    np.save(tmp_path / "half.npy", np.full((count, 3), 0.5))
    for choice, output in (("white", "w"), (tmp_path / "half.npy", "h")):
        assert relight(scene_folder, "--albedo", choice, "-o", tmp_path / output, *direct) == 0
    white, half = (np.load(tmp_path / output / "radiance.npy") for output in "wh")
    np.testing.assert_array_equal(half, 0.5 * white)


def test_exposure_is_in_stops(scene_folder, tmp_path):
    assert relight(scene_folder, "--exposure", "-3", "-o", tmp_path / "dark", "--format", "npy") == 0
    assert json.loads((tmp_path / "dark" / "report.json").read_text())["exposure"] == 0.125


def test_a_mesh_file_is_lit_beside_the_caller(tmp_path, torus, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_mesh_ply("ring.ply", torus)
    assert relight("ring.ply", "--method", "analytic", "--format", "npy") == 0
    report = json.loads((tmp_path / "ring_relit" / "studio_0" / "report.json").read_text())
    assert (report["method"], report["rays"], report["vertices"]) == ("analytic", 0, len(torus.vertices))


def test_environment_repairs_reach_the_report(scene_folder, tmp_path, capsys):
    import OpenEXR

    image = np.ones((8, 16, 3), np.float32)
    image[0, 0] = np.nan
    OpenEXR.File({}, {"RGB": OpenEXR.Channel(image)}).write(str(tmp_path / "holed.exr"))
    assert relight(scene_folder, "--env", tmp_path / "holed.exr", "-o", tmp_path / "out", "--format", "npy") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["environment"]["repaired_pixels"] == {"NaN": 1}
    (message,) = report["warnings"]
    assert f"warning: {message}" in capsys.readouterr().err


def bad_albedo(path, array):
    np.save(path, array)
    return path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["missing"], "no such scene"),
        (["SCENE/chunks"], "relight takes mesh files directly"),
        (["SCENE", "--env", "nowhere.exr"], "nowhere.exr"),
        (["SCENE", "--bands", "11"], "from 1 to 10"),
        (["SCENE", "--rays", "0"], "from 1 to 65536"),
        (["SCENE", "--exposure", "nan"], "stops"),
        (["SCENE", "--exposure", "1e9"], "stops"),
        (["SCENE", "--rotate", "0:90"], "START:STOP:STEP"),
        (["SCENE", "--seed", "-1"], "seed"),
        (["SCENE", "--albedo", "nowhere.npy"], "no such file"),
        (["SCENE", "--capture-env", "nowhere.exr"], "nowhere.exr"),
        (["SCENE", "--capture-env", "noon", "--albedo", "white"], "--capture-env"),
        (["SCENE", "--format", "splat"], "without a splat"),
        (["SCENE", "--tolerance", "0"], "above 0"),
        (["SCENE", "--budget", "-1"], "above 0"),
        (["SCENE", "--budget", "1", "--tolerance", "0.1"], "expected one of them"),
        (["SCENE", "--plan", "--method", "neural-gash", "--albedo", "white"], "nothing to plan"),
        (["SCENE", "--albedo", "SCENE/scene.json"], ".npy format"),
        (["SCENE", "--albedo", "short.npy"], "expected numbers of shape"),
        (["SCENE", "--albedo", "bright.npy"], "from 0 to 1"),
        (["SCENE", "-o", "taken"], "exists already"),
        (["SCENE", "-o", "taken", "--overwrite"], "does not replace it"),
        (["SCENE", "-o", "SCENE", "--overwrite"], "does not replace it"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(scene_folder, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(scene_folder.parent)
    (scene_folder.parent / "taken").mkdir()
    (scene_folder.parent / "taken" / "notes.txt").write_text("not to be lost")
    count = len(Scene.load(scene_folder).vertices)
    np.save("short.npy", np.ones((count - 1, 3)))
    np.save("bright.npy", np.full((count, 3), np.nan))
    before = sorted(scene_folder.parent.rglob("*"))
    # A later --rays would win over a bad one, so here the command runs as given.
    assert cli.main([argument.replace("SCENE", "ring") for argument in arguments]) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1
    assert printed.err.startswith("error: ") and message in printed.err
    assert sorted(scene_folder.parent.rglob("*")) == before


def test_results_of_other_settings_are_replaced_only_on_request(scene_folder, tmp_path, capsys):
    output = tmp_path / "out"
    assert relight(scene_folder, "-o", output, "--format", "npy") == 0
    written = (output / "report.json").read_bytes()
    assert relight(scene_folder, "-o", output, "--format", "npy", "--seed", "7") == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (output / "report.json").read_bytes() == written
    assert relight(scene_folder, "-o", output, "--format", "npy", "--seed", "7", "--overwrite") == 0
    assert (output / "report.json").read_bytes() != written


def test_as_a_process(scene_folder, tmp_path):
    command = [
        sys.executable,
        "-m",
        "relight.cli",
        str(scene_folder),
        "--rays",
        "8",
        "--albedo",
        "captured",
        "-o",
        str(tmp_path / "out"),
    ]
    done = subprocess.run([*command, "--json"], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    result = json.loads(done.stdout)
    assert result["outputs"] == [str(tmp_path / "out")]
    assert result["reports"] == [json.loads((tmp_path / "out" / "report.json").read_text())]


def test_help_and_version_import_nothing_heavy():
    code = "import sys; from relight.cli import main\ntry: main(sys.argv[1:])\nfinally: print(*sys.modules)"
    for flag, words in (("--help", "examples:"), ("--version", "relight 0")):
        done = subprocess.run([sys.executable, "-c", code, flag], capture_output=True, text=True, timeout=60)
        assert done.returncode == 0 and words in done.stdout
        assert not {"numpy", "open3d", "numba", "rich"} & set(done.stdout.splitlines()[-1].split())
