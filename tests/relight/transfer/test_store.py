"""What is kept between runs: found again to the bit, or not at all; nothing torn, foreign or stale is ever used."""

import os
import threading

import numpy as np
import pytest
from plan_scenes import corner, turned

from relight.transfer import store
from relight.transfer.store import Cache, array_key, geometry_key
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

ARRAYS = {"values": np.arange(1000.0), "names": np.array(["a", "bc"]), "nothing": np.zeros((0, 3), np.float32)}


def test_arrays_come_back_as_they_were(tmp_path):
    kept = Cache(tmp_path / "cache", "geometry")
    kept.put("transfer", "raytraced", 8, 128, **ARRAYS)
    found = Cache(tmp_path / "cache", "geometry").get("transfer", "raytraced", 8, 128)
    assert found.keys() == ARRAYS.keys()
    for name, array in ARRAYS.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    assert kept.settings_of("transfer") == [("raytraced", 8, 128)] and kept.settings_of("light") == []
    for other in (("transfer", "raytraced", 8, 64), ("light", "raytraced", 8, 128)):
        assert kept.get(*other) is None


def test_what_is_begun_comes_as_what_is_read_at_once_and_is_read_once(tmp_path):
    kept = Cache(tmp_path / "cache", "geometry")
    kept.put("transfer", 1, **ARRAYS)
    kept.begin("transfer", 1)
    kept.begin("transfer", 2)
    found = kept.get("transfer", 1)
    np.testing.assert_array_equal(found["values"], ARRAYS["values"])
    assert kept.get("transfer", 2) is None
    kept.begin("transfer", 1)
    kept.put("transfer", 1, values=ARRAYS["values"] + 1)  # what was begun is out of date
    np.testing.assert_array_equal(kept.get("transfer", 1)["values"], ARRAYS["values"] + 1)
    kept.begin("transfer", 1)
    kept.drop("transfer", 1)
    assert kept.get("transfer", 1) is None  # nothing of what was begun is left
    Cache().begin("transfer", 1)


def test_without_a_folder_nothing_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    nowhere = Cache()
    nowhere.put("transfer", 1, **ARRAYS)
    assert not nowhere.keeps and nowhere.get("transfer", 1) is None and nowhere.settings_of("transfer") == []
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("share", [0.0, 0.01, 0.5, 0.9, 0.999])
def test_a_torn_file_is_not_there(tmp_path, share):
    kept = Cache(tmp_path, "geometry")
    kept.put("transfer", 1, **ARRAYS)
    (path,) = tmp_path.glob("*.npz")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    assert kept.get("transfer", 1) is None
    kept.put("transfer", 1, **ARRAYS)
    assert kept.get("transfer", 1) is not None


def test_a_flipped_bit_is_not_there(tmp_path):
    """Anywhere among the numbers: each array has a checksum."""
    kept = Cache(tmp_path, "geometry")
    kept.put("transfer", 1, **ARRAYS)
    (path,) = tmp_path.glob("*.npz")
    content = bytearray(path.read_bytes())
    at = bytes(content).index(np.float64(512.0).tobytes())
    content[at] ^= 1
    path.write_bytes(content)
    assert kept.get("transfer", 1) is None


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"not a zip file at all", "pickle", "keyless"])
def test_another_programs_file_is_not_there(tmp_path, content):
    path = tmp_path / "transfer-1.npz"
    if content == "pickle":
        np.savez(path, key=np.array(store.VERSION), values=np.array([{"an": "object"}], object))
    elif content == "keyless":
        np.savez(path, **ARRAYS)
    else:
        path.write_bytes(content)
    assert Cache(tmp_path, "geometry").get("transfer", 1) is None


def test_a_folder_in_a_files_place_is_not_there(tmp_path):
    (tmp_path / "transfer-1.npz").mkdir()
    kept = Cache(tmp_path, "geometry")
    kept.put("transfer", 1, **ARRAYS)
    assert kept.get("transfer", 1) is None
    assert [path.name for path in tmp_path.iterdir()] == ["transfer-1.npz"]


def test_another_geometry_or_version_is_not_there(tmp_path, monkeypatch):
    Cache(tmp_path, "one").put("transfer", 1, **ARRAYS)
    assert Cache(tmp_path, "other").get("transfer", 1) is None
    assert Cache(tmp_path, "one").get("transfer", 1) is not None
    monkeypatch.setattr(store, "VERSION", store.VERSION + 1)
    assert Cache(tmp_path, "one").get("transfer", 1) is None


def test_settings_are_what_a_file_says_whatever_its_name(tmp_path):
    kept = Cache(tmp_path, "geometry")
    kept.put("transfer", "a-b", 3, None, 0.5, **ARRAYS)
    assert kept.settings_of("transfer") == [("a-b", 3, None, 0.5)]
    assert kept.get("transfer", "a", "b-3", None, 0.5) is None  # of the same name
    (path,) = tmp_path.iterdir()
    path.rename(tmp_path / "transfer-x.npz")
    assert kept.settings_of("transfer") == [("a-b", 3, None, 0.5)] and kept.get("transfer", "x") is None
    assert Cache(tmp_path, "other").settings_of("transfer") == []
    for settings in ("{}", "[", '"text"', "[" * 100_000):
        np.savez(tmp_path / "transfer-x.npz", key=np.array(kept._key), settings=np.array(settings))
        assert kept.settings_of("transfer") == []


