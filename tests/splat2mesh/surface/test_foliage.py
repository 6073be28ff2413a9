"""Leaves apart from the mesh: no face of them is left, cards cover what they did, the folder keeps both."""

import json
from dataclasses import replace

import numpy as np
import pytest
from ball_splats import solid_ball
from bush import GREEN, GREY, bush_mesh, bush_scene, bush_splats

from splat2mesh.api import convert
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.options import ConvertOptions
from splat2mesh.scene.drawn import Drawn
from splat2mesh.scene.leaves import leaf_faces
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.splats.splats import SOLID
from splat2mesh.surface.cards import FACES, cards, covered_area, leaf_splats
from splat2mesh.surface.foliage import leaves_apart

LIMIT = 3000


@pytest.fixture(scope="module")
def whole():
    return bush_scene(LIMIT)


@pytest.fixture(scope="module", params=["none", "cards"])
def apart(request):
    return leaves_apart(bush_scene(LIMIT), bush_splats()[0], request.param, LIMIT)


def corners_of(vertices, faces):
    """The triangles as bytes, each by its corners whatever their order."""
    return {tuple(sorted(map(bytes, triangle))) for triangle in vertices[faces]}


def test_no_face_of_a_leaf_is_drawn_and_every_other_one_is(whole, apart):
    leaf = leaf_faces(whole.vertices, whole.faces, whole.foliage, whole.measured.depth)
    colors = whole.colors_srgb[whole.faces]
    np.testing.assert_array_equal(leaf, (colors == GREEN).all(axis=(1, 2)))  # as the bush was made
    surfaces = Drawn.surfaces(apart).scene
    assert corners_of(surfaces.vertices, surfaces.faces) == corners_of(whole.vertices, whole.faces[~leaf])
    assert (surfaces.colors_srgb == GREY).all()


def test_all_of_the_mesh_is_still_there_for_the_light(whole, apart):
    assert corners_of(apart.vertices, apart.faces) == corners_of(whole.vertices, whole.faces)
    hull = np.concatenate([apart.chunks[number].colors_srgb for number in apart.hull])
    assert (hull == GREEN).all()
    np.testing.assert_array_equal(apart.foliage, (apart.colors_srgb == GREEN).all(axis=1))


def test_no_chunk_exceeds_its_limit(apart):
    assert max(len(mesh.vertices) for mesh in apart.chunks + apart.cards) <= LIMIT


def test_the_folder_keeps_hull_and_cards_apart_from_the_chunks(apart, tmp_path):
    apart.save(tmp_path / "scene")
    meta = json.loads((tmp_path / "scene/scene.json").read_text())
    assert meta["settings"]["foliage"] in ("none", "cards") and meta["schema_version"] == 3
    drawn = [read_mesh(tmp_path / "scene/chunks" / entry["file"], in_place=True) for entry in meta["chunks"]]
    assert sum(len(mesh.faces) for mesh in drawn) == meta["statistics"]["faces"] == len(Drawn(apart).scene.faces)
    assert [entry.get("cards", False) for entry in meta["chunks"]].count(True) == len(apart.cards)
    again = Scene.load(tmp_path / "scene")
    assert again.hull == apart.hull
    for name in ("vertices", "normals", "faces", "colors_srgb", "foliage"):
        np.testing.assert_array_equal(getattr(again, name), getattr(apart, name))
    for found, expected in zip(again.cards, apart.cards, strict=True):
        np.testing.assert_array_equal(found.vertices, expected.vertices)
        np.testing.assert_array_equal(found.colors_srgb, expected.colors_srgb)


@pytest.mark.parametrize("change", [{"chunk": 99}, {"chunk": "x"}, {"sha256": "0" * 64}])
def test_a_hull_that_was_changed_is_refused(apart, tmp_path, change):
    apart.save(tmp_path / "scene")
    meta = json.loads((tmp_path / "scene/scene.json").read_text())
    meta["hull"][0] |= change
    (tmp_path / "scene/scene.json").write_text(json.dumps(meta))
    with pytest.raises(InputError, match="damaged"):
        Scene.load(tmp_path / "scene")


def test_a_scene_without_leaves_apart_is_written_as_before(whole, tmp_path):
    whole.save(tmp_path / "scene")
    meta = json.loads((tmp_path / "scene/scene.json").read_text())
    assert meta["schema_version"] == 2 and "hull" not in meta and not (tmp_path / "scene/hull").exists()
    assert Drawn(whole).scene is whole
    values = np.ones((whole.vertex_count, 3), np.float32)
    assert Drawn(whole).values(values) is values and Drawn(whole).colors(values) is values


def test_cards_cover_what_their_splats_hide_in_their_colour():
    splats, is_leaf = bush_splats()
    mesh, of_leaf = bush_mesh()
    hull = replace(mesh, faces=mesh.faces[of_leaf[mesh.faces].all(axis=1)])
    rows = np.flatnonzero(is_leaf)
    made, kept = cards(splats.take(rows), hull, FACES * len(rows))
    a, b, c = made.vertices[made.faces.T].astype(np.float64)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1).reshape(-1, FACES).sum(axis=1) / 2.0
    np.testing.assert_allclose(areas, covered_area(splats.take(rows)), rtol=1e-3)  # float32 corners
    assert kept == pytest.approx(1.0) and (made.colors_srgb == GREEN).all()
    across = np.cross(b - a, c - a)
    assert (np.einsum("fk,fk->f", across, made.normals[made.faces[:, 0]]) > 0.0).all()  # wound as their normals say


