"""Tiles with more vertices than memory allows are lit in parts, without a visible difference."""

import gc
import json
import shutil
import weakref
from pathlib import Path

import numpy as np
import pytest
from cities import relit_city, sums

from relight import LightingOptions
from relight.tiles import local, work
from relight.tiles.local import LEAST_SHARE, TileNeighborhood, parts_of, room_for, tile_mesh
from relight.tiles.shared import city_of, coarse_city
from relight.tiles.work import TileRequest, relit_tile
from relight.transfer.precomputed import Precomputed
from splat2mesh.base.errors import InputError
from splat2mesh.options import TilingOptions
from splat2mesh.splats.formats import read_splats
from splat2mesh.tiles.plan import FILE, CityPlan
from splat2mesh.tiles.store import Store
from splat2mesh.tiles.tasks import tiling_engine

OPTIONS = LightingOptions(bands=3, rays=64, effects="shadows bounces")
CORE = np.array([[0.0, 0.0], [40.0, 20.0]])


def scattered(count, low, high, seed=0):
    return np.random.default_rng(seed).uniform(low, high, (count, 2))


def relit(city, memory, name, running=None):
    formats = ("npy", "splat", "glb")
    folder = f"relit/parts_{name}"
    relit_city(city, "noon", OPTIONS, engine=running, formats=formats, memory=memory, folder=folder)
    return city / folder


@pytest.fixture(scope="module")
def uncut(city):
    return relit(city, 4.0, "uncut")


def little(city):
    """GiB in which a process finds the light of about 500 vertices at once: most tiles have two parts then."""
    coarse = sum(entry["far_vertices"] for entry in city_of(Store(city))["tiles"])
    return local.BASE_GB + 6_000 * local.GB_PER_SPLAT + 500 * local.GB_PER_LIT + coarse * local.GB_PER_NEAR


@pytest.fixture(scope="module")
def cut(city):
    return relit(city, little(city), "cut")


def records(folder):
    return [json.loads(path.read_text()) for path in sorted(folder.glob("tiles/*/relit.json"))]


def test_each_vertex_belongs_to_one_part():
    own, around = scattered(50_000, CORE[0], CORE[1]), scattered(20_000, [-10, -10], [50, 30], 1)
    own[:40] += 3.0 * np.sign(own[:40] - CORE.mean(axis=0)) * (CORE[1] - CORE[0]) / 2  # vertices beyond the core
    around = around[~((around > CORE[0]) & (around < CORE[1])).all(axis=1)]
    found = parts_of(own, around, CORE, 3.0, 12_000)
    assert len(found) > 4
    np.testing.assert_array_equal(np.sum([part.holds(own) for part in found], axis=0), 1)
    assert all(part.distance == 3.0 for part in found)


def test_a_dense_band_of_neighbours_is_seen_thinner():
    own = scattered(6_000, CORE[0], CORE[1])
    around = np.concatenate([scattered(90_000, [-2, -2], [0, 22]), scattered(90_000, [40, -2], [42, 22])])
    found = parts_of(own, around, CORE, 8.0, 9_000)
    assert min(part.distance for part in found) < 8.0
    for part in found:
        low, high = part.grown
        beside = ((around >= low) & (around < high)).all(axis=1).sum()
        cost = part.holds(own).sum() + local.GB_PER_NEAR / local.GB_PER_LIT * beside
        assert cost < 9_000 or part.distance <= 8.0 * LEAST_SHARE


def test_cuts_end_where_all_vertices_are_in_one_place():
    own = np.full((100_000, 2), 7.0)
    found = parts_of(own, np.zeros((0, 2)), CORE, 3.0, 9_000)
    np.testing.assert_array_equal(np.sum([part.holds(own) for part in found], axis=0), 1)
    assert len(found) < 200


def test_little_memory_is_reported(city):
    with pytest.raises(InputError, match=r"`memory` 0\.3: a process needs 0\.\d GiB at least"):
        room_for(0.3, 0, 0)
    with pytest.raises(InputError, match=r"`memory` 0\.3: a process needs"):
        relit_city(city, "noon", OPTIONS, memory=0.3, folder="relit/little")
    assert not (city / "relit/little").exists()


