"""New light on a part of a scene: what its files hold, and what is refused before any is written."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ball_splats import solid_ball

from relight import relight_scene
from relight.cli import main
from relight.light.environment import Environment
from relight.splats import write_relit_ply
from scenes import bake, build, exposure
from scenes.sequence import COLUMN
from splat2mesh.scene.color import srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import read_splats, write_inria_ply, write_splats

LIGHT = ["--env", "noon", "--method", "analytic", "--bands", "3"]
PART = "box:at=0,-1,0,size=8,1.5,8"


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    """A folder with ball.ply and its mesh, the whole ball relit in `whole`, a part of it in `part`, the rest in
    `rest`."""
    folder = tmp_path_factory.mktemp("part")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write_inria_ply("ball.ply", solid_ball())
        formats = ["--format", "splat", "glb", "npy", "ply", "png", "-o"]
        for name, words in (("part", ["--only", PART]), ("rest", ["--keep", PART]), ("whole", [])):
            assert main(["ball.ply", *LIGHT, *words, *formats, name]) == 0
    return folder


@pytest.fixture
def here(scene, monkeypatch):
    monkeypatch.chdir(scene)
    return scene


def rows_of(path):
    """The rows of an INRIA PLY as bytes, by its header alone."""
    header, body = path.read_bytes().split(b"end_header\n", 1)
    width = 4 * header.count(b"property float")
    return np.frombuffer(body, np.uint8).reshape(-1, width)


def height_of(scene):
    """The second coordinate of vertices (V,) in the frame of the splat."""
    return (scene.vertices @ np.linalg.inv(scene.scene_from_splat)[:3, :3].T)[:, 1]


def test_outside_the_part_and_its_rim_the_splat_file_keeps_every_bit(here):
    captured = read_splats("ball.ply")
    write_relit_ply(here / "captured.ply", captured, here / "ball.ply")
    before, after = rows_of(here / "captured.ply"), rows_of(here / "part" / "relit_splat.ply")
    np.testing.assert_array_equal(before, rows_of(here / "ball.ply"))
    report = json.loads((here / "part" / "report.json").read_text())["part"]
    same = (before == after).all(axis=1)
    inside = np.abs(captured.means[:, 1] + 1) <= 0.75
    assert report["only"] == [PART] and report["splats"]["part"] == inside.sum() > 500
    assert not same[inside].any() and (~same & ~inside).sum() == report["splats"]["rim"] > 50
    whole = rows_of(here / "whole" / "relit_splat.ply")
    np.testing.assert_array_equal(after[inside], whole[inside])
    rim = ~same & ~inside
    assert np.abs(captured.means[rim, 1] + 1).max() < 0.75 + 0.4  # three splats are .26 apart


def test_what_is_kept_keeps_every_bit_and_the_rest_is_relit(here):
    before, after = rows_of(here / "ball.ply"), rows_of(here / "rest" / "relit_splat.ply")
    whole = rows_of(here / "whole" / "relit_splat.ply")
    inside = np.abs(read_splats("ball.ply").means[:, 1] + 1) <= 0.75
    np.testing.assert_array_equal(after[inside], before[inside])
    relit = (after == whole).all(axis=1)
    rim = json.loads((here / "rest" / "report.json").read_text())["part"]["splats"]["rim"]
    assert (~relit & ~inside).sum() == rim


def test_a_part_in_a_light_of_its_own_leaves_all_others_as_they_were(here):
    words = ["--part", PART, "env=sunset", "rotate=90"]
    formats = ["--format", "splat", "npy", "png"]
    assert main(["ball", *LIGHT, *words, *formats, "-o", "own"]) == 0
    assert main(["ball", "--env", "sunset", *LIGHT[2:], "--rotate", "90", *formats, "-o", "other"]) == 0
    before, after, other = (rows_of(here / name / "relit_splat.ply") for name in ("whole", "own", "other"))
    inside = np.abs(read_splats("ball.ply").means[:, 1] + 1) <= 0.75
    report = json.loads((here / "own" / "report.json").read_text())
    (entry,) = report["parts"]
    assert (entry["part"], entry["env"], entry["rotate"], entry["splats"]["part"]) == (PART, "sunset", 90, inside.sum())
    np.testing.assert_array_equal(after[inside], other[inside])
    changed = (before != after).any(axis=1) & ~inside
    assert 50 < changed.sum() <= entry["splats"]["rim"]
    assert np.abs(read_splats("ball.ply").means[changed, 1] + 1).max() < 0.75 + 0.4  # three splats are .26 apart
    levels = [json.loads((here / name / "report.json").read_text())["exposure"] for name in ("own", "other")]
    whole, own, turned = (np.load(here / name / "radiance.npy") for name in ("whole", "own", "other"))
    within = np.abs(height_of(Scene.load("ball")) + 1) <= 0.749
    np.testing.assert_allclose(own[within] * levels[0], turned[within] * levels[1], rtol=1e-5)
    far = np.abs(height_of(Scene.load("ball")) + 1) > 1.0
    np.testing.assert_array_equal(own[far], whole[far])


def test_a_part_may_only_be_brighter_and_tinted_under_the_light_of_the_capture(here):
    assert main(["ball", *LIGHT[2:], "--part", PART, "exposure=1", "tint=1,.5,.25", "--format", "npy", "-o", "up"]) == 0
    report, scene = json.loads((here / "up" / "report.json").read_text()), Scene.load("ball")
    shown = np.load(here / "up" / "radiance.npy") * np.float32(report["exposure"])
    within, far = np.abs(height_of(scene) + 1) <= 0.749, np.abs(height_of(scene) + 1) > 1.0
    assert report["environment"]["name"] == "captured"
    np.testing.assert_array_equal(shown[far], scene.colors_linear[far])
    color = np.array([1, 0.5, 0.25]) / np.dot([1, 0.5, 0.25], [0.2126, 0.7152, 0.0722])
    np.testing.assert_allclose(shown[within], 2 * color * scene.colors_linear[within], rtol=1e-5)


def test_the_last_part_lies_on_top_and_only_leaves_its_own_rest(here):
    asked = [
        "--only",
        PART,
        "--part",
        "sphere:at=0,-2,0,radius=.5",
        "exposure=-2",
        "--part",
        "sphere:at=0,-2,0,radius=.4",
    ]
    assert main(["ball", *LIGHT, *asked, "env=captured", "--format", "splat", "-o", "top"]) == 0
    before, part, after = (
        rows_of(path) for path in (Path("ball.ply"), *(here / f"{n}/relit_splat.ply" for n in ("part", "top")))
    )
    away = np.linalg.norm(read_splats("ball.ply").means - [0, -2, 0], axis=1)
    np.testing.assert_array_equal(after[away > 0.9], part[away > 0.9])
    assert not (after[(away > 0.41) & (away < 0.5)] == part[(away > 0.41) & (away < 0.5)]).all()
    np.testing.assert_array_equal(after[away <= 0.4], before[away <= 0.4])


def test_vertices_show_the_part_too(here):
    part, whole = (np.load(here / name / "radiance.npy") for name in ("part", "whole"))
    scene = Scene.load("ball")
    exposure = json.loads((here / "part" / "report.json").read_text())["exposure"]
    captured = scene.colors_linear / np.float32(exposure)
    inside, far = np.abs(height_of(scene) + 1) <= 0.749, np.abs(height_of(scene) + 1) > 1.0
    np.testing.assert_array_equal(part[inside], whole[inside])
    np.testing.assert_array_equal(part[far], captured[far])
    assert (here / "part" / "preview.png").read_bytes() != (here / "whole" / "preview.png").read_bytes()


def test_a_part_is_a_setting_of_the_results(here, capsys):
    assert main(["ball", *LIGHT, "--only", "sphere:0,-2,0,radius=1", "-o", "part"]) == 2
    assert "--only box" in capsys.readouterr().err
    assert main(["ball", *LIGHT, "--only", PART, "--format", "splat-glb", "-o", "part"]) == 0
    assert "splats, and" in capsys.readouterr().out


def test_rows_of_an_spz_keep_their_bits(here, monkeypatch):
    (here / "packed").mkdir(exist_ok=True)
    monkeypatch.chdir(here / "packed")
    write_splats("ball.spz", solid_ball(), "spz")
    rows = np.flatnonzero(solid_ball().means[:, 1] > 1.2)
    np.save("rows.npy", rows)
    assert main(["ball.spz", *LIGHT, "--format", "splat", "--only", "rows.npy", "-o", "out"]) == 0
    before, after = read_splats("ball.spz"), read_splats("out/relit_splat.spz")
    same = (before.sh == after.sh).all(axis=(1, 2))
    counts = json.loads((here / "packed" / "out" / "report.json").read_text())["part"]["splats"]
    assert counts["part"] == len(rows)
    assert len(rows) < (~same).sum() + 20 and (~same).sum() <= len(rows) + counts["rim"]


def test_a_mesh_without_splats_has_parts_of_space():
    grid = np.linspace(-1, 1, 9)
    x, z = (each.ravel() for each in np.meshgrid(grid, grid, indexing="ij"))
    cells = np.arange(8)[:, None] * 9 + np.arange(8)
    faces = (cells.reshape(-1, 1) + np.array([0, 1, 10, 0, 10, 9])).reshape(-1, 3).astype(np.int32)
    points = np.stack([x, 0 * x, z], axis=1).astype(np.float32)
    normals = np.tile(np.float32([0, 1, 0]), (81, 1))
    mesh = Mesh(points, normals, faces, np.full((81, 3), 128, np.uint8))
    asked = {"options": "analytic", "bands": 3, "caching": "none"}
    whole = relight_scene(mesh, "noon", **asked)
    part = relight_scene(mesh, "noon", only="box:at=0.5,0,0,size=1,1,3", **asked)
    np.testing.assert_array_equal(part.radiance[x >= 0], whole.radiance[x >= 0])
    np.testing.assert_allclose(part.radiance[x < -0.6] * part.exposure, whole.scene.colors_linear[x < -0.6], rtol=1e-6)
    assert part.report["part"]["vertices"]["all"] == 81


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--only", "box:at=9,9,9,size=1,1,1"], "--only box:at=9,9,9,size=1,1,1: none of 3,000 splats lies in it"),
        (["--keep", "column:mask"], "--keep column:mask: ball.ply has no column mask"),
        (["--only", "rows.txt"], "row 3000: the capture has the rows 0 to 2,999"),
        (["--only", "away.ply"], "--only away.ply: none of its 3,000 points lies in a splat of the capture"),
        (["--only", "sphere:0,0,0"], "a sphere has at and radius, found at"),
        (["--only", "nowhere.ply"], "found no such file"),
        (["--only", PART, "--keep", PART], "--only: it replaces --keep"),
        (["--only", PART, "--insert", "ball.ply"], "--insert: it is of the whole scene"),
        (["--only", PART, "--format", "web"], "--format web: it is of the whole scene"),
        (["--only", PART, "--format", "glb", "--live"], "--live: it is of the whole scene"),
        (["--only", PART, "--view"], "--only: a session shows the whole scene"),
        (["--only", PART, "--quick"], "--only: a first look does not heed it"),
        (["--part", PART], f"--part {PART}: its light has env, rotate, exposure, tint, each as name=value; found none"),
        (["--part", PART, "warmth=2"], f"--part {PART}: its light has env, rotate, exposure, tint"),
        (["--part", PART, "exposure=bright"], f"--part {PART}: exposure bright: expected a number from -10 to 10"),
        (["--part", PART, "tint=mauve"], f"--part {PART}: color mauve: expected a temperature"),
        (["--part", PART, "env=nowhere.exr"], "nowhere.exr"),
        (["--part", "env=noon"], "--part env=noon: it begins with a part"),
        (["--part", "box:at=9,9,9,size=1,1,1", "exposure=1"], "size=1,1,1: none of 3,000 splats lies in it"),
        (["--part", PART, "exposure=1", "--format", "usd"], "--format usd: it is of the whole scene"),
        (["--part", PART, "exposure=1", "--view"], "--part: a session shows the whole scene"),
    ],
)
def test_a_part_that_is_not_there_is_refused_in_one_line_before_anything_is_written(
    tmp_path, monkeypatch, capsys, words, message
):
    monkeypatch.chdir(tmp_path)
    ball = solid_ball()
    write_inria_ply("ball.ply", ball)
    write_inria_ply("away.ply", type(ball)(ball.means + 50, ball.scales, ball.quats_wxyz, ball.opacities, ball.sh))
    (tmp_path / "rows.txt").write_text("0 1 3000")
    assert main(["ball.ply", *LIGHT, *words]) == 2
    said = capsys.readouterr().err
    assert message in said and said.count("\n") == 1
    assert {entry.name for entry in tmp_path.iterdir()} == {"ball.ply", "away.ply", "rows.txt"}


def test_a_part_casts_its_new_shadow_on_the_rest_and_takes_its_captured_one_away():
    truth = build("tabletop", 0, 3000)
    of_part, lights = truth.part == COLUMN, [Environment.load(name) for name in ("noon", "sunset")]
    alone = replace(truth, faces=truth.faces[~of_part[truth.faces].any(axis=1)])
    captured, new = (bake(truth, light) for light in lights)
    changed = new / np.maximum(bake(alone, lights[1]), 1e-6) * bake(alone, lights[0]) / np.maximum(captured, 1e-6)
    shown = np.clip(exposure(captured) * captured, 0, 1)
    colors = np.round(255 * srgb_from_linear(shown)).astype(np.uint8)
    scene = Scene([Mesh(truth.vertices, truth.normals, truth.faces, colors)])
    low, high = truth.vertices[of_part].min(axis=0), truth.vertices[of_part].max(axis=0)
    numbers = [",".join(map(str, each)) for each in ((low + high) / 2, 1.001 * (high - low))]
    asked = {"albedo": "estimated", "capture_env": lights[0], "caching": "none", "bands": 6, "rays": 128}
    asked["only"] = f"box:at={numbers[0]},size={numbers[1]}"
    plain, shadowed = (relight_scene(scene, lights[1], shadow_of_parts=each, **asked) for each in (False, True))
    rim = of_part | (np.abs(truth.vertices - (low + high) / 2) < 0.75 * (high - low)).all(axis=1)
    np.testing.assert_array_equal(shadowed.radiance[of_part], plain.radiance[of_part])
    below = ~rim & (truth.normals[:, 1] < -0.9) & (truth.vertices[:, 1] < 0.0)
    assert below.sum() > 50  # of the table, from where no ray meets the column
    np.testing.assert_array_equal(shadowed.radiance[below], plain.radiance[below])
    seen = ~rim & (shown > 0.02).all(axis=1)
    found = np.log(shadowed.radiance[seen] / plain.radiance[seen])
    wanted = np.log(np.maximum(changed[seen], 0.05))
    passed = np.abs(wanted).max(axis=1) > 0.1  # by a shadow; on so coarse a mesh its edge is a vertex wide
    assert passed.sum() > 50 and np.abs(wanted[passed]).mean() > 0.3
    assert np.abs(found[passed] - wanted[passed]).mean() < 0.4 * np.abs(wanted[passed]).mean()
    assert np.abs(found[~passed]).mean() < 0.02


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ([], "--shadow-of-parts: it is of a part; give --only or --keep"),
        (["--only", PART], "--shadow-of-parts: rays cast it, and the method is analytic"),
    ],
)
def test_a_shadow_needs_a_part_and_rays(here, capsys, words, message):
    assert main(["ball", *LIGHT, *words, "--shadow-of-parts", "--format", "splat", "-o", "refused"]) == 2
    assert message in capsys.readouterr().err and not (here / "refused").exists()
