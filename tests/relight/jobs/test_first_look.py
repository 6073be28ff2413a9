"""The first look at a splat: what is written when, and what replaces it."""

import json

import numpy as np
import pytest
from ball_splats import solid_ball

import relight.jobs.meshing
import splat2mesh.capture
import splat2mesh.scene.sources
from relight.cli import main
from relight.jobs.meshing import existing_scene, scene_at_hand
from splat2mesh.base.progress import Stages
from splat2mesh.options import ConvertOptions
from splat2mesh.pipeline import meshed
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import read_splats, write_inria_ply

FIRST = "ball/relit/noon_0"


@pytest.fixture
def here(tmp_path, monkeypatch):
    """The current folder, with ball.ply."""
    monkeypatch.chdir(tmp_path)
    write_inria_ply("ball.ply", solid_ball())
    return tmp_path


def report(folder):
    return json.loads((folder / "report.json").read_text())


def test_quick_stops_at_the_first_look(here, capsys):
    assert main(["ball.ply", "--env", "noon", "--rotate", "0:90:90", "--quick", "-o", "out"]) == 0
    for name in ("noon_0", "noon_90"):
        found = here / "out" / name
        assert {entry.name for entry in found.iterdir()} == {"preview.png", "relit_splat.ply", "report.json"}
        assert report(found)["state"] == "first look"
        assert len(read_splats(found / "relit_splat.ply")) == 3000
    assert "out/noon_90/preview.png" in capsys.readouterr().out
    assert not (here / "ball").exists()


def test_a_picture_comes_before_the_mesh_and_the_final_one_replaces_it(here, monkeypatch, capsys):
    seen = []

    def watched(*arguments):
        seen.append((report(here / FIRST)["state"], (here / FIRST / "preview.png").read_bytes()))
        return meshed(*arguments)

    monkeypatch.setattr(relight.jobs.meshing, "meshed", watched)
    assert main(["ball.ply", "--env", "noon", "--method", "analytic", "--bands", "3"]) == 0
    assert seen[0][0] == "first look" and "a first look" in capsys.readouterr().err
    final = report(here / FIRST)
    assert "state" not in final and set(final["files"]) == {"relit.glb", "preview.png", "relit_splat.ply"}
    assert (here / FIRST / "preview.png").read_bytes() != seen[0][1]
    assert (here / "ball" / "scene.json").exists() and not list(here.glob(".ball*"))


@pytest.mark.parametrize("albedo", ["estimated", "captured"])
def test_a_fresh_run_decodes_its_splat_once_and_reads_back_no_scene(here, monkeypatch, albedo):
    decoded = []

    def watched(path, *more):
        decoded.append(path)
        return read_splats(path, *more)

    for module in (splat2mesh.capture, splat2mesh.scene.sources, relight.jobs.meshing):
        monkeypatch.setattr(module, "read_splats", watched)
    monkeypatch.setattr(Scene, "load", lambda path: pytest.fail(f"read back {path}"))
    assert main(["ball.ply", "--env", "noon", "--method", "analytic", "--bands", "3", "--albedo", albedo]) == 0
    assert [path.name for path in map(type(here), decoded)] == ["ball.ply"]


def test_a_scene_at_hand_is_as_its_folder_has_it(here):
    made, _ = scene_at_hand("ball.ply", ConvertOptions(detail="draft"), Stages())
    read, again = Scene.load("ball"), existing_scene("ball.ply", ConvertOptions())
    for scene in (made.scene, again.scene):
        for name in ("vertices", "normals", "faces", "colors_srgb", "scene_from_splat", "background_splats", "foliage"):
            found, expected = getattr(scene, name), getattr(read, name)
            assert found.dtype == expected.dtype
            np.testing.assert_array_equal(found, expected)
        for name in (
            "path",
            "source",
            "settings",
            "statistics",
            "capture",
            "preview_camera",
            "hull",
            "left",
            "textured",
        ):
            assert getattr(scene, name) == getattr(read, name), name
        for name in ("splat_volume", "vertex_volume"):
            np.testing.assert_array_equal(getattr(scene.measured, name), getattr(read.measured, name))
    (splats, paths), (same, _) = made.splats(), again.splats()
    assert paths == [here / "ball.ply"]
    np.testing.assert_array_equal(splats.sh, same.sh)


def test_after_an_interrupted_run_the_splat_is_meshed_again(here, monkeypatch):
    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(relight.jobs.meshing, "meshed", killed)
        assert main(["ball.ply", "--env", "noon", "--method", "analytic"]) != 0
        assert main(["ball.ply", "--env", "noon", "--method", "analytic", "-o", "out"]) != 0
    assert {entry.name for entry in here.iterdir()} == {"ball.ply"}
    # A process that was killed leaves its first look.
    assert main(["ball.ply", "--env", "noon", "--quick", "-o", FIRST]) == 0
    assert main(["ball.ply", "--env", "noon", "--method", "analytic", "--bands", "3"]) == 0
    assert "state" not in report(here / FIRST)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["ball.ply", "--env", "noon", "--quick", "--lamp", "0,1,0"], "--quick: it shows a splat under an environment"),
        (["ball.ply", "--quick", "--env", "captured"], "--quick: it shows a splat under an environment"),
        (["ball.ply", "--env", "noon", "--quick", "--sheet"], "--sheet: a first look does not heed it"),
        (["ball.ply", "--env", "noon", "--quick", "--format", "glb"], "a first look has png and splat alone"),
        (["ball.ply", "--env", "noon", "--quick", "--view"], "--quick: it writes files"),
        (["mesh.obj", "--env", "noon", "--quick"], "is no splat file"),
    ],
)
def test_what_has_no_first_look_is_refused(here, capsys, words, message):
    (here / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert main(words) == 2
    assert message in capsys.readouterr().err
    assert {entry.name for entry in here.iterdir()} == {"ball.ply", "mesh.obj"}


def test_final_results_give_way_to_no_first_look(here, monkeypatch):
    assert main(["ball.ply", "--env", "noon", "--method", "analytic", "--bands", "3", "-o", "out"]) == 0
    (here / "ball").rename(here / "away")
    (here / "out" / "mine.txt").write_text("kept")

    def watched(*_):
        assert "state" not in report(here / "out") and (here / "out" / "relit.glb").exists()
        raise KeyboardInterrupt

    monkeypatch.setattr(relight.jobs.meshing, "meshed", watched)
    assert main(["ball.ply", "--env", "overcast", "--overwrite", "-o", "out"]) != 0
    assert (here / "out" / "mine.txt").exists() and (here / "out" / "relit.glb").exists()