def test_files_of_older_versions_go_and_those_of_others_stay(tmp_path, monkeypatch):
    def put(version, name):
        monkeypatch.setattr(store, "VERSION", version)
        Cache(tmp_path, "geometry").put("transfer", name, **ARRAYS)

    for version in (9, 7):
        put(version, f"of_{version}")
    np.savez(tmp_path / "transfer-1.npz", key=np.array("7 geometry"), values=ARRAYS["values"])  # without its settings
    np.savez(tmp_path / "anything.npz", key=np.array("mine"), values=ARRAYS["values"])
    np.savez(tmp_path / "keyless.npz", values=ARRAYS["values"])
    (tmp_path / "torn.npz").write_bytes(b"PK")
    monkeypatch.setattr(store, "VERSION", store.VERSION + 2)
    every = {path.name for path in tmp_path.iterdir()}
    Cache(tmp_path, "geometry", read_only=True)
    assert {path.name for path in tmp_path.iterdir()} == every
    Cache(tmp_path, "another")
    assert every - {path.name for path in tmp_path.iterdir()} == {"transfer-of_7.npz", "transfer-1.npz"}


def test_writers_at_once_leave_one_whole_file(tmp_path):
    """Every reading in between finds all of one writer's arrays, or nothing."""
    kept, failures, done = Cache(tmp_path, "geometry"), [], threading.Event()

    def write(number):
        for _ in range(15):
            kept.put("transfer", 1, first=np.full(20_000, number), second=np.full(20_000, number))

    def read():
        while not done.is_set():
            found = kept.get("transfer", 1)
            if found is not None and len({*found["first"], *found["second"]}) != 1:
                failures.append(found)

    threads = [threading.Thread(target=write, args=(number,)) for number in range(4)]
    reader = threading.Thread(target=read)
    for thread in (reader, *threads):
        thread.start()
    for thread in threads:
        thread.join()
    done.set()
    reader.join()
    assert not failures and kept.get("transfer", 1)["first"].shape == (20_000,)
    assert [path.name for path in tmp_path.iterdir()] == ["transfer-1.npz"]


def test_a_small_scene_keeps_less_and_what_was_not_used_for_longest_goes_but_the_newest_of_each_kind(
    tmp_path, monkeypatch
):
    monkeypatch.setattr(store, "LEAST_BYTES", 0)
    monkeypatch.setattr(store, "BYTES_PER_VERTEX", 10)
    kept, block = Cache(tmp_path, "geometry", vertices=1_000), np.zeros(375)  # 10,000 bytes: three files

    def put(kind, number, time_s):
        kept.put(kind, number, block=block)
        os.utime(tmp_path / f"{kind}-{number}.npz", (time_s, time_s))

    put("binding", 0, 1e9)
    put("bounces", 0, 1e9 + 1)
    put("transfer", 0, 1e9 + 2)
    put("bounces", 1, 1e9 + 3)
    assert kept.settings_of("bounces") == [(1,)]  # the binding is older, but the only one
    kept.put("transfer", 1, block=block)
    assert kept.settings_of("transfer") == [(1,)] and kept.get("binding", 0) is not None
    few = Cache(tmp_path, "geometry", vertices=1)  # one light needs all of its kinds, however few are to stay
    few.put("light", 0, block=block)
    assert all(few.settings_of(kind) for kind in ("binding", "bounces", "transfer", "light"))


def test_any_change_of_what_light_depends_on_is_another_geometry():
    scene, _ = corner(3)
    (chunk,) = scene.chunks
    moved, tilted = chunk.vertices.copy(), chunk.normals.copy()
    moved[5, 1] = np.nextafter(moved[5, 1], np.float32(2))
    tilted[5, 1] = np.nextafter(tilted[5, 1], np.float32(2))
    turned_faces = np.roll(chunk.faces, 1, axis=1)
    colors = np.zeros_like(chunk.colors_srgb)
    same = Scene([Mesh(chunk.vertices, chunk.normals, chunk.faces, colors)])
    assert geometry_key(same) == geometry_key(scene)  # albedo is not geometry
    others = [
        Scene([Mesh(moved, chunk.normals, chunk.faces, colors)]),
        Scene([Mesh(chunk.vertices, tilted, chunk.faces, colors)]),
        Scene([Mesh(chunk.vertices, chunk.normals, turned_faces, colors)]),
        Scene([Mesh(chunk.vertices, chunk.normals, chunk.faces[1:], colors)]),
        Scene([chunk, chunk]),
        Scene.from_mesh(chunk, 24),
        turned(scene, 90.0),
    ]
    keys = {geometry_key(each) for each in [scene, *others]}
    assert len(keys) == len(others) + 1


def test_lists_of_arrays_have_keys_of_their_own():
    a, b = np.arange(4.0), np.arange(4.0).reshape(2, 2)
    keys = [array_key(*each) for each in ((a,), (b,), (a, b), (b, a), (None,), (), (a, None), (None, a))]
    assert len(set(keys)) == len(keys)
    assert array_key(a) == array_key(a.copy()) == array_key(np.arange(8.0)[::2] / 2)


def test_only_what_is_there_and_of_this_geometry_is_dropped(tmp_path):
    one, other = Cache(tmp_path, "one"), Cache(tmp_path, "other")
    one.put("transfer", 1, **ARRAYS)
    other.drop("transfer", 1)
    Cache(tmp_path, "one", read_only=True).drop("transfer", 1)
    one.drop("transfer", 2)
    assert one.get("transfer", 1) is not None
    one.drop("transfer", 1)
    assert one.get("transfer", 1) is None and list(tmp_path.iterdir()) == []
