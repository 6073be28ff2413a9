"""Floaters: found where they are put, and nothing else."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from place_splats import garden, joined, room, wall

from relight import Environment, RelightRequest
from relight.cli import main
from relight.jobs.folders import relight_files
from relight.splats.floaters import floaters
from scenes.cameras import FLIP, SCENE_FROM_SPLAT, capture_views
from scenes.capture import FLOATER, LEAF, SKY, SOLID, capture
from scenes.places import build_place
from scenes.radiosity import light
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import read_splats, write_splats
from splat2mesh.splats.formats.inria import write_inria_ply
from splat2mesh.splats.splats import Splats


def blobs(places, size=0.03, opacity=0.5):
    count = len(places)
    means, scales = np.asarray(places, np.float32), np.full((count, 3), size, np.float32)
    quats = np.tile(np.float32([1, 0, 0, 0]), (count, 1))
    return Splats(means, scales, quats, np.full(count, opacity, np.float32), np.ones((count, 1, 3), np.float32))


@cache
def captured():
    """(Splats, their kinds, Scene of the surfaces and every other leaf) of a garden, with 60 floaters more."""
    place = build_place("garden", 3, 8000)
    views = capture_views(place, 24)
    made = capture(place, light(place, Environment.load("overcast")), views, 12_000, 1)
    rng = np.random.default_rng(5)
    eyes, ways = (np.stack([getattr(view, name) for view in views]) for name in ("center", "forward"))
    chosen = rng.integers(len(views), size=60)
    ahead = rng.uniform(0.3, 1.2, (60, 1))
    more = blobs(eyes[chosen] + ahead * (ways[chosen] + 0.2 * rng.normal(size=(60, 3))))
    splats = joined(made.splats, more)
    kinds = np.concatenate([made.region, np.full(60, FLOATER)])
    leaf = (place.faces[:, 0] - place.leaf_start) // 8
    held = (leaf < 0) | (leaf % 2 == 0)
    colors = np.full(place.vertices.shape, 127, np.uint8)
    mesh = Mesh(place.vertices, place.normals, place.faces[held], colors)
    known = {"from": "both", "eyes": (eyes * FLIP).tolist()}
    far = np.flatnonzero(kinds == SKY)
    return splats, kinds, Scene([mesh], scene_from_splat=SCENE_FROM_SPLAT, capture=known, background_splats=far)


def grid(splats):
    """A Mesh whose vertices are the middles of opaque splats, each with a small face of its own in their plane."""
    axes = splats.rotation_matrices()
    size = 3.0 * splats.scales.max(axis=1)[:, None]
    first, second = axes[:, :, 0] * size, axes[:, :, 1] * size
    corners = np.stack([splats.means + first, splats.means - first + second, splats.means - first - second], axis=1)
    vertices = corners.reshape(-1, 3).astype(np.float32)
    normals = np.repeat(axes[:, :, 2], 3, axis=0).astype(np.float32)
    return Mesh(
        vertices,
        normals,
        np.arange(len(vertices), dtype=np.int32).reshape(-1, 3),
        np.full_like(vertices, 127, np.uint8),
    )


def scene_of(splats, eyes, **more):
    known = {"from": "inside", "eyes": eyes} if eyes else {"from": "outside"}
    return Scene([grid(splats)], capture=known, **more)


def test_most_floaters_of_a_garden_are_found_and_almost_nothing_that_is_real():
    splats, kinds, scene = captured()
    found = kinds[floaters(splats, scene)]
    share = np.bincount(found, minlength=4) / np.bincount(kinds, minlength=4)
    assert share[FLOATER] > 0.9
    assert share[SOLID] < 0.002 and share[SKY] == 0.0
    assert share[LEAF] < 0.01  # though half of them have no surface


def test_what_hangs_in_a_room_is_found_and_the_room_is_not():
    real = room(0.1)
    places = [[0.0, 1.2, 0.0], [-1.0, 1.5, 0.5], [1.2, 1.0, -0.7]]
    splats = joined(real, blobs(places))
    found = floaters(splats, scene_of(real, [[-0.5, 1.3, -0.4], [0.6, 1.4, 0.4]]))
    np.testing.assert_array_equal(found, np.arange(len(real), len(splats)))


def test_neighbours_hold_what_has_no_surface():
    real, middle = room(0.1), np.array([0.0, 1.2, 0.0])
    splats = joined(real, blobs(np.random.default_rng(1).normal(middle, 0.03, (12, 3)), 0.01))
    assert len(floaters(splats, scene_of(real, [[-0.8, 1.3, -0.6]]))) == 0


def test_a_splat_that_alone_covers_a_hole_stays():
    real = room(0.1)
    hole = np.linalg.norm(real.means - [0.0, 1.2, -1.5], axis=1) < 0.5
    rest = real.take(np.flatnonzero(~hole))
    before = joined(rest, blobs([[0.0, 1.2, -0.9]], 0.25, 0.99))
    eyes = [[0.0, 1.2, 1.2]]
    assert len(floaters(before, scene_of(rest, eyes))) == 0
    assert len(floaters(joined(real, before.take(slice(len(rest), None))), scene_of(real, eyes))) == 1


def test_what_nobody_sees_stays():
    real = room(0.1)
    splats = joined(real, blobs([[0.0, 6.0, 0.0], [0.0, 1.2, 0.0]]), blobs([[0.0, 1.3, 0.5]], opacity=1e-3))
    broken = replace(splats, means=np.where(np.arange(len(splats))[:, None] == 3, np.nan, splats.means))
    np.testing.assert_array_equal(floaters(broken, scene_of(real, [[-0.8, 1.3, -0.6]])), [len(real) + 1])


def test_of_an_object_only_its_box_is_looked_at():
    real = wall([-1, 0, -1], [0, 0, 2], [2, 0, 0], 0.05)
    tall = joined(real, wall([-1, 0, -1], [2, 0, 0], [0, 1, 0], 0.05))
    splats = joined(tall, blobs([[0.2, 0.6, 0.1], [0.0, 4.0, 0.0]], 0.02))
    np.testing.assert_array_equal(floaters(splats, scene_of(tall, None)), [len(tall)])


def test_the_far_background_stays():
    real = garden(0.1)
    far = np.abs(real.means).max(axis=1) > 10
    scene = scene_of(real.take(np.flatnonzero(~far)), [[1.5, 1.5, 1.5]], background_splats=np.flatnonzero(far))
    assert len(floaters(real, scene)) == 0


@pytest.fixture
def place(tmp_path):
    """A scene folder of a room with a floater, its rows in its file, and which row that is."""
    real = room(0.1)
    splats = joined(real, blobs([[0.0, 1.2, 0.0]]))
    write_inria_ply(tmp_path / "room.ply", splats)
    scene = scene_of(real, [[-0.8, 1.3, -0.6]], source=describe(tmp_path / "room.ply"))
    scene.save(tmp_path / "room")
    return tmp_path / "room", len(real)


def test_the_command_keeps_the_other_rows_to_the_bit_and_says_how_many_went(place, tmp_path, capsys):
    folder, row = place
    assert main([str(folder), "--format", "clean-splat", "-o", str(tmp_path / "out"), "--no-cache"]) == 0
    assert f"1 of {row + 1:,} splats were floaters" in capsys.readouterr().out
    before, after = (path.read_bytes() for path in (tmp_path / "room.ply", tmp_path / "out" / "clean_splat.ply"))
    size = 4 * before.partition(b"end_header\n")[0].count(b"property")
    assert after == before.replace(b"vertex %d" % (row + 1), b"vertex %d" % row)[:-size]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["clean_splat.ply", "report.json"]


def test_a_splat_of_another_kind_is_written_in_both(place, tmp_path):
    folder, row = place
    write_splats(tmp_path / "room.spz", Splats.load(tmp_path / "room.ply"), "spz")
    scene = Scene.load(folder)
    scene.source = describe(tmp_path / "room.spz")
    done = relight_files(RelightRequest(scene, formats=("clean-splat",), output=tmp_path / "out", caching="none"))
    assert [path.name for path in done.files] == ["clean_splat.ply", "clean_splat.spz"]
    assert [len(read_splats(path)) for path in done.files] == [row, row]
    assert done.reports[0]["clean_splat"] == {"splats": row + 1, "floaters": 1}


def test_a_mesh_has_no_splats_to_clean(tmp_path):
    scene = Scene([grid(room(0.3))])
    with pytest.raises(InputError, match="a mesh without a splat"):
        relight_files(RelightRequest(scene, formats=("clean-splat",), output=tmp_path / "out", caching="none"))
