"""Cities under a new light: as the untiled neighbourhood is lit, one light for all, the same bytes by other ways."""

import json

import numpy as np
import pytest
from buckets import bucket_server, copied, made_bucket, sent
from cities import relit_city, sums
from scipy.spatial import cKDTree
from splat_samples import make_splats

from relight import Environment, LightingOptions, Relighter
from relight.cli import main
from relight.tiles.local import TileNeighborhood, tile_mesh
from relight.tiles.shared import city_of, coarse_city, shared_at
from relight.tiles.streamed import LOD_LEVELS, environment_files, lod_meta, tile_levels
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.formats.streamed import META, open_streamed
from splat2mesh.splats.joining import joined
from splat2mesh.tiles.store import Store

OPTIONS = LightingOptions(bands=3, rays=16, effects="shadows")


@pytest.fixture(scope="module")
def relit(city):
    report = relit_city(city, "noon", OPTIONS, formats=("glb", "npy", "splat"), folder="relit/a")
    return city / "relit" / "a", report


def test_each_tile_is_lit_as_in_the_whole_city(city, relit):
    store = Store(city)
    entries = [entry for entry in city_of(store)["tiles"] if entry["faces"]]
    whole = Scene([tile_mesh(store, entry["tile"]) for entry in entries])
    options = LightingOptions(bands=3, rays=256, effects="shadows")
    expected = Relighter(whole, options).shade(Environment.load("noon"))
    white = relit_city(city, "noon", options, formats=("npy",), albedo="white", folder="relit/white")
    found = np.concatenate([np.load(city / "relit/white" / entry["name"] / "radiance.npy") for entry in entries])
    assert white["vertices"] == len(found) == len(expected)
    assert np.linalg.norm(found - expected) < 0.03 * np.linalg.norm(expected)  # far tiles are coarse, rays are 256


def test_all_tiles_have_one_light_and_one_exposure(relit):
    folder, report = relit
    assert report["light"]["exposure"] > 0
    assert report["bytes"] == sum(report["task_bytes"][f"tile {n}"] for n in range(report["tiles"])) > 0
    light = Store(folder).read_arrays("light.npz")
    assert float(light["exposure"]) == pytest.approx(report["light"]["exposure"])
    for entry in (folder / "tiles").iterdir():
        kept = json.loads((entry / "relit.json").read_text())
        assert kept["bands"] == 3


def test_what_the_tiles_share_comes_back_to_the_bit(relit):
    folder, report = relit
    shared = shared_at(str(folder.parents[1]), "relit/a", report["light"]["sha256"])
    sky = Environment.load("noon")
    np.testing.assert_array_equal(shared.sky.radiance, sky.radiance)
    assert (shared.sky.name, shared.sky.rotation_deg, shared.sky.formula) == (sky.name, 0.0, "noon")
    expected = coarse_city(Store(folder.parents[1]))
    np.testing.assert_array_equal(shared.city.cores, expected.cores)
    for kept, mesh in zip(shared.city.coarse, expected.coarse, strict=True):
        for name in ("vertices", "normals", "faces", "colors_srgb"):
            np.testing.assert_array_equal(getattr(kept, name), getattr(mesh, name))
    with pytest.raises(InputError, match="has changed"):
        shared_at(str(folder.parents[1]), "relit/a", "0" * 64)


def test_the_relit_splats_are_those_of_the_source_in_other_colours(city, relit):
    folder, _ = relit
    store = Store(city)
    for entry in (folder / "tiles").iterdir():
        number = int(entry.name)
        relit_tile = read_splats(entry / "splats.ply")
        pieces = sorted((city / "splats").glob(f"[0-9]*_{number:05d}.npz"))
        means = np.concatenate([store.read_arrays(f"splats/{piece.name}")["means"] for piece in pieces])
        np.testing.assert_array_equal(relit_tile.means, means)
        assert np.isfinite(relit_tile.sh).all()


@pytest.mark.slow
def test_a_streamed_sog_of_the_city_holds_its_relit_splats_in_levels(city, relit):
    formats = ("splat", "sog")
    relit_city(city, "noon", OPTIONS, formats=formats, folder="relit/sog")
    folder = city / "relit/sog"
    capture = open_streamed(folder / "sog/lod-meta.json")
    expected = [read_splats(path) for path in sorted((folder / "tiles").glob("*/splats.ply"))]
    assert capture.counts[0] == sum(map(len, expected)) and len(capture.counts) == LOD_LEVELS
    for finer, coarser in zip(capture.counts, capture.counts[1:], strict=False):
        assert finer / 4 <= coarser < finer / 3
        capture.check_tiles(1)
    assert capture.environment is None
    whole = joined(expected)
    found = read_splats(folder / "sog/lod-meta.json", 0)
    distance, nearest = cKDTree(whole.means).query(found.means)
    assert distance.max() < 0.01
    assert np.abs(found.sh[:, 0] - whole.sh[nearest, 0]).mean() < 0.02
    coarse = read_splats(folder / "sog/lod-meta.json", LOD_LEVELS - 1)
    box = whole.means.min(axis=0), whole.means.max(axis=0)
    assert (coarse.means >= box[0]).all() and (coarse.means <= box[1]).all()
    before = sums(folder)
    (folder / "sog/1_00001/meta.json").unlink()
    relit_city(city, "noon", OPTIONS, formats=formats, folder="relit/sog", resume=True)
    assert sums(folder) == before


