"""Averaging over neighbours: dense twins, what it may not depend on, and what it may not smooth away."""

import numpy as np
import open3d as o3d
import pytest
from shadow_meshes import knobbed_torus, mesh_arrays

from relight.transfer import filtering, lobes
from relight.transfer.analytic import analytic
from relight.transfer.neighbors import Neighbors
from relight.transfer.occluder import Occluder
from relight.transfer.visibility import raytraced_scene
from scenes.plain_rays import raytraced
from splat2mesh.base.errors import InputError

EVERY = slice(None)
Y0 = np.sqrt(0.25 / np.pi)


@pytest.fixture(scope="module")
def torus():
    """A torus with a knob in its hole, 1,900 vertices: (vertices, normals, faces), every degree of occlusion."""
    return knobbed_torus(48, 32, 0.4, 14)


@pytest.fixture(scope="module")
def converged(torus):
    return raytraced(Occluder(*torus), EVERY, 5, 4096, seed=99)


@pytest.fixture(scope="module")
def tangle():
    """What meshes should not be: random faces, some degenerate or twice, over 40 places with up to 3 normals each,
    vertices twice to the bit, others in no face: (origins, normals, faces)."""
    rng = np.random.default_rng(11)
    places = rng.uniform(-0.3, 0.3, (40, 3)).astype(np.float32)
    places[0, 0] = 0.0
    directions = rng.normal(size=(6, 3)).astype(np.float32)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.repeat(places, 3, axis=0)
    normals = directions[rng.integers(0, 6, len(origins))]
    faces = rng.integers(0, 110, (150, 3))  # the last 10 vertices stay alone
    faces[:5, 1] = faces[:5, 0]
    return origins, normals, np.concatenate([faces, faces[:20]])


def cube_on_a_floor(cells=6):
    """Box of six gridded sides with hard edges, on a floor that leaves it in the middle."""
    parts, total = [], 0
    grid = np.stack(np.meshgrid(*2 * [np.linspace(0, 1, cells + 1)], indexing="ij"), axis=-1).reshape(-1, 2)
    index = np.arange((cells + 1) ** 2).reshape(cells + 1, -1)
    a, b, c, d = (index[s, t].ravel() for s in (slice(-1), slice(1, None)) for t in (slice(-1), slice(1, None)))
    quads = np.concatenate([np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)])
    for axis in range(3):
        u, v, w = np.roll(np.eye(3), axis, axis=0)
        for side in (0, 1):
            parts.append((grid @ np.stack([u, v]) + side * w, (2 * side - 1) * w))
    parts.append(((grid - 0.5) @ np.array([[0, 0, 5.0], [5.0, 0, 0]]) + [0.5, 0, 0.5], np.array([0, 1.0, 0])))
    vertices = np.concatenate([part for part, _ in parts]).astype(np.float32)
    normals = np.concatenate([np.tile(normal, (len(part), 1)) for part, normal in parts]).astype(np.float32)
    faces = []
    for part, _ in parts:
        faces.append(quads + total)
        total += len(part)
    return vertices, normals, np.concatenate(faces)


def error(transfer, reference):
    return np.linalg.norm(transfer - reference) / np.linalg.norm(reference)


# -- who is beside whom


def dense(origins, normals, faces):
    """Weights between vertices, (V, V), from the definitions: 0 where they are no neighbours or the same node."""
    count = len(origins)
    same_place = (origins[:, None] == origins[None]).all(axis=-1)
    same_node = same_place & (normals[:, None] == normals[None]).all(axis=-1)
    edge = np.zeros((count, count), bool)
    for f in faces:
        edge[np.ix_(f, f)] = True
    beside = same_place.astype(int) @ edge @ same_place.astype(int) + same_place > 0
    cosine = normals.astype(np.float64) @ normals.T.astype(np.float64)
    return np.where(beside & ~same_node & (cosine > 0.5), np.exp(8.0 * (np.minimum(cosine, 1.0) - 1.0)), 0.0)


