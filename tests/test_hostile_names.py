"""Names that come from elsewhere: in buckets, pages, files and folders of light. None leads out, none becomes code."""

import json
import os
import re

import numpy as np
import pytest

from relight.cli import main
from relight.jobs.folders import lights_of, output_folders
from relight.light.environment import Environment
from relight.live.page import page_of
from relight.request import RelightRequest
from splat2mesh.base.errors import InputError
from splat2mesh.scene.sources import fingerprint
from splat2mesh.tiles import pieces
from splat2mesh.tiles.pieces import CityPiece, read_piece

SCRIPT = "</script></title><script>alert(1)</script><!--"


@pytest.mark.parametrize("name", ["../../evil.ply", "a/../../../evil.ply", "..\\..\\evil.ply"])
def test_a_bucket_cannot_have_files_written_elsewhere(name, tmp_path, monkeypatch):
    written = []

    class Bucket:
        def __init__(self, url):
            pass

        def listed(self):
            return {name: 4}

        def read(self, name):
            written.append(name)
            return b"evil"

    monkeypatch.setattr(pieces, "Store", Bucket)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    with pytest.raises(InputError, match="outside its folder"):
        read_piece(CityPiece("memory://bucket/tile", 0, -1, False))
    assert not written and not list(tmp_path.rglob("*"))


def test_no_name_in_a_page_becomes_code():
    meta = {
        "source": {"file": SCRIPT + "\udcff"},
        "lights": [{"name": SCRIPT, "file": "lights/0.rgbe"}],
        "splats": [{"file": "splat.compressed.ply"}],
        "transfer": {"file": "transfer.bin", "bytes": 8},
        "surface": {"file": "surface.bin", "bytes": 12},
    }
    page = page_of(meta, ["live.json", "lights/0.rgbe"], {"lights/0.rgbe": b"1"}).encode("utf-8", "replace").decode()
    assert "alert(1)" in page and "<script>alert" not in page
    head = page[: page.index("<body>")]
    assert head.count("</title>") == 1 and head.count("</script>") == 2  # facts, and what unpacks files
    data = json.loads(re.search(r'id="live-data">(.*?)</script>', page, re.DOTALL)[1])
    assert data["meta"]["lights"][0]["name"] == SCRIPT  # as text, which the page shows by textContent and Option


def test_lights_of_a_folder_name_folders_beside_each_other(tmp_path):
    names = ["..exr", "...hdr", "a b.hdr", "<i>.hdr", "\x1b[2J.exr", "\udcff.hdr"]
    for name in [*names, "notes.txt"]:
        (tmp_path / name).touch()
    request = RelightRequest("mesh.obj", tmp_path, output=tmp_path / "out")
    found = lights_of(request)
    assert sorted(os.path.basename(path) for path in found) == sorted(names)
    for folder in output_folders(request, found):
        assert folder.parent == tmp_path / "out" and folder.name not in (".", "..") and folder.name.endswith("_0")


def test_results_of_two_lights_never_share_a_folder_and_no_sheet_is_replaced_unasked(tmp_path, capsys):
    for name in ("a.exr", "a.hdr", "b.hdr"):
        (tmp_path / "envs" / name).parent.mkdir(exist_ok=True)
        (tmp_path / "envs" / name).touch()
    (tmp_path / "mesh.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    command = [str(tmp_path / "mesh.obj"), "-o", str(tmp_path / "out"), "--env"]
    assert main([*command, str(tmp_path / "envs")]) == 2
    assert "two of its lights would go into" in capsys.readouterr().err
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "sheet.png").write_text("mine")
    assert main([*command, "noon", "--rotate", "0:90:90", "--sheet"]) == 2
    assert "sheet.png exists already" in capsys.readouterr().err
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["sheet.png"]


def test_a_light_has_a_name_that_every_file_can_hold():
    light = Environment(np.ones((8, 16, 3), np.float32), "sky\udcff")
    assert light.name.encode("utf-8").startswith(b"sky")


def test_the_splat_that_a_scene_names_is_no_device_that_never_ends(tmp_path):
    os.mkfifo(tmp_path / "pipe.ply")
    for path in ("/dev/zero", str(tmp_path / "pipe.ply")):
        assert len(fingerprint(path)) == 64  # of nothing: it was not opened
