"""Light traced at some vertices and taken over by the others: exact where shown, near elsewhere, kept and checked."""

import numpy as np
import pytest
from plan_scenes import mesh_of, occluder_of, sphere_on_plane, square

from relight import Environment, Relighter
from relight.transfer.bounce_places import BouncePlaces, Shooting
from relight.transfer.bounce_rows import FINENESS, SIDE
from relight.transfer.bounces import Interreflection
from relight.transfer.receivers import SPARSE, Receivers
from relight.transfer.store import Cache
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

EFFECTS = {"effects": "shadows,sun,bounces", "bands": 6, "rays": 64}


def in_chunks():
    """A sphere on a plane, cut into chunks: vertices of the seams stand twice."""
    whole = sphere_on_plane()
    cut = Scene.from_mesh(whole.chunks[0], max_chunk_vertices=300)
    assert len(cut.chunks) > 2
    return cut


def left(scene):
    return scene.vertices[:, 0] < 0.0


@pytest.fixture(scope="module")
def scene():
    return in_chunks()


@pytest.fixture(scope="module")
def receivers(scene):
    return Receivers.of_shown(left(scene), occluder_of(scene))


def test_what_is_shown_is_traced_and_a_part_of_the_rest(scene, receivers):
    shown = left(scene)
    assert receivers.traced[shown].all()
    rest = receivers.traced[~shown].mean()
    assert 0.9 / SPARSE < rest < 2.0 / SPARSE  # one in so many nodes, some of which are two vertices
    # Copies of a vertex on a seam are traced together or not at all.
    content = np.hstack([scene.vertices, scene.normals])
    node = np.unique(content, axis=0, return_inverse=True)[1].ravel()
    share = np.bincount(node, receivers.traced) / np.bincount(node)
    assert set(np.unique(share)) == {0.0, 1.0}


def test_what_is_even_stays_even_and_what_is_traced_keeps_its_bits(scene, receivers):
    values = np.random.default_rng(0).random((len(scene.vertices), 5), np.float32)
    values[:, 0] = np.where(receivers.traced, np.float32(0.7), np.nan)
    values[~receivers.traced] = np.nan
    before = values[receivers.traced].copy()
    filled = receivers.filled(values)
    np.testing.assert_array_equal(filled[receivers.traced], before)
    np.testing.assert_allclose(filled[:, 0], 0.7, rtol=1e-6)  # float32 weights that sum to 1
    assert filled[:, 1:].min() >= 0.0 and filled[:, 1:].max() <= 1.0


def test_light_between_is_that_of_the_neighbours(scene, receivers):
    """A smooth field: what is taken over is off by what it changes within an edge or two."""
    field = np.sin(scene.vertices @ np.float32([0.7, 0.4, 0.5]))[:, None].astype(np.float32)
    filled = receivers.filled(np.where(receivers.traced[:, None], field, np.float32(0.0)))
    off = np.abs(filled - field)[~receivers.traced]  # edges of the plane are 0.14 long, and it ends there
    assert off.mean() < 0.1
    assert off.mean() < 0.2 * np.abs(field).mean()


def test_light_where_it_is_shown_is_that_of_the_whole(scene):
    """Direct light and suns to the bit but for averages over rings; bounces by way of what was taken over."""
    light = Environment.load("noon")
    albedo = np.full(scene.vertices.shape, 0.6, np.float32)
    whole = Relighter(scene, **EFFECTS).shade(light, albedo)
    partly = Relighter(scene, **EFFECTS, shown=lambda: left(scene))
    found = partly.shade(light, albedo)
    assert partly.rays_traced < 0.75 * 2 * 64 * len(scene.vertices)
    shown = left(scene)
    off = np.abs(found - whole)[shown].mean() / whole[shown].mean()
    assert off < 0.005
    between = np.abs(found - whole)[~shown].mean() / whole[~shown].mean()
    assert between < 0.1  # the edge of the shadow, on a coarse mesh


def test_kept_receivers_and_bounces_are_found_again(tmp_path):
    scene = in_chunks()
    scene.save(tmp_path / "scene")
    light, results = Environment.load("noon"), []
    for _ in range(2):
        opened = Scene.load(tmp_path / "scene")
        relighter = Relighter(opened, **EFFECTS, shown=lambda: left(opened), cache=Cache.of_scene(opened))  # noqa: B023
        results.append((relighter.shade(light, np.full(opened.vertices.shape, 0.6, np.float32)), relighter.rays_traced))
    np.testing.assert_array_equal(results[0][0], results[1][0])
    assert results[0][1] > 0 and results[1][1] == 0


