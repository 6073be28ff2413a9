"""A polished floor: its mirror world is found and lit by what it mirrors; nothing else is taken for one."""

import numpy as np
import pytest
from mirrored_rooms import DEEP, DIM, EYES, HIGH, OWN, WIDE, image, room, splats_of
from unpacked import from_octahedral

from relight import Environment
from relight.api import RelightPlan
from relight.engine.appearance import appearance_of
from relight.engine.relighter import Relighter
from relight.live.basis import reduced, usual_moment
from relight.live.lights import light_of
from relight.live.live import LiveScene, live_of
from relight.live.response import COEFFICIENTS, light_vector
from relight.live.surface import LIT
from relight.splats import Binding, normals_of, shown_as_sky
from relight.splats.floor_mirror import FloorMirror, floor_mirror
from relight.splats.mirrored_places import by_color
from relight.transfer.settings import Settings
from relight.transfer.store import Cache
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0

SETTINGS = Settings("raytraced", 10, 48, bounce_rays=0)


@pytest.fixture(scope="module")
def mirrored():
    scene, splats = room()
    return scene, splats, floor_mirror(splats, scene)


def shuffled(points, normals, colors):
    """Images at the right places in colours of other places."""
    return image(points, normals, np.random.default_rng(0).permutation(colors) if np.ptp(colors) else 0.6 - colors)


def cellar(points, normals, colors):
    """Another room below, lower and as bright, of one colour."""
    return splats_of(points * [0.8, -0.6, 0.8] - [0, 0.5, 0], normals * [1, -1, 1], 0.5 * np.ones_like(colors), 0.1)


def scatter(points, normals, colors):
    """Gaussians at random below the floor."""
    chance = np.random.default_rng(len(points))
    places = chance.uniform([-WIDE / 2, -2.5, -DEEP / 2], [WIDE / 2, -0.1, DEEP / 2], points.shape)
    return splats_of(places, normals, chance.permutation(colors) * DIM, 0.08)


def layer(points, normals, colors):
    """A second floor below the first."""
    places = points * [1, 0, 1] - [0, 0.4, 0]
    return splats_of(places, np.tile([0.0, 1.0, 0.0], (len(points), 1)), 0.1 * np.ones_like(colors), 0.1)


def test_a_mirror_world_is_found_with_its_floor_and_reflectance(mirrored):
    found = mirrored[2]
    assert found is not None
    assert found.normal == pytest.approx([0, 1, 0], abs=1e-3) and found.offset == pytest.approx(0.0, abs=0.01)
    assert found.reflectance == pytest.approx(DIM, rel=0.35)  # blur of Gaussians and vertices
    assert found.own == pytest.approx(OWN, abs=0.03)
    assert found.agreement > 0.7 > found.turned


def test_it_is_all_that_lies_below(mirrored):
    _, splats, found = mirrored
    below = np.flatnonzero(splats.means[:, 1] < -found.margin)
    assert np.isin(found.rows, below).all() and len(found.rows) > 0.95 * len(below)
    assert found.as_dict()["splats"] == len(found.rows)


def test_a_plan_says_how_many_splats_it_is(mirrored):
    entry = mirrored[2].as_dict()
    line = f"mirrored floor: {entry['splats']:,} splats take the light of what it mirrors"
    assert line in RelightPlan(None, "", mirrored_floor=entry).table()
    assert not any("mirrored" in each for each in RelightPlan(None, "").table())


def test_standpoints_found_in_the_mirror_world_do_not_hide_it(mirrored):
    scene, splats, _ = mirrored
    below = [[x, -y, z] for x, y, z in EYES]
    both = Scene(scene.chunks, capture={"from": "inside", "eyes": EYES + below})
    assert floor_mirror(splats, both) is not None


@pytest.mark.parametrize("below", [None, shuffled, cellar, scatter, layer])
def test_other_things_below_a_floor_are_no_reflection(below):
    scene, splats = room(below)
    assert floor_mirror(splats, scene) is None


def test_nothing_is_seen_through_a_floor_that_covers():
    scene, splats = room(polished=False)
    assert floor_mirror(splats, scene) is None


def test_an_object_has_no_such_floor(mirrored):
    scene, splats, _ = mirrored
    assert floor_mirror(splats, Scene(scene.chunks)) is None
    below = [[x, -y, z] for x, y, z in EYES]
    assert floor_mirror(splats, Scene(scene.chunks, capture={"from": "inside", "eyes": below})) is None


