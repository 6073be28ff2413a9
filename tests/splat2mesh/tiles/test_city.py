"""Cities in tiles: borders that fit to the bit, the same bytes however the tiles are made, and stops on the way."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from buckets import bucket_server, copied, made_bucket, no_rights
from cities import few_pixels, generated, meshed, sums

from splat2mesh.base.errors import InputError, UnfinishedError
from splat2mesh.cli import main
from splat2mesh.options import TilingOptions
from splat2mesh.scene.meshfile import mesh_from_ply_bytes
from splat2mesh.splats.formats import read_splats, write_inria_ply
from splat2mesh.tiles import city as city_module
from splat2mesh.tiles import pieces
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import Cluster, tiling_engine

sys.path.insert(0, str(Path(__file__).parents[3] / "scripts"))

from benchmarks.seams import check_seams


@pytest.fixture(scope="module")
def patch():
    with pytest.MonkeyPatch.context() as patch:
        few_pixels(patch)
        yield patch


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    return generated(tmp_path_factory.mktemp("city") / "city")


@pytest.fixture(scope="module")
def made(patch, source, tmp_path_factory):
    """The folder that a plain run wrote, and its report."""
    folder = tmp_path_factory.mktemp("made") / "scene"
    return folder, meshed(source, folder)


@pytest.mark.slow
def test_the_report_lists_the_cost_of_each_tile(made):
    folder, report = made
    written = {f"mesh {path.name.lstrip('0') or '0'}": path for path in (folder / "tiles").iterdir()}
    sizes = {name: sum(file.stat().st_size for file in path.glob("*.[pg]l[yb]")) for name, path in written.items()}
    assert report["task_bytes"] == sizes and report["bytes"] == sum(sizes.values()) > 0
    for cost in ("task_seconds", "task_peak_mb"):
        assert all(report[cost][name] > 0 for name in sizes)
    assert report["peak_mb"] == max(report["task_peak_mb"].values())


def test_what_lies_on_a_border_is_the_same_on_both_sides(made):
    found = check_seams(Store(made[0]))
    assert found["borders"] >= 3 and found["edges"] > 50
    assert found["vertices"] >= found["edges"] / 2
    assert (found["cracks"], found["normals"], found["colors"]) == (0, 0, 0)


def test_seams_that_do_not_fit_are_found(made, tmp_path):
    shutil.copytree(made[0], tmp_path / "broken")
    store = Store(tmp_path / "broken")
    name = store.read_json("city.json")["tiles"][0]["name"]
    mesh = mesh_from_ply_bytes(store.read(f"{name}/mesh.ply"))
    data = bytearray(store.read(f"{name}/mesh.ply"))
    start = data.index(b"end_header\n") + 11
    rows = np.frombuffer(data, np.uint8, len(mesh.vertices) * 27, start).reshape(-1, 27)
    rows[:, 12] ^= 1  # the last bit of every normal
    store.write(f"{name}/mesh.ply", bytes(data))
    assert check_seams(store)["normals"] > 10


def test_workers_give_the_bytes_of_the_plain_loop(made, patch, source, tmp_path):
    from dask.distributed import Client

    with Client(processes=False, n_workers=2, threads_per_worker=1, dashboard_address=":0") as client:
        meshed(source, tmp_path / "scene", Cluster(client))
    assert sums(tmp_path / "scene") == sums(made[0])


def test_an_interrupted_run_goes_on_and_ends_in_the_same_bytes(made, patch, source, tmp_path, monkeypatch):
    real, calls = city_module.mesh, []

    def fails(store, key, tile):
        calls.append(tile)
        if tile == 1:
            raise OSError(28, "No space left on device")
        return real(store, key, tile)

    monkeypatch.setattr(city_module, "mesh", fails)
    with pytest.raises(UnfinishedError, match=r"^1 of \d+ tiles are not done \(mesh 1: .*No space left.*`resume`"):
        meshed(source, tmp_path / "scene")
    monkeypatch.setattr(city_module, "mesh", real)
    store = Store(tmp_path / "scene")
    assert not store.exists("city.json")
    with open(store.path("tiles/00000/mesh.ply"), "ab") as file:  # damaged after it was written
        file.write(b"x")
    meshed(source, tmp_path / "scene", resume=True)
    assert sums(tmp_path / "scene") == sums(made[0])


@pytest.mark.slow
def test_a_city_in_a_bucket_has_the_same_bytes_and_a_bucket_without_rights_is_one_line(
    made, patch, source, tmp_path, capsys
):
    with pytest.MonkeyPatch.context() as inner, bucket_server(inner) as server:
        url = f"{made_bucket('cities')}/small"
        with no_rights(server, inner):
            assert main([str(source), "-o", url, "--tiles"]) == 2
            assert capsys.readouterr().err == f"error: cannot read {url}/plan.json: Forbidden\n"
        assert main([str(source), "-o", "s3://none-such/small", "--tiles"]) == 2
        assert capsys.readouterr().err.endswith("work/begun: The specified bucket does not exist\n")
        meshed(source, url)
        assert sums(copied(url, tmp_path / "copy")) == sums(made[0])


def test_resume_needs_the_same_settings(made, patch, source):
    with pytest.raises(InputError, match="other settings"):
        meshed(source, made[0], resume=True, vertices=1000)


def test_a_place_that_is_taken_is_not_written(made, patch, source, tmp_path):
    with pytest.raises(InputError, match="exists already"):
        meshed(source, made[0])
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "letter.txt").write_text("mine")
    for wish in ({"overwrite": True}, {"resume": True}):
        with pytest.raises(InputError, match="does not replace it"):
            meshed(source, tmp_path / "own", **wish)
    assert (tmp_path / "own" / "letter.txt").exists()


def test_the_tiles_hold_every_splat_once_and_to_the_bit(made, source):
    store = Store(made[0])
    whole = np.concatenate([read_splats(path).means for path in sorted(source.iterdir())])
    parts = [store.read_arrays(f"splats/{path.name}") for path in (made[0] / "splats").glob("*.npz")]
    found = np.concatenate([part["means"] for part in parts])
    assert sorted(map(tuple, found.tolist())) == sorted(map(tuple, whole.tolist()))


def test_a_large_file_is_read_in_parts(source, tmp_path, monkeypatch):
    splats = read_splats(source)
    write_inria_ply(tmp_path / "one.ply", splats)
    monkeypatch.setattr(pieces, "PIECE_ROWS", 7_000)
    found = pieces.pieces_of(str(tmp_path / "one.ply"))
    assert [piece.first for piece in found] == [0, 7_000, 14_000, 21_000]
    read = [pieces.read_piece(piece) for piece in found]
    np.testing.assert_array_equal(np.concatenate([part.means for part in read]), splats.means)
    np.testing.assert_array_equal(np.concatenate([part.sh for part in read]), splats.sh)


def test_the_tileset_names_what_is_there_in_boxes_that_hold_it(made):
    tiles = json.loads((made[0] / "tileset.json").read_text())
    assert tiles["asset"]["version"] == "1.1"
    errors = [tiles["geometricError"], tiles["root"]["geometricError"]]
    for child in tiles["root"]["children"]:
        leaf = child["children"][0]
        assert [*errors, child["geometricError"], leaf["geometricError"]] == sorted(
            [*errors, child["geometricError"], leaf["geometricError"]], reverse=True
        )
        box = np.array(leaf["boundingVolume"]["box"])
        mesh = mesh_from_ply_bytes((made[0] / leaf["content"]["uri"].replace(".glb", ".ply")).read_bytes())
        x, y, z = mesh.vertices.T
        away = np.abs(np.stack([x, -z, y], axis=1) - box[:3])
        assert (away <= box[[3, 7, 11]] + 1e-4).all()
        assert (made[0] / child["content"]["uri"]).is_file()


def test_the_command_says_one_line_for_what_cannot_be(source, tmp_path, capsys):
    nowhere = str(tmp_path / "scene")
    for arguments, said in (
        (["--memory", "0.5"], "--memory 0.5: a process needs 0.6 GiB at least"),
        (["--workers", "0"], "--workers 0: expected at least 1"),
        (["--tiles", "--cameras", "none"], "--cameras: not supported for a city in tiles"),
        (["--tiles", "--detail", "best"], "--detail best"),
        (["--workers", "1", "--scheduler", "tcp://127.0.0.1:1"], "--workers and --scheduler"),
    ):
        assert main([str(source), "-o", nowhere, *arguments]) == 2
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1
    assert not (tmp_path / "scene").exists()


def test_a_piece_that_cannot_be_read_leaves_nothing_behind(source, tmp_path, patch):
    shutil.copytree(source, tmp_path / "tiles")
    (tmp_path / "tiles" / "0001_0000.ply").write_bytes(b"ply\n")
    with pytest.raises(InputError, match=r"0001_0000\.ply"):
        meshed(tmp_path / "tiles", tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


def test_a_silent_scheduler_and_workers_of_another_version_are_reported(monkeypatch):
    from splat2mesh.tiles import tasks

    monkeypatch.setattr(tasks, "CONNECT_S", 0.2)
    nowhere = TilingOptions(scheduler="tcp://127.0.0.1:9")
    with pytest.raises(InputError, match="does not answer"), tiling_engine(nowhere):
        pass

    class Client:
        def run(self, function):
            return {"tcp://10.0.0.1:1": "0.0.1"}

    with pytest.raises(InputError, match=r"10\.0\.0\.1:1 has version 0\.0\.1"):
        tasks._connect(Client(), "here")