def test_kept_bounces_of_a_scene_in_chunks_are_found_again(scene):
    """Vertices that stand twice are columns of their own, side by side."""
    occluder = occluder_of(scene)
    made, places = Interreflection(occluder, 16), BouncePlaces.shot(16, Shooting(occluder))
    assert made.shares.min() < 1.0
    light = np.random.default_rng(1).random((len(scene.vertices), 3), np.float32)
    faces, traced = occluder.faces, np.ones(len(scene.vertices), bool)
    kept = BouncePlaces.restored(places._asdict(), 16, len(faces), traced)
    again = Interreflection.of_places(kept, 16, occluder)
    np.testing.assert_array_equal(again.bounce(light), made.bounce(light))
    assert (again.entries, again.back_hits, again.rays) == (made.entries, made.back_hits, 16)


@pytest.mark.parametrize(
    ("name", "change", "reason"),
    [
        ("places", lambda a: np.full_like(a, 1_000_000 * SIDE**2), "faces"),
        ("places", lambda a: a - a % SIDE**2 + FINENESS * SIDE + 1, "faces"),  # beside its face
        ("places", lambda a: a[1:], "rays"),
        ("places", lambda a: a.astype(np.int64), "kind"),
        ("places", lambda a: a.astype(np.float32), "kind"),
        ("used", lambda a: np.full_like(a, 17), "rays"),
        ("used", lambda a: a - 17, "negative"),
        ("used", lambda a: a[1:], "kind"),
        ("hits", lambda a: a + 17, "rays"),
        ("hits", lambda a: a[1:], "kind"),
        ("rows", lambda a: a - 1, "negative"),
        ("rows", lambda a: a + 1, "other vertices"),
        ("rows", lambda a: np.zeros_like(a), "other vertices"),
        ("rows", lambda a: a.astype(np.int64), "kind"),
        ("copies", lambda a: a - 2, "negative"),
        ("copies", lambda a: a[1:], "kind"),
    ],
)
def test_kept_bounces_that_do_not_fit_are_refused(scene, name, change, reason):
    occluder = occluder_of(scene)
    arrays = BouncePlaces.shot(16, Shooting(occluder))._asdict()
    with pytest.raises(InputError, match=f"kept bounces .*{reason}"):
        BouncePlaces.restored(
            arrays | {name: change(arrays[name])}, 16, len(occluder.faces), np.ones(len(scene.vertices), bool)
        )


def test_more_bounce_rays_serve_for_fewer(scene):
    relighter = Relighter(scene, **EFFECTS)
    many = relighter.interreflection(64)
    traced = relighter.rays_traced
    assert relighter.interreflection(16) is many
    assert relighter.rays_traced == traced


def test_vertices_that_nobody_is_beside_are_traced():
    apart = Scene([mesh_of(square(np.zeros(3), np.eye(3)[2], np.eye(3)[0], 6)),
                   mesh_of(square(np.float64([0, 9, 0]), np.eye(3)[2], np.eye(3)[0], 1))])  # fmt: skip
    shown = apart.vertices[:, 1] < 1.0
    receivers = Receivers.of_shown(shown, occluder_of(apart))
    filled = receivers.filled(np.where(receivers.traced[:, None], np.float32(1.0), np.float32(np.nan)))
    np.testing.assert_allclose(filled, 1.0, rtol=1e-6)


def test_all_vertices_need_no_rings(scene):
    every = Receivers.of_shown(np.ones(len(scene.vertices), bool), occluder_of(scene))
    assert every.all and every.key == Receivers.every(3).key
    assert len(every.rows) == len(scene.vertices)


@pytest.mark.parametrize("name, change", [
    ("traced", lambda a: a[:-1]),
    ("traced", lambda a: ~a),
    ("columns0", lambda a: a + 10**6),
    ("columns0", lambda a: a.astype(float)),
    ("starts0", lambda a: a[::-1]),
    ("weights0", lambda a: a * np.float32(np.nan)),
    ("weights0", lambda a: a[:-1]),
    ("nodes0", lambda a: a - 10**6),
])  # fmt: skip
def test_what_was_kept_is_checked(scene, receivers, name, change):
    arrays, shown = receivers.arrays(), left(scene)
    assert Receivers.restored(arrays, shown).key == receivers.key
    with pytest.raises(InputError, match="kept receivers"):
        Receivers.restored(arrays | {name: change(arrays[name])}, shown)
