"""The scene folder: bit-exact round trips, every kind of damage refused, nothing half-written."""

import json

import numpy as np
import pytest
from random_meshes import random_mesh

from splat2mesh.base.errors import InputError
from splat2mesh.scene import meshfile
from splat2mesh.scene.folder import SCHEMA_VERSION, WITHOUT_LEAVES
from splat2mesh.scene.meshfile import write_mesh_ply
from splat2mesh.scene.scene import Scene
from splat2mesh.views.upright import scene_from_splat

ATTRIBUTES = ("vertices", "normals", "faces", "colors_srgb")


def random_scene(seed=0):
    camera = {"eye": [0.1, 0.2, 1 / 3], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0], "fov_deg": 40.0}
    return Scene.from_mesh(
        random_mesh(seed=seed),
        50,
        scene_from_splat=scene_from_splat("-z") + np.pi * 1e-9,
        preview_camera=camera,
        source={"file": "büst.ply", "sha256": "ab" * 32},
        settings={"detail": "draft", "seed": 3},
        statistics={"splats": 1234, "views": 7},
    )


def listing(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))


def edit(folder, change):
    """Apply `change` to the parsed scene.json of a folder."""
    meta = json.loads((folder / "scene.json").read_text(encoding="utf-8"))
    change(meta)
    (folder / "scene.json").write_text(json.dumps(meta), encoding="utf-8")


@pytest.fixture
def saved(tmp_path):
    random_scene().save(tmp_path / "bust")
    return tmp_path / "bust"


def test_a_scene_reads_back_bit_by_bit(saved):
    scene, read = random_scene(), Scene.load(saved)
    assert len(read.chunks) == len(scene.chunks) > 3
    for chunk, expected in zip(read.chunks, scene.chunks, strict=True):
        for name in ATTRIBUTES:
            np.testing.assert_array_equal(getattr(chunk, name), getattr(expected, name), name)
            assert getattr(chunk, name).dtype == getattr(expected, name).dtype
    np.testing.assert_array_equal(read.scene_from_splat, scene.scene_from_splat)
    for name in ("preview_camera", "source", "settings", "statistics"):
        assert getattr(read, name) == getattr(scene, name)
    assert read.path == saved


def test_saving_twice_and_saving_what_was_read_writes_the_same_bytes(saved, tmp_path):
    random_scene().save(tmp_path / "again")
    Scene.load(saved).save(tmp_path / "copy")
    names = listing(saved)
    assert listing(tmp_path / "again") == listing(tmp_path / "copy") == names
    for name in names:
        if (saved / name).is_file():
            content = (saved / name).read_bytes()
            assert (tmp_path / "again" / name).read_bytes() == content
            assert (tmp_path / "copy" / name).read_bytes() == content


def test_scene_json_says_what_the_design_promises(saved):
    scene, meta = random_scene(), json.loads((saved / "scene.json").read_text(encoding="utf-8"))
    assert meta["schema_version"] == WITHOUT_LEAVES
    assert meta["source"] == scene.source and meta["settings"] == scene.settings
    np.testing.assert_array_equal(meta["scene_from_splat"], scene.scene_from_splat)
    np.testing.assert_array_equal(meta["bounds"], scene.bounds)
    assert listing(saved / "chunks") == [entry["file"] for entry in meta["chunks"]]
    for entry, chunk in zip(meta["chunks"], scene.chunks, strict=True):
        assert (entry["vertices"], entry["faces"]) == (len(chunk.vertices), len(chunk.faces))
        np.testing.assert_array_equal(entry["bounds"], [chunk.vertices.min(axis=0), chunk.vertices.max(axis=0)])


def test_the_whole_is_its_chunks_one_after_the_other():
    scene = random_scene()
    start = face = 0
    for chunk in scene.chunks:
        stop, last = start + len(chunk.vertices), face + len(chunk.faces)
        for name in ("vertices", "normals", "colors_srgb"):
            np.testing.assert_array_equal(getattr(scene, name)[start:stop], getattr(chunk, name))
        np.testing.assert_array_equal(scene.vertices[scene.faces[face:last]], chunk.vertices[chunk.faces])
        start, face = stop, last
    assert (start, face) == (len(scene.vertices), len(scene.faces))
    assert scene.faces.dtype == np.int32
    low, high = scene.bounds
    np.testing.assert_array_equal([low, high], [scene.vertices.min(axis=0), scene.vertices.max(axis=0)])
    assert scene.diagonal == pytest.approx(np.linalg.norm(high - low), rel=1e-15)


def test_a_mesh_file_is_a_scene_of_one_chunk_in_its_own_order(tmp_path):
    mesh = random_mesh()
    write_mesh_ply(tmp_path / "a.ply", mesh)
    scene = Scene.load(tmp_path / "a.ply")
    (chunk,) = scene.chunks
    for name in ATTRIBUTES:
        np.testing.assert_array_equal(getattr(chunk, name), getattr(mesh, name))
    np.testing.assert_array_equal(scene.scene_from_splat, np.eye(4))
    assert scene.preview_camera is None