def test_the_answer_is_kept(mirrored, tmp_path, monkeypatch):
    scene, splats, found = mirrored
    cache = Cache(tmp_path, "room")
    first = floor_mirror(splats, scene, cache=cache)
    monkeypatch.setattr("relight.splats.floor_mirror._proven", None)
    again = floor_mirror(splats, scene, cache=cache)
    for one in (first, again):
        assert all(np.array_equal(a, b) for a, b in zip(one, found, strict=True))


def relit(scene, splats, mirror, change):
    before = np.ones((len(scene.vertices), 3), np.float32)
    binding = Binding(splats, scene, views=()).mirroring(mirror, scene)
    after = binding.relit(before, before * change(scene.vertices)[:, None])
    return after, binding


def linear(splats, rows):
    return linear_from_srgb(np.clip(0.5 + SH_C0 * splats.sh[rows, 0], 0.0, 1.0))


def test_a_reflection_takes_the_light_of_what_it_mirrors(mirrored):
    scene, splats, found = mirrored
    found = found._replace(own=np.zeros(3))
    after, _ = relit(scene, splats, found, lambda points: np.where(points[:, 0] > WIDE / 2 - 0.01, 0.25, 1.0))
    right, middle = splats.means[:, 0] > WIDE / 2 - 0.01, np.abs(splats.means[:, 2]) < 1.5
    wall = np.flatnonzero(right & middle & (splats.means[:, 1] < -0.3) & (splats.means[:, 1] > 0.3 - HIGH))
    np.testing.assert_allclose(linear(after, wall), 0.25 * linear(splats, wall), rtol=0.05)
    left = np.flatnonzero((splats.means[:, 0] < 0.01 - WIDE / 2) & (splats.means[:, 1] < -0.3))
    np.testing.assert_allclose(linear(after, left), linear(splats, left), rtol=0.01)


def test_the_part_of_the_floor_itself_follows_the_floor(mirrored):
    scene, splats, found = mirrored
    rows = np.flatnonzero((splats.means[:, 0] > 1.5) & (splats.means[:, 1] < -0.5))
    own = np.minimum(found.own / linear(splats, rows), 1.0)
    after, _ = relit(scene, splats, found, lambda points: np.where(points[:, 1] < 0.01, 0.5, 1.0))
    np.testing.assert_allclose(linear(after, rows) / linear(splats, rows), 1.0 - 0.5 * own, atol=0.06)


def test_what_stands_above_keeps_every_bit_and_so_does_all_without_a_change(mirrored):
    scene, splats, found = mirrored
    rows = np.flatnonzero(splats.means[:, 1] > -found.margin)
    with_it, binding = relit(scene, splats, found, lambda points: 0.5 + points[:, 1])
    without, plain_binding = relit(scene, splats, None, lambda points: 0.5 + points[:, 1])
    np.testing.assert_array_equal(with_it.sh[rows], without.sh[rows])
    assert (binding.used >= plain_binding.used).all()
    same, _ = relit(scene, splats, found, lambda points: np.ones(len(points)))
    np.testing.assert_array_equal(same.sh, splats.sh)


def test_reflections_have_the_normal_of_the_floor_for_engines(mirrored):
    scene, splats, found = mirrored
    binding = Binding(splats, scene, views=())
    before, after = normals_of(binding), normals_of(binding.mirroring(found, scene))
    np.testing.assert_allclose(after[found.rows], np.tile(found.normal, (len(found.rows), 1)), atol=1e-6)
    others = np.delete(np.arange(len(splats)), found.rows)
    np.testing.assert_array_equal(after[others], before[others])


def test_the_fit_leaves_out_pixels_of_the_mirror_world(mirrored):
    scene, splats, found = mirrored
    looks = Binding(splats, scene).mirroring(found, scene).looks
    plain_looks = Binding(splats, scene).looks
    assert 0 < len(looks.known) < len(plain_looks.known)
    assert np.isin(looks.known, plain_looks.known).all()


def test_a_quick_change_of_light_reaches_reflections_of_what_changes(mirrored):
    scene, splats, found = mirrored
    binding = Binding(splats, scene, views=()).mirroring(found._replace(own=np.zeros(3)), scene)
    ratio = np.ones((len(scene.vertices), 3), np.float32)
    ratio[scene.vertices[:, 0] > WIDE / 2 - 0.01] = 0.25
    after = binding.shaded(splats, ratio)
    middle, high = np.abs(splats.means[:, 2]) < 1.5, np.abs(splats.means[:, 1] + HIGH / 2) < 0.8
    for side, expected in ((1.0, 0.25), (-1.0, 1.0)):
        wall = np.flatnonzero((side * splats.means[:, 0] > WIDE / 2 - 0.01) & middle & high)
        np.testing.assert_allclose(linear(after, wall), expected * linear(splats, wall), rtol=0.05)