@pytest.mark.slow
def test_a_city_in_parts_is_lit_as_uncut(city, cut, uncut):
    assert all(record["parts"] == 1 for record in records(uncut))
    assert all(record["parts"] > 1 for record in records(cut))
    for number, record in enumerate(records(cut)):
        name = f"tiles/{number:05d}"
        found, expected = (np.load(folder / name / "radiance.npy") for folder in (cut, uncut))
        assert len(found) == record["vertices"] == len(tile_mesh(Store(city), number).vertices)
        assert np.linalg.norm(found - expected) < 0.06 * np.linalg.norm(expected)
        found, expected = (read_splats(folder / name / "splats.ply").sh[:, 0] for folder in (cut, uncut))
        assert np.abs(found - expected).mean() < 0.02


@pytest.mark.slow
def test_a_worker_writes_the_same_parts(city, cut, tmp_path):
    copy = Path(shutil.copytree(city, tmp_path / "copy", ignore=shutil.ignore_patterns("relit")))
    with tiling_engine(TilingOptions(workers=1)) as running:
        assert sums(relit(copy, little(city), "cut", running)) == sums(cut)


def test_a_part_holds_its_own_faces_and_what_is_near(city):
    store = Store(city)
    plan = CityPlan(**store.read_json(FILE)["plan"])
    around = TileNeighborhood(store, coarse_city(store), 0, plan.spacing)
    found = around.parts(300)
    seen = np.zeros(len(around.mesh.vertices), int)
    for part in found:
        local = around.gather(part)
        seen[local.rows[local.own]] += 1
        assert local.shown[: len(local.own)][local.own].all()
        near = local.scene.chunks[0]
        np.testing.assert_array_equal(near.vertices, around.mesh.vertices[local.rows])
        own_faces = np.isin(around.mesh.faces, local.rows[local.own]).any(axis=1).sum()
        assert np.isin(near.faces, np.flatnonzero(local.own)).any(axis=1).sum() == own_faces
    assert len(found) > 2 and (seen == 1).all()


def test_what_goes_before_the_new_light_changes_no_bit(city, uncut, tmp_path, monkeypatch):
    copy = Path(shutil.copytree(city, tmp_path / "copy", ignore=shutil.ignore_patterns("relit")))
    shutil.copytree(uncut, copy / "relit/it", ignore=shutil.ignore_patterns("tiles"))
    options = LightingOptions(bands=3, rays=128, effects="shadows bounces", tolerance=0.03)
    gone_before, forget, known, held, give_back = [], Precomputed.forget, [], [], work.give_back

    def forgotten(self, settings):
        known.append(weakref.ref(self))
        before = len(self._transfers), len(self._interreflections)
        forget(self, settings)
        gone_before.append((before, (len(self._transfers), len(self._interreflections))))

    def given_back():
        give_back()
        held.extend(each() for each in known)

    monkeypatch.setattr(Precomputed, "forget", forgotten)
    monkeypatch.setattr(work, "give_back", given_back)
    store, spacing = Store(copy), CityPlan(**Store(copy).read_json(FILE)["plan"]).spacing
    key = json.loads((uncut / "light.json").read_text())["sha256"]

    def radiance():
        relit_tile(store, "relit/it", key, TileRequest(options, "estimated", ("npy",), 4.0, spacing), 0, [])
        return np.load(copy / "relit/it/tiles/00000/radiance.npy")

    gc.collect()
    gc.disable()  # nothing of it waits for the collector
    try:
        gone = radiance()
    finally:
        gc.enable()
    monkeypatch.setattr(Precomputed, "forget", lambda self, settings: None)
    assert gone_before and all(before == (1, 1) and after == (0, 1) for before, after in gone_before)
    assert held and not any(held), "all that was traced is gone when splats take their light"
    np.testing.assert_array_equal(gone, radiance())
