"""Rays to suns that neighbours spare each other: nearly the same light, the same in any order, and no bit less where
nothing is spared."""

import numpy as np
import pytest
from plan_scenes import ball, difference, mesh_of

from relight.light.suns import Suns
from relight.transfer import sun_consensus
from relight.transfer.occluder import Occluder
from relight.transfer.sunlight import sunlight

EVERY = slice(None)


@pytest.fixture(scope="module")
def scene():
    """Two spheres of 9,900 vertices, one in the shade of the other."""
    found = mesh_of(ball(resolution=70), ball(0.5, (0.9, 1.1, 0.5), 70))
    return found.vertices, found.normals, found.faces


@pytest.fixture(scope="module")
def suns():
    """40 suns within 25 degrees."""
    rng = np.random.default_rng(3)
    toward = np.array([0.5, 0.6, 0.3]) + 0.2 * rng.normal(size=(40, 3))
    return Suns(toward / np.linalg.norm(toward, axis=1, keepdims=True), rng.random((40, 3)))


def test_spared_rays_hardly_change_the_light(scene, suns, monkeypatch):
    occluder, shot = Occluder(*scene), [0]
    occluded = occluder.occluded

    def counted(rays):
        shot[0] += len(rays)
        return occluded(rays)

    monkeypatch.setattr(occluder, "occluded", counted)
    assert sun_consensus.worth(len(suns), len(scene[0]))
    exact, every = sunlight(occluder, EVERY, suns), shot[0]
    spared = sunlight(occluder, EVERY, suns, sparing=True)
    assert shot[0] - every < 0.7 * every
    assert difference(spared, exact) < 0.003
    assert (spared == exact).all(axis=1).mean() > 0.99


def test_neither_the_order_of_vertices_nor_seams_change_a_bit(scene, suns):
    vertices, normals, faces = scene
    one = sunlight(Occluder(*scene), EVERY, suns, sparing=True)
    order = np.random.default_rng(0).permutation(len(vertices))
    back = np.argsort(order)
    other = sunlight(Occluder(vertices[order], normals[order], back[faces].astype(np.int32)), EVERY, suns, sparing=True)
    np.testing.assert_array_equal(other, one[order])
    twice = np.concatenate([vertices, vertices[:5000]]), np.concatenate([normals, normals[:5000]])
    seamed = sunlight(Occluder(*twice, faces), EVERY, suns, sparing=True)
    np.testing.assert_array_equal(seamed, np.concatenate([one, one[:5000]]))


def test_few_suns_and_few_vertices_are_traced_to_the_bit(scene, suns):
    occluder, few = Occluder(*scene), Suns(suns.directions[:8], suns.weights[:8])
    np.testing.assert_array_equal(sunlight(occluder, EVERY, few, sparing=True), sunlight(occluder, EVERY, few))
    rows = np.arange(0, len(scene[0]), 7)
    np.testing.assert_array_equal(sunlight(occluder, rows, suns, sparing=True), sunlight(occluder, rows, suns))