def test_far_background_below_the_floor_is_no_sky(mirrored):
    scene, splats, found = mirrored
    rows = np.array([0, len(splats) - 1])
    place = Scene(scene.chunks, capture=scene.capture, background_splats=rows)
    look = type("Look", (), {"room": None, "as_captured": True})
    np.testing.assert_array_equal(shown_as_sky(splats, place, look), rows)
    np.testing.assert_array_equal(shown_as_sky(splats, place, look, found._replace(rows=rows[1:])), rows[:1])


def test_a_kept_answer_that_is_broken_counts_as_none(mirrored, tmp_path):
    scene, splats, _ = mirrored
    cache = Cache(tmp_path, "room")
    assert floor_mirror(splats, scene, cache=cache) is not None
    (path,) = tmp_path.glob("floor_mirror-*.npz")
    with np.load(path) as kept:
        broken = dict(kept) | {"offset": np.array(np.nan)}
    np.savez(path, **broken)
    again = floor_mirror(splats, scene, cache=cache)
    assert isinstance(again, FloorMirror) and np.isfinite(again.offset)


def test_live_rows_mix_the_colors_of_both_parts():
    rng = np.random.default_rng(0)
    moment = usual_moment(1.0)
    patterns = rng.normal(size=(10, COEFFICIENTS))  # 30 directions with their colours, of 48
    values = np.einsum("vpc,pk->vkc", rng.normal(size=(60, 10, 3)), patterns).astype(np.float32)
    rows, basis = reduced(values, np.ones(60), moment)
    own = rng.uniform(size=(20, 3)).astype(np.float32)
    mixed = basis.by_color(moment)(rows[:20], rows[20:40], own)
    vectors = rng.normal(size=(4, COEFFICIENTS, 3)) * np.sqrt(np.diag(moment))[:, None]
    base, small = basis.colors(vectors)
    shown = base + np.einsum("nd,dtc->ntc", rows, small)
    found = base + np.einsum("nd,dtc->ntc", mixed, small)
    expected = by_color(shown[:20], shown[20:40], own[:, None])
    np.testing.assert_allclose(found, expected, atol=0.01 * np.abs(expected).max())


def test_the_bundle_lights_the_mirror_world_by_what_it_mirrors(mirrored):
    scene, splats, found = mirrored
    found = found._replace(own=np.zeros(3))
    relighter = Relighter(scene)
    look = appearance_of("captured", None, relighter)
    lights = [light_of(Environment.load("sunset"), 0.7)]
    live = live_of(LiveScene(relighter, look, splats, mirror=found), lights, SETTINGS)
    rows = np.argsort(live.order)  # in the order of the source
    packed, change = live.surfaces.packed[rows], shown_change(live)[rows]
    assert (packed[found.rows, 7] == (LIT | 63 << 2)).all()
    assert (np.delete(packed[:, 7], found.rows) == LIT).all()
    wall = np.flatnonzero((np.abs(splats.means[:, 0] - WIDE / 2) < 0.01) & (np.abs(splats.means[:, 2]) < 1.5))
    height = splats.means[wall, 1]
    low, real = wall[(height < -0.4) & (height > 0.4 - HIGH)], wall[(height > 0.4) & (height < HIGH - 0.4)]
    for each in (low, real):  # the image has the normal of the wall, which faces outwards here
        assert from_octahedral(packed[each, :2].view(np.int8))[:, 0].mean() > 0.95
    np.testing.assert_allclose(change[low].mean(axis=0), change[real].mean(axis=0), rtol=0.1)


def shown_change(live):
    """(N, 3) change of light of the rows of a bundle in its first light, without suns."""
    light, basis = live.lights[0], live.basis
    vector = light_vector(light.exposure * light.rest, light.exposure * light.whole, light.lamps)
    colors = np.einsum("dkx,kx->dx", basis.directions * basis.direction_scales[:, None, None], vector)
    parts = np.concatenate([basis.means[:, None], basis.components], axis=1) * basis.scales[:, :, None]
    table = np.einsum("cwd,dx->cwx", parts, colors[1:])
    table[:, 0] += colors[0]
    chosen = table[live.transfer[:, :2].copy().view("<u2")[:, 0]]
    return chosen[:, 0] + np.einsum("nw,nwx->nx", live.transfer[:, 2:].view(np.int8).astype(float), chosen[:, 1:])
