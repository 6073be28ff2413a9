"""The splat2mesh command: what it writes, and one line, exit code 2 and nothing written for every bad input."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest
from ball_splats import GREEN, RADIUS, RED, solid_ball
from sog_samples import sog_parts, store_folder

from splat2mesh import __version__
from splat2mesh.cli import main
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import write_mesh_ply
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import source_splats
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.extract import EFFORTS, Effort


def write_splat(path, change=None, count=3000):
    """Write the first `count` splats of the ball.

    change: may alter the file's float rows in place: (N, 17) x y z, n n n, dc dc dc, opacity, scales, quaternion.
    """
    write_inria_ply(path, solid_ball().take(slice(count)))
    if change:
        content = path.read_bytes()
        start = content.index(b"end_header\n") + len(b"end_header\n")
        rows = np.frombuffer(content[start:], "<f4").reshape(count, 17).copy()
        change(rows)
        path.write_bytes(content[:start] + rows.tobytes())
    return path


def run(*arguments, **options):
    command = [sys.executable, "-m", "splat2mesh.cli", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300, **options)


def files_below(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


SETTINGS = ("--detail", "draft", "--vertices", "2000", "--max-chunk-vertices", "600")


@pytest.fixture
def quick(monkeypatch):
    """A detail below draft, for what does not depend on accuracy."""
    monkeypatch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    """One conversion by the real command in an empty folder: its process, and that folder."""
    folder = tmp_path_factory.mktemp("work")
    write_splat(folder / "ball.v2.ply")
    process = run("ball.v2.ply", *SETTINGS, "--json", "-q", cwd=folder)
    return process, folder


@pytest.mark.slow
def test_json_is_one_object_on_stdout_and_stderr_is_silent(converted):
    process, folder = converted
    assert (process.returncode, process.stderr) == (0, "")
    assert process.stdout.count("\n") == 1
    result = json.loads(process.stdout)
    scene = Scene.load(folder / "ball")
    assert result["scene"] == "ball" and result["splats"] == 3000
    assert result["vertices"] == scene.statistics["vertices"] and result["faces"] == len(scene.faces)
    assert result["chunks"] == len(scene.chunks) >= 4
    assert max(len(chunk.vertices) for chunk in scene.chunks) <= 600
    assert all(seconds >= 0 for seconds in result["seconds"].values()) and result["peak_mb"] > 10


def test_the_default_output_is_the_inputs_name_without_its_suffixes_and_nothing_else(converted):
    _, folder = converted
    chunks = [f"ball/chunks/{k:04d}.ply" for k in range(len(Scene.load(folder / "ball").chunks))]
    assert files_below(folder) == [
        "ball",
        "ball.v2.ply",
        "ball/chunks",
        *chunks,
        "ball/measured.npz",
        "ball/mesh.glb",
        "ball/preview.png",
        "ball/scene.json",
    ]


def test_the_scene_is_the_sphere_upright_in_its_colours_and_outward(converted):
    _, folder = converted
    scene = Scene.load(folder / "ball")
    assert 1800 <= len(scene.vertices) <= 2300  # seams of the chunks included
    radius = np.linalg.norm(scene.vertices, axis=1)
    # The level set lies outside the centres by about a thickness, which the dilation of training raises to 0.05.
    assert np.median(radius) == pytest.approx(RADIUS + 0.05, abs=0.05)
    assert np.abs(radius - np.median(radius)).max() < 0.05
    assert ((scene.normals * scene.vertices).sum(axis=1) > 0.9 * radius).all()
    # -y up in the file is +y up in the scene: red on top.
    np.testing.assert_array_equal(scene.scene_from_splat, np.diag([1.0, -1.0, -1.0, 1.0]))
    for color, side in ((RED, scene.vertices[:, 1] > 0.4), (GREEN, scene.vertices[:, 1] < -0.4)):
        error = np.abs(scene.colors_srgb[side] / 255 - color).max(axis=1)
        assert np.median(error) < 0.02 and (error < 0.1).mean() > 0.95
    assert scene.source["file"] == "ball.v2.ply"
    eye = np.array(scene.preview_camera["eye"])
    assert np.linalg.norm(eye) > RADIUS


def test_the_same_input_and_seed_give_the_same_bytes(converted, capsys, full_pictures):
    _, folder = converted
    again = folder / "again"  # beside the first, so that the splat has the same path from either
    assert main([str(folder / "ball.v2.ply"), "-o", str(again), *SETTINGS, "-q"]) == 0
    assert capsys.readouterr() == ("", "")
    assert files_below(again) == files_below(folder / "ball")
    for name in files_below(again):
        if (again / name).is_file():
            assert (again / name).read_bytes() == (folder / "ball" / name).read_bytes(), name


def cut_short(path):
    write_splat(path)
    path.write_bytes(path.read_bytes()[:-1000])


def mesh_ply(path):
    corners = np.eye(3, dtype=np.float32)
    write_mesh_ply(path, Mesh(corners, corners, np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8)))


def all_nan(rows):
    rows[:, :3] = np.nan


def transparent(rows):
    rows[:, 9] = -20.0  # opacity logit


BAD_FILES = {
    "missing": (lambda path: None, "no such file"),
    "empty": (lambda path: path.touch(), "empty"),
    "cut short": (cut_short, "3000"),
    "text": (lambda path: path.write_text("this is no splat\n" * 50), "not a splat file"),
    "binary junk": (lambda path: path.write_bytes(bytes(range(256)) * 20), "not a splat file"),
    "a mesh": (mesh_ply, "mesh"),
    "all NaN": (lambda path: write_splat(path, all_nan), "0 of 3000 splats are usable"),
    "one splat": (lambda path: write_splat(path, count=1), "1 of 1 splats are usable"),
    "all transparent": (lambda path: write_splat(path, transparent), "3000 invisible"),
    "a folder": (lambda path: path.mkdir(), "no splat file lies in it"),
}


def expect_refusal(capsys, code, message):
    out, err = capsys.readouterr()
    assert code == 2 and out == ""
    assert err.startswith("error: ") and err.count("\n") == 1 and err.endswith("\n")
    assert re.search(message, err)


@pytest.mark.parametrize("kind", BAD_FILES)
def test_a_bad_file_is_one_line_and_code_2_and_nothing_is_written(tmp_path, monkeypatch, capsys, kind):
    make, message = BAD_FILES[kind]
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "ball.ply")
    before = files_below(tmp_path)
    code = main(["ball.ply", "--detail", "draft"])
    _, err = capsys.readouterr()
    lines = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert code == 2
    assert len(lines) == 1 and lines[0].startswith("error: ") and re.search(message, lines[0]), err
    assert files_below(tmp_path) == before


@pytest.mark.parametrize("suffix", ["splat", "spz", "sog", "compressed.ply", "xyz"])
def test_junk_of_every_format_is_one_line_and_code_2(tmp_path, capsys, suffix):
    path = tmp_path / f"ball.{suffix}"
    path.write_bytes(b"junk" * 8)  # 32 bytes: one record of a .splat
    code = main([str(path), "-o", str(tmp_path / "out")])
    expect_refusal(capsys, code, re.escape(path.name))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--up", "sideways"], r"--up sideways: expected one of auto \+y -y \+z -z"),
        (["--detail", "perfect"], "--detail perfect: expected one of draft normal fine"),
        (["--surface", "magic"], "--surface magic: expected one of field sugar"),
        (["--background", "blur"], "--background blur: expected one of cut keep"),
        (["--foliage", "hedge"], "--foliage hedge: expected one of mesh cards none"),
        (["--background", "blur", "--plan"], "--background blur: expected one of cut keep"),
        (["--vertices", "0"], "--vertices 0"),
        (["--vertices", "-5"], "--vertices -5"),
        (["--max-chunk-vertices", "2"], "--max-chunk-vertices 2"),
        (["--cameras", "nowhere"], "cannot read nowhere: no such file.* expected a COLMAP folder"),
        (["--cameras", "ball.ply"], r"ball\.ply: not valid JSON .* expected a COLMAP folder"),
        (["--lod", "fine"], "--lod fine: expected auto or the number of a level"),
        (["--lod", "0"], r"--lod 0: ball\.ply has no levels of detail"),
    ],
)
def test_a_bad_setting_is_one_line_and_code_2_and_nothing_is_written(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    write_splat(tmp_path / "ball.ply")
    expect_refusal(capsys, main(["ball.ply", *arguments]), message)
    assert files_below(tmp_path) == ["ball.ply"]


def test_an_output_that_exists_is_refused_before_any_work_and_kept(tmp_path, capsys):
    (tmp_path / "ball.ply").write_text("not even read")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "thesis.tex").write_text("precious")
    arguments = [str(tmp_path / "ball.ply"), "-o", str(tmp_path / "out")]
    expect_refusal(capsys, main(arguments), "exists already.*--overwrite")
    expect_refusal(capsys, main([*arguments, "--overwrite"]), "holds no scene.json, so --overwrite does not replace it")
    assert (tmp_path / "out" / "thesis.tex").read_text() == "precious"


def test_overwrite_replaces_a_scene_by_a_complete_one_and_nan_splats_are_counted(tmp_path, capsys, quick):
    out = tmp_path / "out"
    corners = np.eye(3, dtype=np.float32)
    Scene([Mesh(corners, corners, np.array([[0, 1, 2]]), np.zeros((3, 3), np.uint8))]).save(out)
    before = (out / "scene.json").read_bytes()
    (tmp_path / "bad.ply").write_text("text")
    assert main([str(tmp_path / "bad.ply"), "-o", str(out), "--overwrite"]) == 2
    assert (out / "scene.json").read_bytes() == before
    capsys.readouterr()

    def spoil(rows):
        rows[::100, 1] = np.nan

    path = write_splat(tmp_path / "ball.ply", spoil)
    assert (
        main(
            [
                str(path),
                "-o",
                str(out),
                "--overwrite",
                "--detail",
                "draft",
                "--up",
                "+y",
                "--max-chunk-vertices",
                "20000",
            ]
        )
        == 0
    )
    stdout, stderr = capsys.readouterr()
    summary, picture, following = stdout.splitlines()
    assert picture.endswith("preview.png shows splat and mesh") and (out / "preview.png").is_file()
    assert re.fullmatch(r".*out: [\d,]+ vertices, [\d,]+ faces in 2 chunks, from 3,000 splats, [\d.]+ s", summary)
    assert re.fullmatch(r"  next: relight .*out --env sunset", following)
    assert stderr == "warning: dropped splats: 30 with a NaN or infinite value (of 3000)\n"
    scene = Scene.load(out)
    assert scene.statistics["splats"] == 3000 and scene.statistics["splats_non_finite"] == 30
    np.testing.assert_array_equal(scene.scene_from_splat, np.eye(4))
    assert files_below(tmp_path)[-1] == "out/scene.json" and len(files_below(tmp_path)) == 9


def test_a_bad_file_by_the_real_command(tmp_path):
    (tmp_path / "ball.ply").write_text("this is no splat\n")
    process = run("ball.ply", cwd=tmp_path)
    assert (process.returncode, process.stdout) == (2, "")
    assert process.stderr.startswith("error: ") and process.stderr.count("\n") == 1
    assert files_below(tmp_path) == ["ball.ply"]


def test_plan_writes_nothing_and_lists_the_work(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_splat(tmp_path / "ball.ply")
    (tmp_path / "ball").mkdir()  # an output that exists does not matter to a plan
    assert main(["ball.ply", "--plan", "--json"]) == 0
    out, err = capsys.readouterr()
    assert err == "" and out.count("\n") == 1
    plan = json.loads(out)
    assert plan["splats"] == 3000 and plan["sh_degree"] == 0
    np.testing.assert_allclose(plan["bounds_in_splat_frame"], [[-RADIUS] * 3, [RADIUS] * 3], atol=0.2)
    assert main(["ball.ply", "--plan"]) == 0
    out, err = capsys.readouterr()
    assert "3000" in out and err == ""
    assert files_below(tmp_path) == ["ball", "ball.ply"]


HEAVY = ("numpy", "scipy", "numba", "open3d", "pycolmap", "rich")


@pytest.mark.parametrize("flag", ["--help", "--version"])
def test_help_and_version_import_nothing_heavy(flag):
    script = (
        "import sys\nfrom splat2mesh.cli import main\n"
        f"try:\n    main([{flag!r}])\nexcept SystemExit as stop:\n    assert not stop.code\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)\n"
    )
    process = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60)
    assert (process.returncode, process.stderr) == (0, "[]\n")
    assert process.stdout == f"splat2mesh {__version__}\n" if flag == "--version" else "examples:" in process.stdout


def test_help_names_every_flag_with_a_word_about_it():
    process = run("--help")
    flags = ("--output", "--cameras", "--vertices", "--max-chunk-vertices", "--up", "--detail", "--surface")
    for flag in (*flags, "--background", "--seed"):
        assert re.search(rf"{flag} [A-Z]+\s+\S+", process.stdout), flag
    for flag in ("--overwrite", "--plan", "--json", "--quiet", "--verbose"):
        assert re.search(rf"{flag}\s+\S+", process.stdout), flag


def test_no_input_is_a_usage_error():
    process = run()
    assert (process.returncode, process.stdout) == (2, "")
    assert "INPUT" in process.stderr


def streamed_ball(folder):
    """The ball as a streamed SOG of two levels, the finer one in two tiles."""
    ball = solid_ball()
    tiles = {"0_0": ball.take(slice(1500)), "0_1": ball.take(slice(1500, 3000)), "1_0": ball.take(slice(0, 3000, 2))}
    for name, splats in tiles.items():
        (folder / name).mkdir(parents=True)
        store_folder(folder / name, sog_parts(splats, 2))
    lods = [{"0": {"file": 0, "offset": 0, "count": 1500}, "1": {"file": 2, "offset": 0, "count": 1500}}]
    lods.append({"0": {"file": 1, "offset": 0, "count": 1500}})
    names = [f"{name}/meta.json" for name in tiles]
    tree = {"children": [{"lods": each} for each in lods]}
    (folder / "lod-meta.json").write_text(json.dumps({"lodLevels": 2, "filenames": names, "tree": tree}))
    return folder / "lod-meta.json"


def test_a_streamed_sog_becomes_a_scene_that_finds_its_splats_again(tmp_path, monkeypatch, capsys, quick):
    source = streamed_ball(tmp_path / "ball")
    monkeypatch.chdir(tmp_path)
    assert main(["ball/lod-meta.json", *SETTINGS, "--from", "outside"]) == 0
    assert "from 3,000 splats of level 0" in capsys.readouterr().out
    scene = Scene.load("ball_scene")  # never the folder that is read
    assert scene.source["lod"] == 0 and scene.source["path"] == str(source)
    splats, paths = source_splats(scene)
    assert paths == [source] and len(splats) == 3000
    assert main(["ball", "--lod", "1", "-o", "coarse", *SETTINGS, "-q", "--from", "outside"]) == 0
    assert len(source_splats(Scene.load("coarse"))[0]) == 1500
    assert main(["ball", "--plan", "--lod", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["splats"] == 1500


def test_a_streamed_sog_with_a_missing_tile_is_one_line_and_code_2(tmp_path, monkeypatch, capsys):
    source = streamed_ball(tmp_path / "ball")
    (source.parent / "0_1" / "meta.json").unlink()
    monkeypatch.chdir(tmp_path)
    before = files_below(tmp_path)
    expect_refusal(capsys, main(["ball/lod-meta.json", *SETTINGS]), r"0_1/meta\.json is missing")
    assert files_below(tmp_path) == before


def test_cameras_of_another_scene_are_one_line_and_code_2(tmp_path, monkeypatch, capsys):
    folder = tmp_path / "garden" / "point_cloud" / "iteration_7000"
    folder.mkdir(parents=True)
    write_splat(folder / "point_cloud.ply")
    camera = {"width": 64, "height": 64, "fx": 80.0, "fy": 80.0, "rotation": np.eye(3).tolist()}
    (tmp_path / "garden" / "cameras.json").write_text(json.dumps([camera | {"position": [0, 0, 9.0]}]))
    monkeypatch.chdir(tmp_path)
    before = files_below(tmp_path)
    expect_refusal(
        capsys, main([str(folder / "point_cloud.ply"), *SETTINGS]), "none of its 1 cameras sees a solid splat"
    )
    assert files_below(tmp_path) == before
    (tmp_path / "garden" / "cameras.json").write_text(json.dumps([camera | {"position": [0, 0, -9.0]}]))
    assert main([str(folder / "point_cloud.ply"), "--plan", "--json"]) == 0
    planned = json.loads(capsys.readouterr().out)
    assert planned["views"] == "1 of 1 trained" and planned["up_from"] == "the cameras"
