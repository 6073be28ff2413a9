"""The splats of a scene found again: wherever the folder moved, never another file, every row in its place."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from random_meshes import random_mesh
from splat_samples import assert_same, make_splats, tile_at

from splat2mesh.base.errors import InputError
from splat2mesh.scene.folder import _sum
from splat2mesh.scene.meshfile import write_mesh_ply
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe, source_parts, source_splats
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.placing import placed, similarity

MATRICES = [similarity(2.0, translation=[0.0, 1.0, 0.0]), np.diag([1.0, -1.0, -1.0, 1.0])]


def write_ply(path, count, degree=1, seed=0):
    """A file of splats, one of them broken."""
    splats = make_splats(count, degree, seed)
    splats.means[count // 2, 1] = np.nan
    path.parent.mkdir(parents=True, exist_ok=True)
    write_splats(path, splats)
    return path


def save_scene(folder, splat):
    scene = Scene.from_mesh(random_mesh(), 50, source=describe(splat))
    scene.save(folder)
    return scene


def save_layout_scene(folder, layout, splats):
    """A scene folder such as `convert_layout` makes, of objects at MATRICES with a chunk each."""
    entries = [
        {"name": f"object {i}", **describe(splat), "scene_from_splat": matrix.tolist(), "chunks": [i, i + 1]}
        for i, (splat, matrix) in enumerate(zip(splats, MATRICES, strict=True))
    ]
    layout.write_text("{}")
    scene = Scene([random_mesh(seed=i) for i in range(2)], source={**describe(layout), "objects": entries})
    scene.save(folder)
    return scene


@pytest.fixture
def work(tmp_path, monkeypatch):
    """A folder with a/guitar.ply and the scene a/out/guitar of it; the current folder is another one."""
    write_ply(tmp_path / "a" / "guitar.ply", 30)
    save_scene(tmp_path / "a" / "out" / "guitar", tmp_path / "a" / "guitar.ply")
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path


def recorded(folder):
    return json.loads((folder / "scene.json").read_text(encoding="utf-8"))["source"]


def test_every_row_comes_back_in_its_order_uncleaned(work):
    splats, paths = source_splats(Scene.load(work / "a" / "out" / "guitar"))
    assert paths == [work / "a" / "guitar.ply"]
    assert_same(splats, read_splats(work / "a" / "guitar.ply"))
    assert len(splats) == 30 and np.isnan(splats.means[15]).any()


def test_the_folder_keeps_a_relative_path_and_the_scene_an_absolute_one(work, monkeypatch):
    assert recorded(work / "a" / "out" / "guitar")["path"] == "../../guitar.ply"
    monkeypatch.chdir(work / "a")
    scene = Scene.load("out/guitar")
    assert scene.source["path"] == str(work / "a" / "guitar.ply")
    scene.save("copy")  # one folder higher, so the way is another
    assert recorded(work / "a" / "copy")["path"] == "../guitar.ply"
    assert describe("guitar.ply")["path"] == str(work / "a" / "guitar.ply")


def test_scene_and_splat_can_be_moved_together(work):
    (work / "a").rename(work / "b")
    assert source_splats(Scene.load(work / "b" / "out" / "guitar"))[1] == [work / "b" / "guitar.ply"]


@pytest.mark.parametrize("place", ["a/out/guitar.ply", "elsewhere/guitar.ply"])
def test_a_splat_beside_the_scene_or_in_the_current_folder_is_found(work, place):
    (work / "a" / "guitar.ply").rename(work / place)
    assert source_splats(Scene.load(work / "a" / "out" / "guitar"))[1] == [work / place]


def test_a_scene_folder_of_before_without_a_path(work):
    folder = work / "a" / "out" / "guitar"
    meta = json.loads((folder / "scene.json").read_text())
    del meta["source"]["path"]
    (folder / "scene.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match="does not exist: name the right one by `splat`"):
        source_splats(Scene.load(folder))
    (work / "a" / "guitar.ply").rename(folder.parent / "guitar.ply")
    assert source_splats(Scene.load(folder))[1] == [folder.parent / "guitar.ply"]


def test_another_file_of_the_name_is_passed_over(work):
    original = (work / "a" / "guitar.ply").rename(work / "a" / "out" / "guitar.ply")
    write_ply(work / "a" / "guitar.ply", 30, seed=1)
    assert source_splats(Scene.load(work / "a" / "out" / "guitar"))[1] == [original]


def test_a_changed_or_missing_splat_is_refused_with_the_next_step(work):
    scene = Scene.load(work / "a" / "out" / "guitar")
    write_ply(work / "a" / "guitar.ply", 30, seed=1)
    with pytest.raises(InputError, match=r"a/guitar.ply is not the splat .*SHA-256 differs.*`splat`") as caught:
        source_splats(scene)
    assert "\n" not in str(caught.value)
    (work / "a" / "guitar.ply").unlink()
    with pytest.raises(InputError, match=r"a/guitar.ply, which .* does not exist: .*`splat`"):
        source_splats(scene)


def test_a_given_path_is_the_only_one_looked_at(work):
    scene = Scene.load(work / "a" / "out" / "guitar")
    other = write_ply(work / "other.ply", 30, seed=1)
    renamed = shutil.copy(work / "a" / "guitar.ply", work / "renamed.bin")
    assert source_splats(scene, renamed)[1] == [renamed]
    with pytest.raises(InputError, match=r"other.ply is not the splat .*`splat` must name the unchanged one"):
        source_splats(scene, other)
    with pytest.raises(InputError, match=r"`splat` nothing.ply: no such file"):
        source_splats(scene, "nothing.ply")


def test_a_plain_mesh_has_no_splat(tmp_path):
    write_mesh_ply(tmp_path / "a.ply", random_mesh())
    with pytest.raises(InputError, match=r"a.ply is a mesh without a splat"):
        source_splats(Scene.load(tmp_path / "a.ply"))


def test_an_unbundled_sog_is_found_by_the_name_of_its_folder(work, monkeypatch):
    """Only where it is looked for is at stake here: its files could be anything."""
    folder = work / "a" / "lod3"
    folder.mkdir()
    (folder / "meta.json").write_text("{}")
    (folder / "means.webp").write_bytes(b"picture")
    save_scene(work / "a" / "out" / "robot", folder / "meta.json")
    folder.rename(work / "a" / "out" / "lod3")
    monkeypatch.setattr("splat2mesh.scene.sources.read_splats", lambda path, lod: make_splats(9, 0))
    scene = Scene.load(work / "a" / "out" / "robot")
    assert source_splats(scene)[1] == [work / "a" / "out" / "lod3" / "meta.json"]
    assert source_splats(scene, work / "a" / "out" / "lod3")[1] == [work / "a" / "out" / "lod3"]
    (work / "a" / "out" / "lod3" / "means.webp").write_bytes(b"another picture")
    with pytest.raises(InputError, match="SHA-256 differs"):
        source_splats(scene)


def test_links_among_the_folders_do_not_lead_astray(work):
    """From link/out, `..` is where the link leads, not where it stands."""
    (work / "deep" / "er").mkdir(parents=True)
    (work / "link").symlink_to(work / "deep" / "er")
    save_scene(work / "link" / "guitar", work / "a" / "guitar.ply")
    (work / "shortcut.ply").symlink_to(work / "a" / "guitar.ply")
    save_scene(work / "named", work / "shortcut.ply")
    for folder in (work / "link" / "guitar", work / "deep" / "er" / "guitar"):
        assert source_splats(Scene.load(folder))[1] == [work / "a" / "guitar.ply"]
    assert recorded(work / "named")["path"] == "../shortcut.ply"  # as the user gave it
    bust = write_ply(work / "deep" / "bust.ply", 12)
    save_scene(work / "back", work / "link" / ".." / "bust.ply")
    assert source_splats(Scene.load(work / "back"))[1] == [bust]


# -- layouts


@pytest.fixture
def room(work):
    """A layout scene `a/room` of guitar.ply (degree 1) and b/bust.ply (degree 2)."""
    write_ply(work / "a" / "b" / "bust.ply", 20, degree=2, seed=5)
    files = [work / "a" / "guitar.ply", work / "a" / "b" / "bust.ply"]
    save_layout_scene(work / "a" / "room", work / "a" / "room.json", files)
    return work


def test_a_layout_gives_all_its_splats_placed_and_joined(room):
    splats, paths = source_splats(Scene.load(room / "a" / "room"))
    files = [room / "a" / "guitar.ply", room / "a" / "b" / "bust.ply"]
    assert paths == files and len(splats) == 50 and splats.degree == 2
    for rows, file, matrix in zip((slice(0, 30), slice(30, 50)), files, MATRICES, strict=True):
        alone = placed(read_splats(file), matrix)
        k = alone.sh.shape[1]
        found = splats.take(rows)
        assert not found.sh[:, k:].any()
        assert_same(replace(found, sh=found.sh[:, :k]), alone)


def test_the_parts_of_a_layout_know_their_chunks_and_names(room):
    parts = source_parts(Scene.load(room / "a" / "room"))
    assert [(part.name, part.chunks, len(part.splats)) for part in parts] == [
        ("object 0", range(0, 1), 30),
        ("object 1", range(1, 2), 20),
    ]
    (alone,) = source_parts(Scene.load(room / "a" / "out" / "guitar"))
    assert alone.name == "guitar.ply" and alone.chunks == range(len(Scene.load(room / "a" / "out" / "guitar").chunks))


def test_the_layout_or_its_folder_can_be_named(room):
    scene = Scene.load(room / "a" / "room")
    for name in ("guitar.ply", "b", "room.json"):
        target = room / "moved" / name
        target.parent.mkdir(exist_ok=True)
        (room / "a" / name).rename(target)
    expected = [room / "moved" / "guitar.ply", room / "moved" / "b" / "bust.ply"]
    with pytest.raises(InputError, match=r"guitar.ply.*does not exist"):
        source_splats(scene)
    assert source_splats(scene, room / "moved")[1] == expected
    assert source_splats(scene, room / "moved" / "room.json")[1] == expected
    expected[1].rename(room / "moved" / "bust.ply")  # or all of them in one folder
    assert source_splats(scene, room / "moved")[1] == [expected[0], room / "moved" / "bust.ply"]


def test_one_changed_splat_of_a_layout_is_named(room):
    write_ply(room / "a" / "b" / "bust.ply", 20, degree=2, seed=6)
    with pytest.raises(InputError, match=r"bust.ply is not the splat"):
        source_splats(Scene.load(room / "a" / "room"))


def without(name):
    return lambda entry: entry.pop(name)


def with_value(name, value):
    return lambda entry: entry.update({name: value})


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (without("chunks"), "its source is damaged"),
        (without("sha256"), "its source is damaged"),
        (without("path"), "its source is damaged"),
        (with_value("chunks", [0, 9]), "its source is damaged"),
        (with_value("chunks", 1), "its source is damaged"),
        (with_value("scene_from_splat", "sideways"), "its source is damaged"),
        (with_value("scene_from_splat", np.diag([1, 1, -1, 1]).tolist()), "mirrors"),
        (with_value("path", 7), "damaged"),
    ],
)
def test_a_damaged_source_is_refused(room, damage, message):
    path = room / "a" / "room" / "scene.json"
    meta = json.loads(path.read_text())
    damage(meta["source"]["objects"][1])
    meta["sha256"] = _sum(meta)
    path.write_text(json.dumps(meta))
    with pytest.raises(InputError, match=message):
        source_splats(Scene.load(room / "a" / "room"))


@pytest.mark.parametrize("source", ["guitar", [1], None, {"objects": 3}])
def test_a_source_that_is_none_is_refused_when_the_scene_is_loaded(work, source):
    path = work / "a" / "out" / "guitar" / "scene.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "source": source}))
    with pytest.raises(InputError, match="damaged"):
        Scene.load(path.parent)


def tile_folder(folder):
    """A folder of two tiles, and the path of the second."""
    write_ply(folder / "a.ply", 20)
    write_splats(folder / "b.ply", tile_at(10, make_splats(30, 2)))
    return folder / "b.ply"


def test_a_folder_of_tiles_is_one_source_whose_every_file_counts(tmp_path, monkeypatch):
    last = tile_folder(tmp_path / "tiles")
    save_scene(tmp_path / "out", tmp_path / "tiles")
    scene = Scene.load(tmp_path / "out")
    splats, paths = source_splats(scene)
    assert paths == [tmp_path / "tiles"] and len(splats) == 50
    assert_same(splats, read_splats(tmp_path / "tiles"))
    (tmp_path / "tiles").rename(tmp_path / "moved")
    assert source_splats(scene, tmp_path / "moved")[1] == [tmp_path / "moved"]
    write_ply(tmp_path / "moved" / "b.ply", 30, degree=2, seed=9)
    with pytest.raises(InputError, match="its SHA-256 differs"):
        source_splats(scene, tmp_path / "moved")
    (tmp_path / "moved" / last.name).unlink()
    (tmp_path / "moved" / "a.ply").unlink()
    with pytest.raises(InputError, match=r"no splat file lies in it.* `splat` must name the unchanged one"):
        source_splats(scene, tmp_path / "moved")