def test_neighbors_are_those_of_the_definition(tangle):
    origins, normals, _ = tangle
    neighbors = Neighbors(*tangle)
    expected = dense(*tangle)
    equal = (np.hstack([origins, normals])[:, None] == np.hstack([origins, normals])[None]).all(axis=-1)
    np.testing.assert_array_equal(neighbors.node[:, None] == neighbors.node[None], equal)
    np.testing.assert_array_equal(neighbors.node[neighbors.vertices], np.arange(len(neighbors.vertices)))
    found = np.zeros(2 * [len(neighbors.vertices)])
    for i in range(len(found)):
        row = slice(*neighbors.starts[i : i + 2])
        assert (np.diff(neighbors.columns[row]) > 0).all()  # sorted, nobody twice
        found[i, neighbors.columns[row]] = neighbors.weights[row]
    assert (found > 0).sum() > 1000 and not found.diagonal().any()
    np.testing.assert_allclose(found, expected[np.ix_(neighbors.vertices, neighbors.vertices)], rtol=1e-5)


def test_nodes_have_an_order_of_their_own(tangle):
    origins, normals, faces = tangle
    order = np.random.default_rng(12).permutation(len(origins))
    shuffled = Neighbors(np.negative(-origins[order]), normals[order], np.argsort(order)[faces][::-1, [1, 2, 0]])
    straight = Neighbors(*tangle)
    np.testing.assert_array_equal(shuffled.node, straight.node[order])
    for name in ("starts", "columns", "weights"):
        np.testing.assert_array_equal(getattr(shuffled, name), getattr(straight, name))


def test_a_fan_of_many_faces_is_one_row():
    count = 500
    turn = np.linspace(0, 2 * np.pi, count, endpoint=False)
    rim = np.stack([0.4 * np.cos(turn), 0.4 * np.sin(turn), 0 * turn], axis=1)
    faces = np.stack([np.zeros(count, int), 1 + np.arange(count), 1 + np.roll(np.arange(count), -1)], axis=1)
    neighbors = Neighbors(
        np.vstack([[0, 0, 0], rim]).astype(np.float32), np.tile(np.float32([0, 0, 1]), (count + 1, 1)), faces
    )
    lengths = np.diff(neighbors.starts)[neighbors.node]
    assert lengths[0] == count and (lengths[1:] == 3).all()


# -- one step against its formula


def averaged_densely(weights, normals, model, rest, rays, steps):
    """Steps in float64, from the definitions of `filtering`, over nodes with (N, N) weights."""
    bands = min(3, int(np.sqrt(rest.shape[1])))
    base = weights + np.eye(len(weights))
    for step in range(steps):
        guide = analytic(normals, bands)
        lobes.add_model(normals, *(a.astype(np.float32) for a in (model, rest[:, : bands**2])), guide)
        guide = guide.astype(np.float64) - analytic(normals, bands)
        if step == 0:
            hidden = np.clip(-(base @ guide[:, 0]) / base.sum(axis=1) / Y0, 0, 1)
            spread = hidden * (1 - hidden) + 0.01
        noise = 0.078 * rays**-1.48 * bands**2 * (spread[:, None] + spread[None])
        square = ((guide[:, None] - guide[None]) ** 2).sum(axis=-1)
        share = base / (1 + (square / noise / 4) ** 2)
        share /= share.sum(axis=1, keepdims=True)
        model, rest, spread = share @ model, share @ rest, share**2 @ spread
    return model, rest


@pytest.mark.parametrize(
    ("coefficients", "rays", "steps"), [(1, 16, 1), (4, 16, 1), (9, 16, 2), (9, 256, 1), (100, 16, 1)]
)
def test_a_step_is_the_documented_average(tangle, coefficients, rays, steps):
    rng = np.random.default_rng(13)
    neighbors = Neighbors(*tangle)
    at = neighbors.vertices
    normals = tangle[1][at]
    model = np.zeros((len(at), 4), np.float32)
    model[:, 0] = rng.uniform(0.3, 0.6, len(at))
    model[:, 1:] = rng.normal(0, 0.1, (len(at), 3))
    rest = np.full((len(tangle[0]), coefficients), np.nan, np.float32)  # rows of no node are ignored
    rest[at] = rng.normal(0, 0.01, (len(at), coefficients))
    expected = averaged_densely(dense(*tangle)[np.ix_(at, at)], normals, model, rest[at], rays, steps)
    filtering.average(neighbors, normals, model, rest, rays, steps)
    np.testing.assert_allclose(model, expected[0], atol=1e-5)  # the guides' rounding rides on weights of order 1
    np.testing.assert_allclose(rest[at], expected[1], atol=1e-5)
    assert np.isnan(np.delete(rest, at, axis=0)).all()


