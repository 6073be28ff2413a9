"""Albums: which pictures are asked for a point is a matter of time alone; albums of parts make one."""

from types import SimpleNamespace

import numpy as np
import pytest

from splat2mesh.surface import album
from splat2mesh.surface.album import Album
from splat2mesh.surface.sight import Sighting
from splat2mesh.views.eyes import around

PIXELS = 24


@pytest.fixture(scope="module")
def pictures():
    """Views from over a rough floor, what each sees of it, and its thickness there."""
    rng = np.random.default_rng(0)
    eyes = [SimpleNamespace(center=np.array([x, 1.5, z]), near=0.1) for x in (0.0, 3.0, 6.0) for z in (0.0, 3.0)]
    views, _ = around(eyes, PIXELS, np.array([0.0, 1.0, 0.0]))
    shape, found = (PIXELS, PIXELS), []
    for view in views:
        with np.errstate(all="ignore"):
            depth = -view.center[1] / view.ray_directions()[..., 1]
        depth = np.where((depth > 0) & (depth < 4), depth * rng.uniform(0.99, 1.01, shape), np.nan).astype(np.float32)
        color = rng.uniform(0, 1, (*shape, 3)).astype(np.float32)
        seen = SimpleNamespace(depth=depth, color=color, spread=np.full(shape, 0.02, np.float32))
        found.append((view, seen, rng.uniform(0.01, 0.03, shape)))
    return found


def of(pictures):
    return Album.of([Sighting(*picture) for picture in pictures])


def test_groups_of_points_leave_out_no_picture_that_shows_one(pictures, monkeypatch):
    rng = np.random.default_rng(1)
    points = rng.uniform([-4, -0.05, -4], [10, 0.05, 7], (3000, 3))
    points[-1] = [1e7, -1e7, 1e7]  # so far off that all others are one group
    normals = np.tile([0.0, 1.0, 0.0], (len(points), 1))
    whole = of(pictures)
    everything = whole.look_up(points, normals)
    monkeypatch.setattr(album, "PER_GROUP", 1e-6)
    alone = whole.look_up(points[:-1], normals[:-1])
    assert len(album.groups_of(points[:-1])[1]) > 2900
    for one, all_ in zip(alone, everything, strict=True):
        np.testing.assert_array_equal(one, all_[:-1])
    assert 0.3 < np.isfinite(alone[0][:, 0]).mean() < 0.9


def test_albums_of_parts_make_one(pictures):
    whole, made = of(pictures), Album.joined([of(pictures[:1]), of(pictures[1:5]), of(pictures[5:])])
    for one, all_ in zip(made, whole, strict=True):
        np.testing.assert_array_equal(one, all_)


def test_no_points_have_no_colours(pictures):
    assert [len(part) for part in of(pictures).look_up(np.zeros((0, 3)), np.zeros((0, 3)))] == [0, 0, 0]
