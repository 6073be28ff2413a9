"""`splat2mesh FILE --info`: what a file is, says, and loses, for every kind that is read; nothing is meshed."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from ball_splats import solid_ball
from ply_samples import inria_columns, ply_bytes
from splat_samples import make_splats, store

from splat2mesh.cli import main
from splat2mesh.info import info_of, lines_of
from splat2mesh.render.view import View
from splat2mesh.splats.facts import FileFacts
from splat2mesh.splats.formats import write_splats


def told(capsys, *arguments):
    """(exit code, JSON or text of stdout, stderr) of the command."""
    code = main([*map(str, arguments), "--info"])
    out, err = capsys.readouterr()
    return code, json.loads(out) if "--json" in arguments else out, err


def test_a_splat_file(tmp_path, capsys):
    facts = FileFacts(True, (0.0, 0.0, 1.0), "x", offset=(5e5, 5.4e6, 302.0))
    ball = replace(solid_ball(1000), facts=facts)
    ball.means[:3] = np.nan
    ball.opacities[3:10] = 0.001
    write_splats(tmp_path / "ball.ply", ball)
    code, found, err = told(capsys, tmp_path / "ball.ply", "--json")
    assert code == 0 and err == ""
    assert found["what"] == "splats" and found["splats"] == 1000 and found["holds"] == "an object"
    assert found["dropped"] == {"a NaN or infinite value": 3, "an opacity below 1/255": 7}
    assert found["antialiased"] is True and found["sh_degree"] == ball.degree
    assert found["up"] == [0, 0, 1] and "Vertical axis" in found["up_from"]
    assert np.allclose(found["offset"], [5e5, 5.4e6, 302], atol=1) and np.ptp(found["size"]) < 0.5
    assert found["warnings"] == [] and found["cameras"] == 0
    text = told(capsys, tmp_path / "ball.ply")[1]
    for line in ("splats            1,000", "dropped           3 with a NaN", "antialiased       yes", "5,400,000"):
        assert line in text
    assert [each.name for each in tmp_path.iterdir()] == ["ball.ply"]


def test_what_is_left_out_is_said_once(tmp_path):
    columns = inria_columns(make_splats(60, 0))
    columns |= {f"f_rest_{i}": np.zeros(60) for i in range(72)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = info_of(store(tmp_path, "a.ply", ply_bytes(columns)))
    assert len(found["warnings"]) == 1 and "degree is 4" in found["warnings"][0]
    assert sum("warning" in line for line in lines_of(found)) == 1


def test_checkpoints_and_too_few(tmp_path):
    for number in (7000, 30000):
        folder = tmp_path / "trained" / "point_cloud" / f"iteration_{number}"
        folder.mkdir(parents=True)
        write_splats(folder / "point_cloud.ply", solid_ball(900 + number // 1000))
    found = info_of(tmp_path / "trained")
    assert found["splats"] == 930 and found["files"] == [str(folder / "point_cloud.ply")]
    write_splats(tmp_path / "few.ply", make_splats(4, 0))
    assert "nothing to mesh" in info_of(tmp_path / "few.ply")["holds"]


def test_cameras(tmp_path):
    entries = []
    for number in range(4):
        view = View.look_at([3 * np.cos(number), 0.1, 3 * np.sin(number)], [0, 0, 0], [0, -1, 0], 50.0, 64, 48)
        entry = {"id": number, "img_name": "a", "width": 64, "height": 48, "fx": 70.0, "fy": 70.0}
        rotation = view.camera_from_world[:3, :3].T.tolist()
        entries.append(entry | {"position": view.center.tolist(), "rotation": rotation})
    entries[2]["position"] = [float("nan"), 0, 0]
    found = info_of(store(tmp_path, "cameras.json", json.dumps(entries).encode()))
    assert found["what"] == "cameras" and found["cameras"] == 4 and found["dropped"] == {"no usable pose": 1}
    assert found["pictures"] == ["64 x 48"]
    assert info_of(tmp_path)["what"] == "cameras"


def test_layouts(tmp_path):
    write_splats(tmp_path / "a.ply", make_splats(20, 0))
    layout = {"objects": [{"splat": "a.ply", "name": "vase"}]}
    found = info_of(store(tmp_path, "room.json", json.dumps(layout).encode()))
    assert found["what"] == "layout" and list(found["objects"]) == ["vase"]


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("a.ply", b"", "is empty"),
        ("a.rad", b"RAD0" * 9, "not read"),
        ("a.bin", b"\0" * 90, "is not a splat file"),
        ("a.json", b"[1, 2]", "cameras"),
    ],
)
def test_what_is_none_of_them_gets_one_line_and_exit_code_2(tmp_path, capsys, name, data, message):
    code, out, err = told(capsys, store(tmp_path, name, data))
    assert code == 2 and out == "" and message in err and len(err.strip().splitlines()) == 1
    code, _, err = told(capsys, tmp_path / "missing.ply")
    assert code == 2 and "no such file" in err
