"""A mesh whose floor mirrors: closed, without the images below, and otherwise as it was."""

from dataclasses import replace

import numpy as np
import pytest
from mirrored_rooms import DEEP, DIM, EYES, OWN, WIDE, floor, room, scene_of, walls

from relight.jobs.job import Job
from relight.request import RelightRequest
from relight.splats import Binding
from relight.splats.closed_floor import closed_floor
from relight.splats.floor_mirror import floor_mirror
from relight.transfer.store import Cache
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.measured import Measured
from splat2mesh.scene.scene import Scene
from splat2mesh.scene.sources import describe
from splat2mesh.splats.formats import write_splats

FLIP = np.array([1.0, -1.0, 1.0])
BELOW = [[x, -y, z] for x, y, z in EYES[:3]]


@pytest.fixture(scope="module")
def polished():
    """A mesh that has the images of the walls too, its Splats, and the floor that mirrors."""
    _, splats = room()
    standing = [*walls(), floor(True)]
    images = [(p * FLIP, n * FLIP, OWN + DIM * c, f[:, ::-1]) for p, n, c, f in standing[:-1]]
    scene = scene_of([*standing, *images], {"from": "inside", "eyes": EYES + BELOW})
    count = len(scene.vertices)
    scene.measured = Measured(None, np.zeros(len(splats), np.float32), np.linspace(0.0, 1.0, count, dtype=np.float32))
    return scene, splats, floor_mirror(splats, scene)


@pytest.fixture(scope="module")
def closed(polished):
    scene, splats, mirror = polished
    return closed_floor(scene, mirror, splats)


def drop(scene, x, z):
    """Where rays down from a bit above the floor meet a scene."""
    start = np.stack([x.ravel(), np.full(x.size, 0.3), z.ravel()], axis=1)
    rays = np.hstack([start, np.tile([0.0, -1.0, 0.0], (x.size, 1))]).astype(np.float32)
    return RayCaster(scene.vertices, scene.faces).first_hits(rays)


def test_there_is_a_floor_and_no_image(polished, closed):
    scene, _, mirror = polished
    assert scene.vertices[:, 1].min() < -2.0 and closed.vertices[:, 1].min() > -mirror.margin
    x, z = np.meshgrid(np.linspace(-2.2, 2.2, 30), np.linspace(-1.7, 1.7, 30))
    hits = drop(closed, x, z)
    assert (np.abs(hits.distance - 0.3) < 0.01).mean() > 0.97 and (drop(scene, x, z).distance < 0.4).mean() < 0.4
    corners = closed.vertices[closed.faces[hits.faces[hits.faces >= 0]]]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 1] > 0.0).all()
    np.testing.assert_allclose(
        closed.chunks[-1].normals, np.tile([0, 1, 0], (len(closed.chunks[-1].normals), 1)), atol=0.01
    )


def test_what_stands_above_stays_as_it_was(polished, closed):
    scene, _, mirror = polished
    kept, before = closed.chunks[0], scene.chunks[0]
    high = np.unique(before.faces[closed.left[0]])
    assert (
        before.vertices[before.faces[np.setdiff1d(range(len(before.faces)), closed.left[0])]][:, :, 1].min(axis=1)
        < -mirror.margin
    ).all()
    for name in ("vertices", "normals", "colors_srgb"):
        np.testing.assert_array_equal(getattr(kept, name), getattr(before, name)[high])
    np.testing.assert_array_equal(kept.vertices[kept.faces], before.vertices[before.faces[closed.left[0]]])
    shares = closed.measured.vertex_volume
    np.testing.assert_array_equal(shares[: len(high)], scene.measured.vertex_volume[high])
    assert len(shares) == len(closed.vertices) and not shares[len(high) :].any()


def test_what_closes_it_lies_under_the_floor_that_is_there(closed):
    patch = closed.chunks[-1].vertices
    assert (
        np.abs(patch[:, [0, 2]]) < [WIDE / 2 + 0.1, DEEP / 2 + 0.1]
    ).all()  # no further than a cell beyond the walls
    over = (patch[:, 0] > 1.01) & (patch[:, 0] < WIDE / 2 - 0.1) & (np.abs(patch[:, 2]) < DEEP / 2 - 0.1)
    assert patch[:, 1].max() < 0.01 and (patch[over, 1] < 0.0).all() and patch[over, 0].max() < 1.2


