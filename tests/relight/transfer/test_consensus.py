"""Rays that neighbours predict: right wherever they agree, and few are traced where shadows are smooth."""

import numpy as np
import pytest
from plan_scenes import ball, mesh_of, occluder_of, sphere, sphere_on_plane

from relight.transfer import consensus
from relight.transfer.occluder import Occluder
from relight.transfer.visibility import Visibility
from scenes.plain_rays import raytraced
from splat2mesh.base import threads
from splat2mesh.scene.scene import Scene

RAYS = 64


@pytest.fixture(scope="module", autouse=True)
def small_scenes():
    """Small scenes are traced in full; not here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(consensus, "LEAST_VERTICES", 0)
        yield


@pytest.fixture(scope="module")
def occluder():
    return occluder_of(sphere_on_plane())


@pytest.fixture(scope="module")
def seen(occluder):
    """(every ray traced, some predicted)."""
    return Visibility(occluder, RAYS), Visibility(occluder, RAYS, sparing=True)


@pytest.fixture
def traced(monkeypatch):
    """A list of how many rays each call of `Occluder.occluded` traced."""
    counts, occluded = [], Occluder.occluded
    counted = lambda self, rays, *more: counts.append(rays[..., 0].size) or occluded(self, rays, *more)  # noqa: E731
    monkeypatch.setattr(Occluder, "occluded", counted)
    return counts


def test_cells_around_a_cell_are_those_that_it_touches():
    """Oracle: all corners of cells on the octahedron itself, where neighbours share one."""
    side = 8
    corner = np.linspace(-1.0, 1.0, side + 1)
    u, v = np.meshgrid(corner, corner, indexing="ij")
    y = 1.0 - abs(u) - abs(v)
    x = np.where(y < 0, (1 - abs(v)) * np.copysign(1.0, u), u)
    z = np.where(y < 0, (1 - abs(u)) * np.copysign(1.0, v), v)
    points = np.round(np.stack([x, y, z], axis=-1), 9) + 0.0
    corners = [{tuple(points[i + a, j + b]) for a in (0, 1) for b in (0, 1)} for i in range(side) for j in range(side)]
    for cell, near in enumerate(consensus._around(side)):
        # Four cells meet at every corner; at a pole of the fold several corners are one point, so some touch more.
        assert all(corners[cell] & corners[other] for other in near) and cell in near
    inner = consensus._around(side)[3 * side + 3]
    assert sorted(inner) == sorted(cell for cell in range(side * side) if corners[cell] & corners[3 * side + 3])


def test_a_cell_holds_its_directions():
    side, rng = 16, np.random.default_rng(0)
    toward = rng.normal(size=(500, 3)).astype(np.float32)
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    cells = np.zeros((500, 1), np.int64)
    consensus._cells(0, 500, np.hstack([np.zeros_like(toward), toward])[:, None], side, cells)
    assert len(np.unique(cells)) > 200 and cells.min() >= 0 and cells.max() < side * side
    for cell in np.unique(cells):  # directions of a cell lie together, those of its neighbours beside them
        own = toward[cells[:, 0] == cell]
        assert (own @ own.T).min() > np.cos(2.5 * np.pi / side)


def test_most_rays_are_predicted_and_nearly_all_rightly(occluder, seen, traced):
    again = Visibility(occluder, RAYS, sparing=True)
    assert 1.4 * sum(traced) < RAYS * len(again.traced)  # on so coarse a mesh
    np.testing.assert_array_equal(again.bits, seen[1].bits)
    bits = [np.unpackbits(each.bits[0], axis=1) for each in seen]
    assert 0.05 < bits[0].mean() < 0.5
    assert 0 < (bits[0] != bits[1]).mean() < 2e-3


def test_the_error_hardly_grows(occluder, seen):
    expected = raytraced(occluder, slice(None), 5, 2048, seed=9)
    off = [np.linalg.norm(each.transfer(5) - expected) for each in seen]
    assert off[1] < 1.1 * off[0]


def test_what_nothing_hides_is_exact():
    """Of two spheres one above the other, what faces away sees all: its neighbours that do not change no bit of it."""
    both = occluder_of(Scene([mesh_of(ball(), ball(center=(0.0, 2.1, 0.0)))]))
    expected = raytraced(both, slice(None), 1, 2048, seed=9)[:, 0] * np.sqrt(4.0 * np.pi)
    some = Visibility(both, RAYS, sparing=True)
    free = (expected > 1.0 - 1e-6)[some.neighbors.vertices]
    assert 0.2 < free.mean() < 0.8
    assert not some.bits[0][free].any() and some.bits[0][~free].any()


def test_a_lone_sphere_is_exact(traced):
    lone = sphere()
    some = Visibility(Occluder(lone.vertices, lone.normals, lone.faces), RAYS, sparing=True)
    assert not np.stack(some.bits).any()
    assert sum(traced) < 0.4 * RAYS * len(some.traced)  # pilots are a quarter


def test_blocks_do_not_depend_on_threads_or_calls(occluder, seen, monkeypatch):
    shot = seen[1]._shot((0.0, 0.0), np.arange(5 * consensus.BLOCK + 7))
    whole, cut = consensus.hidden_rays(occluder, shot), 2 * consensus.BLOCK
    parts = [consensus.hidden_rays(occluder, shot[part]) for part in (slice(cut), slice(cut, None))]
    np.testing.assert_array_equal(whole[0], np.concatenate([hidden for hidden, _ in parts]))
    assert whole[1] == sum(traced for _, traced in parts)
    monkeypatch.setattr(threads, "cores", lambda: 1)
    np.testing.assert_array_equal(whole[0], consensus.hidden_rays(occluder, shot)[0])


@pytest.mark.parametrize(("rays", "vertices"), [(16, 0), (RAYS, 10_000)])
def test_few_rays_and_few_vertices_are_all_traced(occluder, rays, vertices, monkeypatch):
    monkeypatch.setattr(consensus, "LEAST_VERTICES", vertices)
    some = Visibility(occluder, rays, sparing=True)
    np.testing.assert_array_equal(some.bits[0], Visibility(occluder, rays).bits[0])


def test_untraced_vertices_are_in_no_block(occluder):
    far = occluder.origins[:, 0] > 0.0
    some = Visibility(occluder, RAYS, vertices=far, sparing=True)
    assert 0 < some.traced.sum() < len(some.traced) and not some.bits[0][~some.traced].any()
    every = Visibility(occluder, RAYS, vertices=far)
    bits = [np.unpackbits(each.bits[0], axis=1) for each in (every, some)]
    assert (bits[0] != bits[1]).mean() < 2e-3