@pytest.mark.parametrize(("part", "expected"), [(0.6, 1.0), (0.1, None)])
def test_cards_within_a_budget_grow_for_those_that_are_left_out(part, expected):
    splats, is_leaf = bush_splats()
    leaves = splats.take(np.flatnonzero(is_leaf))
    made, kept = cards(leaves, bush_mesh()[0], int(part * FACES * len(leaves)))
    assert len(made.faces) <= part * FACES * len(leaves)
    assert kept == pytest.approx(1.0) if expected else 0.1 < kept < 1.0  # four times their own area at most


def test_splats_of_the_ground_and_haze_become_no_cards():
    splats, is_leaf = bush_splats()
    faint = replace(splats, opacities=np.where(np.arange(len(splats)) % 2 == 0, splats.opacities, 0.9 * SOLID))
    mesh, of_leaf = bush_mesh()
    hull = replace(mesh, vertices=mesh.vertices[of_leaf], normals=mesh.normals[of_leaf])
    rows = leaf_splats(faint, mesh.vertices[~of_leaf], hull, 5.0)
    np.testing.assert_array_equal(rows, np.flatnonzero(is_leaf & (np.arange(len(splats)) % 2 == 0)))


def test_smooth_walls_of_disordered_splats_are_no_leaves(whole):
    """As in a short training: the volume says leaves, the mesh says wall."""
    everywhere = np.ones(whole.vertex_count, np.float32)
    depth = whole.measured.depth
    leaf = leaf_faces(whole.vertices, whole.faces, everywhere, depth)
    ground = (whole.colors_srgb[whole.faces] == GREY).all(axis=(1, 2))
    assert not leaf[ground].any() and leaf[~ground].all()


def test_a_few_leaves_are_no_plant(whole):
    leaf = (whole.colors_srgb[whole.faces] == GREEN).all(axis=(1, 2))
    few = np.concatenate([whole.faces[~leaf], whole.faces[leaf][:20]])
    assert not leaf_faces(whole.vertices, few, whole.foliage, whole.measured.depth).any()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["none", "cards"])
def test_where_nothing_is_leaves_nothing_changes(tmp_path, kind):
    write_inria_ply(tmp_path / "ball.ply", solid_ball())
    plain = convert(tmp_path / "ball.ply", detail="draft", vertices=2000)
    with pytest.warns(DataWarning, match="no leaves"):
        scene = convert(tmp_path / "ball.ply", detail="draft", vertices=2000, foliage=kind)
    assert not scene.hull and not scene.cards and scene.settings["foliage"] == kind
    assert "foliage" not in plain.settings
    for name in ("vertices", "normals", "faces", "colors_srgb"):
        np.testing.assert_array_equal(getattr(scene, name), getattr(plain, name))


def test_a_mesh_of_leaves_alone_is_refused(whole):
    leaf = leaf_faces(whole.vertices, whole.faces, whole.foliage, whole.measured.depth)
    mesh = replace(Drawn(whole).mesh, faces=whole.faces[leaf])
    bush = Scene([mesh], capture=whole.capture, measured=whole.measured)
    with pytest.raises(InputError, match="no surface is left"):
        leaves_apart(bush, bush_splats()[0], "none", LIMIT)


def test_another_word_is_refused(tmp_path):
    with pytest.raises(InputError, match="`foliage` leafless: expected one of mesh cards none"):
        convert(tmp_path / "nothing.ply", foliage="leafless")


def test_a_layout_places_hulls_and_cards_with_their_objects(tmp_path, monkeypatch):
    splats = bush_splats()[0]
    write_inria_ply(tmp_path / "bush.ply", splats)
    entries = [{"splat": "bush.ply", "name": name, "position": at} for name, at in (("a", [0, 0, 0]), ("b", [9, 0, 0]))]
    (tmp_path / "two.json").write_text(json.dumps({"objects": entries}))

    def made(path, options, stages):
        scene = leaves_apart(bush_scene(LIMIT), splats, options.foliage, LIMIT)
        scene.settings = scene.settings | dict.fromkeys(("vertices", "up", "cameras", "lod", "up_from"))
        return scene

    monkeypatch.setattr("splat2mesh.layout.converted", made)
    scene = convert(tmp_path / "two.json", foliage="cards")
    alone = made(None, ConvertOptions(foliage="cards"), None)
    assert len(scene.hull) == 2 * len(alone.hull) and len(scene.cards) == 2 * len(alone.cards)
    assert all((scene.chunks[number].colors_srgb == GREEN).all() for number in scene.hull)
    assert len(Drawn(scene).scene.faces) == 2 * alone.statistics["faces"] == scene.statistics["faces"]
    scene.save(tmp_path / "scene")
    assert Scene.load(tmp_path / "scene").hull == scene.hull
    moved = scene.cards[-1].vertices - alone.cards[-1].vertices
    np.testing.assert_allclose(moved, np.broadcast_to([9.0, 0.0, 0.0], moved.shape), atol=1e-5)
