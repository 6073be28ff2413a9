import json
from dataclasses import replace

import pytest
from live_scene import scene_and_splats

from relight.cli import main
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import write_splats


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene folder with its splat beside it."""
    path = tmp_path_factory.mktemp("scene")
    scene, splats = scene_and_splats()
    write_splats(path / "plate.ply", splats)
    replace(scene, source=describe(path / "plate.ply")).save(path / "plate")
    return path / "plate"


def test_one_command_writes_the_bundle_and_the_page(folder, tmp_path, capsys):
    command = [str(folder), "--env", "sunset", "--env", "noon", "--rotate", "30", "--albedo", "captured"]
    command += ["--effects", "none", "--format", "live", "web", "-o", str(tmp_path / "out"), "--json"]
    assert main(command) == 0
    reports = json.loads(capsys.readouterr().out)["reports"]
    for report, first, second in zip(reports, ("sunset", "noon"), ("noon", "sunset"), strict=True):
        out = tmp_path / f"out/{first}_30"
        assert all((out / name).is_file() for name in report["files"])
        meta = json.loads((out / "live/live.json").read_text())
        assert [light["name"] for light in meta["lights"]] == [first, second, "studio", "overcast", "capture"]
        assert meta["count"] == 2500 == report["live"]["splats"]
        assert meta["ground"]["height"] == pytest.approx(-0.1) and "live/ground.bin" in report["files"]
        page = (out / "relit.html").read_text("utf-8")
        assert '"turn": 30.0' in page and "src=" not in page.split("</style>")[1].split("<script")[0]


def test_the_option_of_former_versions_is_one_line(folder, tmp_path, capsys):
    with pytest.raises(SystemExit, match="2"):
        main([str(folder), "--format", "web", "--lights", "noon", "-o", str(tmp_path / "out")])
    assert "--lights" in capsys.readouterr().err and not (tmp_path / "out").exists()


def test_a_mesh_has_no_splats_to_show(tmp_path, capsys):
    from splat2mesh.scene.meshfile import write_mesh_ply

    write_mesh_ply(tmp_path / "plate.ply", scene_and_splats()[0].chunks[0])
    assert main([str(tmp_path / "plate.ply"), "--format", "web", "-o", str(tmp_path / "out")]) == 2
    assert "a mesh without a splat" in capsys.readouterr().err
