"""The sample of a plan, kept: the same arrays without a ray, and made anew where what was kept is broken."""

import numpy as np
import plan_scenes
import pytest

from relight.planning.sample import Sample
from relight.transfer.store import Cache

ARRAYS = "rows", "weights", "normals", "directions", "open", "seen", "hidden"


@pytest.fixture
def made(tmp_path):
    """A function that makes the Sample of a corner, and the folder that keeps it."""
    scene, _ = plan_scenes.corner(16)
    occluder = plan_scenes.occluder_of(scene)
    return lambda: Sample(occluder, 200, 64, cache=Cache(tmp_path, "corner")), tmp_path


def same(one, other):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_a_kept_sample_is_the_same_and_traces_nothing(made, monkeypatch):
    sample, _ = made
    first = sample()
    assert (first.seen != first.open).any()  # of what the corner hides
    monkeypatch.setattr(Sample, "_look", lambda *_: pytest.fail("it looks again"))
    again = sample()
    same(first, again)
    assert (again.ray_s, again.unsure, again.rays) == (first.ray_s, first.unsure, first.rays)


@pytest.mark.parametrize(("name", "value"), [("rows", 10**6), ("weights", np.nan), ("ray_s", np.nan)])
def test_a_broken_one_is_made_anew(made, name, value):
    sample, folder = made
    first = sample()
    (path,) = folder.glob("sample-*.npz")
    with np.load(path) as kept:
        arrays = dict(kept)
    arrays[name] = np.full_like(arrays[name], value)
    np.savez(path, **arrays)
    again = sample()
    same(first, again)
    assert np.isfinite(again.ray_s)
