"""What rays meet, as bits: against the rays themselves, kept and restored, doubled, and for some vertices only."""

import numpy as np
import pytest
from hard_scenes import knobbed_torus
from plan_scenes import Y, ball, mesh_of, occluder_of, sphere_on_plane, square

from relight.transfer import MAX_RAYS, sampling
from relight.transfer.analytic import analytic
from relight.transfer.filtering import average, steps_for
from relight.transfer.occluder import Occluder
from relight.transfer.sampling import MAX_DOUBLINGS, MIN_GROWING
from relight.transfer.visibility import Visibility, completed, raytraced_scene
from scenes.plain_rays import offsets_by_rank, raytraced, trace
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene

EVERY = slice(None)


@pytest.fixture(scope="module")
def occluder():
    return occluder_of(sphere_on_plane())


@pytest.fixture(scope="module")
def pair():
    """(occluder, far): two spheres on planes, 60 radii apart; far (V,) bool, of the second."""
    one, other = sphere_on_plane().chunks[0], sphere_on_plane((60.0, 0.0, 0.0)).chunks[0]
    scene = Scene([one, other])
    return occluder_of(scene), np.arange(len(scene.vertices)) >= len(one.vertices)


def error(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.mark.parametrize("rays", [3, 20, 64])
def test_bits_are_what_the_rays_meet(occluder, rays):
    seen = Visibility(occluder, rays, seed=5)
    vertices = seen.neighbors.vertices
    shot = np.zeros((len(vertices), rays, 6), np.float32)
    offsets = sampling.ranked_offsets(np.arange(len(vertices)), 5)
    azimuths = sampling.fibonacci_azimuths(rays)
    sampling.shoot_at(occluder.origins[vertices], occluder.normals[vertices], azimuths, offsets, shot)
    hidden = np.unpackbits(seen.bits[0], axis=1, count=rays).astype(bool)
    np.testing.assert_array_equal(hidden, occluder.occluded(shot))
    assert seen.bits[0].shape == (len(vertices), -(-rays // 8)) and 0.05 < hidden.mean() < 0.5


@pytest.mark.parametrize("bands,rays", [(3, 20), (8, 64), (10, 3)])
def test_bits_give_the_transfer_of_the_rays_to_the_bit(occluder, bands, rays):
    """The same gathering and averaging from rays that were never bits."""
    seen = Visibility(occluder, rays, seed=2)
    vertices = seen.neighbors.vertices
    origins, normals = occluder.origins[vertices], occluder.normals[vertices]
    model, rest = np.zeros((len(vertices), 4), np.float32), np.zeros((len(vertices), bands**2), np.float32)
    by_rank = trace(occluder, origins, normals, bands, rays, lambda part: offsets_by_rank(part, 2))
    for part, (line, left) in by_rank:
        model[part], rest[part] = line, left
    filtered = np.zeros((len(occluder.origins), bands**2), np.float32)
    filtered[vertices] = rest
    average(seen.neighbors, normals, model, filtered, rays, steps_for(rays, bands))
    expected = completed(normals, model, np.ascontiguousarray(filtered[vertices]))
    found = seen.transfer(bands)
    np.testing.assert_array_equal(found[vertices], expected)
    np.testing.assert_array_equal(found, expected[seen.neighbors.node])
    np.testing.assert_array_equal(found, raytraced_scene(occluder, bands, rays, 2))


def test_more_bands_need_no_ray(occluder, monkeypatch):
    seen = Visibility(occluder, 32)
    few = seen.transfer(3)
    monkeypatch.setattr(occluder, "occluded", None)
    many = seen.transfer(10)
    # The first bands differ as much as their averaging does: two rings for ten bands, one for three.
    assert many.shape[1] == 100 and error(many[:, :9], few) < 0.03
    monkeypatch.undo()
    np.testing.assert_array_equal(many, raytraced_scene(occluder, 10, 32))


@pytest.mark.parametrize("rays,doublings", [(20, 0), (16, 1), (16, 2)])
def test_what_was_kept_is_the_same_to_the_bit(occluder, rays, doublings):
    seen = Visibility(occluder, rays, seed=3)
    for _ in range(doublings):
        seen.double()
    again = Visibility.restored(occluder, rays, 3, np.stack(seen.bits), seen.traced)
    assert again.rays == seen.rays == rays << doublings
    for bands in (3, 8):
        np.testing.assert_array_equal(again.transfer(bands), seen.transfer(bands))
    if not doublings:
        seen.double(), again.double()
        np.testing.assert_array_equal(np.stack(again.bits), np.stack(seen.bits))


@pytest.mark.parametrize(
    "change", [lambda b: b[:, 1:], lambda b: b[:, :, 1:], lambda b: np.concatenate([b] * 3), lambda b: b[:0]]
)
def test_what_was_kept_must_fit(occluder, change):
    seen = Visibility(occluder, 16)
    with pytest.raises(InputError, match=r"kept visibility of shape .* does not fit \d+ nodes and 16 rays"):
        Visibility.restored(occluder, 16, 0, change(np.stack(seen.bits)), seen.traced)


@pytest.fixture(scope="module")
def knobs():
    """(occluder, transfer): of a knobbed torus, by 2048 rays of every vertex: a fifth of the errors that follow."""
    everything = Occluder(*knobbed_torus())
    return everything, raytraced(everything, EVERY, 8, 2048, seed=77)


@pytest.mark.parametrize("bands", [3, 8])
@pytest.mark.parametrize("base", [16, 32])
def test_rays_doubled_are_as_good_as_all_at_once(knobs, base, bands):
    """On a mesh without a grid. On grids, where rays at once complement those of the neighbours best, 1.3 times the
    error was measured after one doubling and 1.4 times after two."""
    occluder, expected = knobs[0], knobs[1][:, : bands**2]
    grown = [Visibility(occluder, base, seed) for seed in range(3)]
    for doublings in range(1, MAX_DOUBLINGS + 1):
        before = [np.stack(seen.bits) for seen in grown]
        for seen, bits in zip(grown, before, strict=True):
            seen.double()
            np.testing.assert_array_equal(np.stack(seen.bits)[: len(bits)], bits)
        rays = base << doublings
        assert [seen.rays for seen in grown] == 3 * [rays]
        doubled = np.mean([error(seen.transfer(bands), expected) for seen in grown])
        at_once = np.mean([error(raytraced_scene(occluder, bands, rays, seed), expected) for seed in range(3)])
        # 3 to 15% were measured on two meshes of objects; other seeds differ by 2%.
        assert doubled < 1.2 * at_once
        # And they are new rays, not the old ones again.
        once = np.mean([error(raytraced_scene(occluder, bands, base, seed), expected) for seed in range(3)])
        assert doubled < 0.85 * once


def test_how_far_rays_grow(occluder):
    few, enough = Visibility(occluder, MIN_GROWING - 1), Visibility(occluder, MIN_GROWING)
    assert few.reaches(few.rays) and not few.reaches(few.rays + 1)
    assert enough.reaches(MIN_GROWING << MAX_DOUBLINGS) and not enough.reaches((MIN_GROWING << MAX_DOUBLINGS) + 1)
    for _ in range(MAX_DOUBLINGS):
        enough.double()
    assert enough.reaches(enough.rays) and not enough.reaches(enough.rays + 1)


@pytest.mark.parametrize("bands", [3, 8])
def test_vertices_without_rays_count_as_open(pair, bands):
    occluder, far = pair
    shot = []
    whole, half = Visibility(occluder, 32), Visibility(occluder, 32, vertices=far, advance=shot.append)
    assert sum(shot) == len(far)  # progress counts vertices, with rays or without
    part = half.transfer(bands)
    np.testing.assert_array_equal(part[far], whole.transfer(bands)[far])
    np.testing.assert_array_equal(part[~far], analytic(occluder.normals[~far], bands))
    assert error(whole.transfer(bands)[~far], part[~far]) > 0.1
    assert not np.stack(half.bits)[0][~half.traced].any()
    again = Visibility.restored(occluder, 32, 0, np.stack(half.bits), half.traced)
    np.testing.assert_array_equal(again.transfer(bands), part)
    half.double()
    np.testing.assert_array_equal(half.transfer(bands)[~far], part[~far])


def test_rays_are_shot_for_what_asks_for_them_alone(pair, monkeypatch):
    occluder, far = pair
    counted, shoot = [], occluder.occluded
    monkeypatch.setattr(occluder, "occluded", lambda rays: counted.append(rays.size // 6) or shoot(rays))
    seen = Visibility(occluder, 16, vertices=far)
    assert sum(counted) == 16 * seen.traced.sum()
    assert seen.traced.sum() < 0.6 * len(seen.traced)


def test_a_vertex_on_a_seam_is_traced_if_either_copy_asks():
    """Two halves of a floor under a ball, cut apart: the seam's vertices are there twice."""
    floor = [square([x, 0, 0], [0, 0, 1], [0.5, 0, 0], 8) for x in (0.0, 0.5)]
    above = ball(0.2, (0.5, 0.25, 0.5), 8)
    scene = Scene([mesh_of(floor[0]), mesh_of(floor[1], above)])
    first = np.arange(len(scene.vertices)) < len(floor[0][0])
    occluder = occluder_of(scene)
    seen = Visibility(occluder, 64, vertices=first)
    transfer, vertices = seen.transfer(4), scene.vertices
    seam = np.isclose(vertices @ Y, 0.0) & np.isclose(vertices[:, 0], 0.5)
    left, right = (np.flatnonzero(seam & side) for side in (first, ~first))
    left, right = (each[np.argsort(vertices[each, 2])] for each in (left, right))
    assert len(left) == len(right) == 9
    np.testing.assert_array_equal(transfer[left], transfer[right])
    assert error(transfer[right], analytic(occluder.normals[right], 4)) > 0.1


@pytest.mark.parametrize("rays", [0, -3, 2.5, MAX_RAYS + 1])
def test_rays_must_be_a_whole_number(occluder, rays):
    with pytest.raises(InputError, match="`rays` per vertex must be a whole number from 1 to 65536"):
        Visibility(occluder, rays)