def test_large_tiles_have_many_leaves_and_the_far_background_is_the_environment(tmp_path, monkeypatch):
    monkeypatch.setattr("relight.tiles.streamed.LEAF", 100)
    splats, far = make_splats(1000, 0), make_splats(30, 0)
    files, leaves = tile_levels(splats, 7)
    for name, data in (files | environment_files(far)).items():
        Store(tmp_path).write(name, data)
    assert len(leaves) == 16
    Store(tmp_path).write_json(f"sog/{META}", lod_meta(leaves, True))
    found = read_splats(tmp_path / "sog" / META, 0)
    assert found.environment.sum() == 30 and len(found) == 1030
    for leaf in leaves:
        first = leaf["lods"]["0"]["offset"]
        means = found.means[first : first + leaf["lods"]["0"]["count"]]
        assert len(means) <= 100
        assert (means >= leaf["bound"]["min"]).all() and (means <= leaf["bound"]["max"]).all()
    nodes, seen = [lod_meta(leaves, True)["tree"]], []
    while nodes:
        node = nodes.pop()
        nodes += node.get("children", [])
        for child in node.get("children", []):
            assert np.all(np.array(child["bound"]["min"]) >= node["bound"]["min"])
            assert np.all(np.array(child["bound"]["max"]) <= node["bound"]["max"])
        seen += [node["lods"]["0"]["offset"]] if "lods" in node else []
    assert sorted(seen) == sorted(leaf["lods"]["0"]["offset"] for leaf in leaves)


def test_a_run_that_goes_on_ends_in_the_same_bytes(city, relit):
    folder, _ = relit
    before = sums(folder)
    for name in ("tiles/00001/relit.json", "report.json"):
        (folder / name).unlink()
    relit_city(city, "noon", OPTIONS, formats=("glb", "npy", "splat"), folder="relit/a", resume=True)
    assert sums(folder) == before


@pytest.mark.slow
def test_a_city_in_a_bucket_has_the_same_bytes(city, relit, tmp_path):
    with pytest.MonkeyPatch.context() as patch, bucket_server(patch):
        url = f"{made_bucket('cities')}/small"
        for name in ("plan.json", "city.json", "tiles", "splats"):
            sent(city / name, f"{url}/{name}")
        relit_city(url, "noon", OPTIONS, formats=("glb", "npy", "splat"), folder="relit/a")
        assert sums(copied(f"{url}/relit/a", tmp_path / "copy")) == sums(relit[0])


def whole(around):
    (part,) = around.parts(np.inf)
    return around.gather(part)


def test_what_is_far_is_coarse_and_what_is_near_is_not(city):
    store = Store(city)
    around = TileNeighborhood(store, coarse_city(store), 0, 5.0)
    local = whole(around)
    assert local.own.sum() == len(local.own) == len(tile_mesh(store, 0).vertices)
    coarse = sum(len(each.vertices) for each in local.scene.chunks[local.near :])
    assert local.near >= 2 and 0 < coarse <= around.coarse


def test_not_far_away_a_tile_sees_more_of_others_than_the_city_holds(city):
    store = Store(city)
    coarse = coarse_city(store)
    twins = [0 if mesh is None else len(mesh.vertices) for mesh in coarse.coarse]
    highest = [mesh.vertices[:, 1].argsort()[-3:] for mesh in coarse.coarse if mesh is not None]
    held = [
        Mesh(mesh.vertices[rows], mesh.normals[rows], mesh.faces[:0], mesh.colors_srgb[rows])
        for mesh, rows in zip(coarse.coarse, highest, strict=True)
    ]
    for apart, expected in ((0.0, sum(twins)), (39.0, sum(twins)), (41.0, twins[0] + 9)):
        cores = coarse.cores.copy()
        cores[1:] = cores[0] + [cores[0, 1, 0] - cores[0, 0, 0] + apart, 0.0]
        assert TileNeighborhood(store, coarse._replace(cores=cores, coarse=held), 0, 5.0).coarse == expected


def test_what_lies_below_the_horizon_is_left_out(city):
    store = Store(city)
    coarse = coarse_city(store)
    cores = coarse.cores.copy()
    cores[1:] += 1e5
    assert len(whole(TileNeighborhood(store, coarse._replace(cores=cores), 0, 5.0)).scene.chunks) == 1
    cores[1:] -= 9.99e4
    assert len(whole(TileNeighborhood(store, coarse._replace(cores=cores), 0, 5.0)).scene.chunks) == len(cores)


def test_bad_wishes_are_reported_before_any_work(city, relit, tmp_path, capsys):
    with pytest.raises(InputError, match="exists already"):
        relit_city(city, "noon", OPTIONS, folder="relit/a")
    with pytest.raises(InputError, match="other settings"):
        relit_city(city, "sunset", OPTIONS, folder="relit/a", resume=True)
    with pytest.raises(InputError, match=r"no city\.json"):
        relit_city(tmp_path, "noon", OPTIONS)
    for arguments, said in (
        (["--albedo", "nothing"], "--albedo nothing"),
        (["--rotate", "0:90:45"], "one angle at a time"),
        (["--view"], "--view: not supported"),
    ):
        assert main([str(city), *arguments]) == 2
        assert said in capsys.readouterr().err