def test_who_has_no_neighbour_keeps_every_bit(tangle):
    neighbors = Neighbors(*tangle[:2], tangle[2][:1] * 0)
    alone = np.diff(neighbors.starts) == 0
    rng = np.random.default_rng(14)
    model = rng.normal(size=(len(alone), 4)).astype(np.float32)
    rest = rng.normal(size=(len(tangle[0]), 9)).astype(np.float32)
    before = model.copy(), rest[neighbors.vertices].copy()
    filtering.average(neighbors, tangle[1][neighbors.vertices], model, rest, 8, 2)
    assert 5 < alone.sum() < len(alone)
    np.testing.assert_array_equal(model[alone], before[0][alone])
    np.testing.assert_array_equal(rest[neighbors.vertices][alone], before[1][alone])


# -- what may not be smoothed away, and what should be


def test_convex_body_is_analytic_to_the_bit():
    vertices, _, faces = mesh_arrays(o3d.geometry.TriangleMesh.create_sphere(2.0, 12))
    occluder = Occluder(vertices, vertices, faces)
    np.testing.assert_array_equal(raytraced_scene(occluder, 4, 64), analytic(occluder.normals, 4))


def test_hard_edges_stay_hard():
    vertices, normals, faces = cube_on_a_floor()
    transfer = raytraced_scene(Occluder(vertices, normals, faces), 3, 8)
    top = (normals[:, 1] == 1) & (vertices[:, 1] == 1)
    sides = (normals[:, 1] == 0) & (vertices[:, 1] == 1)
    np.testing.assert_array_equal(transfer[top], analytic(normals[top], 3))
    assert (transfer[sides, 0] < 0.85 * Y0).mean() > 0.8  # half their sky is floor, but for its ends


def test_box_is_dark_inside_and_bright_outside():
    vertices, normals, faces = cube_on_a_floor()
    walls = slice(None, -49), slice(None, -72)  # without the floor's vertices and faces
    vertices, normals, faces = vertices[walls[0]], normals[walls[0]], faces[walls[1]]
    assert not raytraced_scene(Occluder(vertices, -normals, faces), 3, 8).any()
    outside = raytraced_scene(Occluder(vertices, normals, faces), 3, 8)
    np.testing.assert_array_equal(outside, analytic(normals, 3))


def test_a_step_of_shadow_stays_and_noise_goes():
    rng = np.random.default_rng(15)
    side = np.linspace(-0.35, 0.35, 40, dtype=np.float32)
    x, z = (a.ravel() for a in np.meshgrid(side, side, indexing="ij"))
    index = np.arange(1600).reshape(40, 40)
    corners = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    a, b, c, d = (corner.ravel() for corner in corners)
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    normals = np.tile(np.float32([0, 1, 0]), (1600, 1))
    neighbors = Neighbors(np.stack([x, 0 * x, z], axis=1), normals, faces)
    at = neighbors.vertices
    level = np.where(x < 0.0, 0.9, 0.3)[at]
    deviation = np.sqrt(4 * np.pi * filtering.NOISE * 32**filtering.NOISE_POWER * level * (1 - level))
    model = np.zeros((1600, 4), np.float32)
    model[:, 0] = level + rng.normal(size=1600) * deviation
    before = model[:, 0] - level
    filtering.average(neighbors, normals, model, np.zeros((1600, 1), np.float32), 32, 1)
    after = model[:, 0] - level
    edge = np.abs(x[at]) < 0.02
    assert after.std() < 0.6 * before.std()  # seven of a ring averaged: 0.38, less what noise itself keeps apart
    for part in (level > 0.5, level < 0.5):  # 0.6 apart across the edge: nothing creeps over
        assert abs(after[edge & part].mean()) < 0.02


@pytest.mark.parametrize(("rays", "bands", "most"), [(8, 3, 0.6), (8, 5, 0.55), (32, 3, 0.75), (128, 5, 0.95)])
def test_error_is_a_fraction_of_that_of_the_rays(torus, converged, rays, bands, most):
    occluder = Occluder(*torus)
    alone = error(raytraced(occluder, EVERY, bands, rays), converged[:, : bands**2])
    assert error(raytraced_scene(occluder, bands, rays), converged[:, : bands**2]) < most * alone