def remove_a_chunk(folder):
    (folder / "chunks" / "0001.ply").unlink()


def shorten_a_chunk(folder):
    path = folder / "chunks" / "0001.ply"
    path.write_bytes(path.read_bytes()[:-5])


def swap_a_chunk(folder):
    write_mesh_ply(folder / "chunks" / "0001.ply", random_mesh(30, 40))


def newer(meta):
    meta["schema_version"] = SCHEMA_VERSION + 1


def without(name):
    return lambda folder: edit(folder, lambda meta: meta.pop(name))


def with_value(name, value):
    return lambda folder: edit(folder, lambda meta: meta.update({name: value}))


DAMAGE = {
    "no scene.json": (lambda folder: (folder / "scene.json").unlink(), "not a scene folder"),
    "empty scene.json": (lambda folder: (folder / "scene.json").write_text(""), "not valid JSON"),
    "half a scene.json": (lambda folder: (folder / "scene.json").write_text('{"schema_version": 1,'), "not valid JSON"),
    "binary scene.json": (lambda folder: (folder / "scene.json").write_bytes(b"\xff\xfe\x00"), "not valid JSON"),
    "a list": (lambda folder: (folder / "scene.json").write_text("[1, 2]"), "no schema_version"),
    "newer schema": (lambda folder: edit(folder, newer), f"schema version {SCHEMA_VERSION + 1}.*update the tool"),
    "version in words": (with_value("schema_version", "one"), "no schema_version"),
    "no version": (without("schema_version"), "no schema_version"),
    "no chunk list": (without("chunks"), "lacks chunks"),
    "empty chunk list": (with_value("chunks", []), "lacks chunks"),
    "no frame": (without("scene_from_splat"), "lacks scene_from_splat"),
    "frame of another shape": (with_value("scene_from_splat", [[1, 0], [0, 1]]), "damaged"),
    "frame in words": (with_value("scene_from_splat", "upside down"), "damaged"),
    "chunks that are no list": (with_value("chunks", 7), "damaged"),
    "chunks without a file": (with_value("chunks", [{"vertices": 3}]), "damaged"),
    "chunk missing": (remove_a_chunk, "0001.ply: no such mesh file"),
    "chunk cut short": (shorten_a_chunk, "0001.ply: broken or cut short"),
    "chunk of another scene": (swap_a_chunk, r"0001.ply: damaged or changed"),
}


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_folder_is_refused_by_name(saved, kind, capfd):
    damage, message = DAMAGE[kind]
    damage(saved)
    with pytest.raises(InputError, match=message) as error:
        Scene.load(saved)
    assert str(saved) in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_what_is_not_there_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such scene folder or mesh file"):
        Scene.load(tmp_path / "nothing")


def test_an_existing_output_is_refused_and_stays_as_it_was(saved):
    before = {name: (saved / name).read_bytes() for name in listing(saved) if (saved / name).is_file()}
    with pytest.raises(InputError, match=r"exists already.*`overwrite`"):
        random_scene(seed=1).save(saved)
    assert {name: (saved / name).read_bytes() for name in before} == before


def test_overwriting_replaces_the_whole_folder(saved, tmp_path):
    (saved / "chunks" / "9999.ply").write_text("left over")
    Scene.from_mesh(random_mesh(seed=1)).save(saved, overwrite=True)
    assert listing(saved) == ["chunks", "chunks/0000.ply", "scene.json"]
    assert listing(tmp_path) == ["bust", "bust/chunks", "bust/chunks/0000.ply", "bust/scene.json"]
    Scene.load(saved)


def test_overwriting_spares_what_is_no_scene(tmp_path):
    folder, file = tmp_path / "photos", tmp_path / "letter.txt"
    folder.mkdir()
    (folder / "cat.jpg").write_text("cat")
    file.write_text("dear")
    for path in (folder, file):
        with pytest.raises(InputError, match=r"holds no scene.json, so `overwrite` does not replace it"):
            random_scene().save(path, overwrite=True)
    assert listing(tmp_path) == ["letter.txt", "photos", "photos/cat.jpg"]
    assert file.read_text() == "dear"


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_failure_while_saving_leaves_what_was_there_and_nothing_else(tmp_path, monkeypatch, overwrite):
    if overwrite:
        random_scene().save(tmp_path / "bust")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    written = []

    def fails_at_the_third(path, mesh):
        written.append(path)
        if len(written) == 3:
            raise OSError("disk full")
        meshfile.write_mesh_ply(path, mesh)

    monkeypatch.setattr("splat2mesh.scene.folder.write_mesh_ply", fails_at_the_third)
    with pytest.raises(OSError, match="disk full"):
        random_scene(seed=1).save(tmp_path / "bust", overwrite=overwrite)
    assert len(written) == 3
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert (tmp_path / "bust").exists() == overwrite and len(list(tmp_path.iterdir())) == overwrite