def test_it_has_the_color_that_eyes_see(closed):
    """The own colour of the floor and what it mirrors of walls of .1 to .9."""
    patch = closed.chunks[-1]
    colors = closed.colors_linear[-len(patch.vertices) :]
    inner = np.abs(patch.vertices[:, 2]) < 1.5
    assert (colors[inner] > OWN - 0.02).all() and (colors[inner].mean(axis=0) < OWN + 0.9 * DIM).all()
    assert len(np.unique(colors, axis=0)) > 20


def test_standpoints_in_the_mirror_world_are_left_out(closed):
    assert closed.capture == {"from": "inside", "eyes": EYES}


def test_a_chunk_of_images_alone_goes(polished, closed):
    scene, splats, mirror = polished
    (mesh,) = scene.chunks
    low = (mesh.vertices[mesh.faces][:, :, 1] < -1e-4).any(axis=1)
    two = [replace(mesh, faces=mesh.faces[rows]) for rows in (low, ~low)]
    measured = scene.measured._replace(vertex_volume=np.tile(scene.measured.vertex_volume, 2))
    cut = closed_floor(replace(scene, chunks=two, measured=measured), mirror, splats)
    assert len(cut.chunks) == len(closed.chunks) and [len(rows) > 0 for rows in cut.left] == [False, True]
    assert len(cut.measured.vertex_volume) == len(cut.vertices)
    np.testing.assert_array_equal(cut.chunks[-1].vertices, closed.chunks[-1].vertices)


def test_a_layout_keeps_its_mesh(polished):
    scene, splats, mirror = polished
    several = replace(scene, source={"objects": [{"name": "a"}, {"name": "b"}]})
    assert closed_floor(several, mirror, splats) is several


def test_what_closes_it_is_kept(polished, closed, tmp_path, monkeypatch):
    scene, splats, mirror = polished
    cache = Cache(tmp_path, "room")
    closed_floor(scene, mirror, splats, cache)
    (path,) = tmp_path.glob("closed_floor-*.npz")
    with monkeypatch.context() as patched:
        patched.setattr("relight.splats.closed_floor._patch", None)
        again = closed_floor(scene, mirror, splats, cache)
    np.testing.assert_array_equal(again.chunks[-1].faces, closed.chunks[-1].faces)
    np.testing.assert_array_equal(again.chunks[-1].colors_srgb, closed.chunks[-1].colors_srgb)
    with np.load(path) as kept:
        broken = dict(kept) | {"faces": kept["faces"] + np.int32(10**6)}
    np.savez(path, **broken)
    again = closed_floor(scene, mirror, splats, cache)
    np.testing.assert_array_equal(again.chunks[-1].faces, closed.chunks[-1].faces)


def test_the_floors_own_part_follows_what_closes_it(polished, closed):
    _, splats, mirror = polished
    mirrored = Binding(splats, closed, views=()).mirroring(mirror, closed).mirrored
    count = len(closed.vertices)
    values = np.where(closed.vertices[:, 1:2] < 0.01, 1.0, 0.0).astype(np.float32)
    of_floor = mirrored.pair(values, np.full((len(mirrored.rows), 1), 7.0, np.float32))[1]
    assert count == len(values) and (of_floor[:, 0] < 7.0).mean() > 0.95  # where the mesh has no floor, 7


def test_a_job_lights_the_closed_scene_and_another_as_it_is(polished, closed, tmp_path):
    scene, splats, _ = polished
    write_splats(tmp_path / "room.ply", splats, "ply")
    made = Scene(scene.chunks, capture=scene.capture, source=describe(tmp_path / "room.ply"))
    made.save(tmp_path / "room")
    lit = Job(RelightRequest(tmp_path / "room", "noon", formats=("splat",)))
    np.testing.assert_allclose(lit.known.scene.vertices, closed.vertices, atol=1e-5)
    assert lit.inputs.read_scene.vertex_count == scene.vertex_count
    Scene(scene.chunks, capture=scene.capture).save(tmp_path / "alone")  # without splats nothing tells
    alone = Job(RelightRequest(tmp_path / "alone", "noon", formats=("glb",)))
    assert alone.known.scene is alone.inputs.read_scene