@pytest.mark.parametrize("rays", [8, 64])
def test_noise_is_what_the_filter_takes_it_for(torus, converged, rays):
    difference = raytraced(Occluder(*torus), EVERY, 3, rays, seed=1) - converged[:, :9]
    fraction = np.clip(converged[:, 0] / Y0, 0, 1)
    expected = filtering.NOISE * rays**filtering.NOISE_POWER * (fraction * (1 - fraction)).sum()
    # Within 15% on the meshes it was fitted to; this one is another.
    np.testing.assert_allclose((difference**2).sum(axis=0).mean() / expected, 1.0, atol=0.35)


def test_more_steps_for_fewer_rays_and_more_bands():
    assert [filtering.steps_for(rays, 3) for rays in (1, 24, 25, 512, 513)] == [2, 2, 1, 1, 0]
    assert filtering.steps_for(80, 10) == 2


# -- what the result may not depend on


def in_chunks(vertices, normals, faces, count):
    """The same surface in chunks, each with copies of its vertices: arrays, and where the vertices came from."""
    parts, source, total = [], [], 0
    for part in np.array_split(faces, count):
        used, local = np.unique(part, return_inverse=True)
        parts.append(local.reshape(-1, 3) + total)
        source.append(used)
        total += len(used)
    source = np.concatenate(source)
    return (vertices[source], normals[source], np.concatenate(parts)), source


@pytest.mark.parametrize(("bands", "rays"), [(3, 8), (5, 48)])
def test_order_chunks_and_threads_change_no_bit(torus, bands, rays, monkeypatch):
    whole = raytraced_scene(Occluder(*torus), bands, rays, seed=3)
    vertices, normals, faces = torus
    order = np.random.default_rng(16).permutation(len(vertices))
    shuffled = vertices[order], normals[order], np.argsort(order)[faces][::-1, [2, 0, 1]]
    np.testing.assert_array_equal(raytraced_scene(Occluder(*shuffled), bands, rays, seed=3), whole[order])
    for count in (2, 9):
        arrays, source = in_chunks(*torus, count)
        assert len(source) > len(vertices)
        np.testing.assert_array_equal(raytraced_scene(Occluder(*arrays), bands, rays, seed=3), whole[source])
    for threads in (1, 7):
        monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda threads=threads: threads)
        np.testing.assert_array_equal(raytraced_scene(Occluder(*torus), bands, rays, seed=3), whole)


def test_batches_and_scale_change_no_bit(torus, monkeypatch):
    whole = raytraced_scene(Occluder(*torus), 3, 16)
    vertices, normals, faces = torus
    scaled = Occluder(vertices * np.float32(2.0**15), normals, faces)
    np.testing.assert_array_equal(raytraced_scene(scaled, 3, 16), whole)
    monkeypatch.setattr("relight.transfer.visibility.BATCH_RAYS", 2**10)
    np.testing.assert_array_equal(raytraced_scene(Occluder(*torus), 3, 16), whole)


def test_faces_without_area_and_faces_twice_change_no_bit(torus):
    vertices, normals, faces = torus
    extra = np.concatenate([faces, faces[:100], faces[:50, [0, 0, 1]]])
    expected = raytraced_scene(Occluder(*torus), 3, 16)
    np.testing.assert_array_equal(raytraced_scene(Occluder(vertices, normals, extra), 3, 16), expected)


def test_seed_changes_the_noise_only(torus, converged):
    occluder = Occluder(*torus)
    first, again, other = (raytraced_scene(occluder, 5, 16, seed) for seed in (0, 0, 2**64 - 1))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(axis=1).mean() > 0.3  # of the vertices in partial shadow
    assert error((first + other) / 2, converged) < error(first, converged)


def test_progress_counts_every_vertex_of_every_chunk(torus):
    arrays, source = in_chunks(*torus, 5)
    done = []
    raytraced_scene(Occluder(*arrays), 1, 2**12, advance=done.append)
    assert sum(done) == len(source) and len(done) > 1


@pytest.mark.parametrize(("bands", "rays"), [(0, 8), (11, 8), (3, 0), (3, 2**16 + 1)])
def test_options_out_of_range_are_refused(torus, bands, rays):
    with pytest.raises(InputError, match="from 1 to"):
        raytraced_scene(Occluder(*torus), bands, rays)
