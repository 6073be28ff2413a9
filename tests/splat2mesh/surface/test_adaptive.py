"""Fusion with cells as large as pixels: a plane comes out flat, wherever it lies and however large its cells are."""

import numpy as np
import pytest

from splat2mesh.render.footprints import TILE
from splat2mesh.render.opacityfield import FieldDepth
from splat2mesh.render.view import View
from splat2mesh.surface.adaptive import fuse_adaptively, packed
from splat2mesh.surface.sight import FusionSight, Sighting

SIZE = 48
PIXELS = SIZE * SIZE


def plane_seen(view, normal, point):
    """What a view sees of the plane through a point: a FieldDepth, and its thickness."""
    rays = view.ray_directions()
    depth = ((np.asarray(point) - view.center) @ normal / (rays @ normal)).astype(np.float32)
    shape = depth.shape
    front = np.broadcast_to(normal, (*shape, 3)).astype(np.float32)
    blank = np.zeros(shape, np.float32)
    seen = FieldDepth(depth, front, blank + np.float32(1e-4), np.zeros((*shape, 3), np.float32), blank + 1)
    return seen, blank + np.float32(1e-4)


def sight(view, normal=(0.0, 0.0, 1.0), point=(0.0, 0.0, 0.0), finest=1e-3):
    normal = np.asarray(normal) / np.linalg.norm(normal)
    seen, thickness = plane_seen(view, normal, point)
    return FusionSight.of(Sighting(view, seen, thickness), 3.0, finest, 0.01)


def looking(eye=(0.0, 0.0, 3.0), target=(0.0, 0.0, 0.0)):
    return View.look_at(eye, target, (0, 1, 0), 50, SIZE)


@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.3, -0.2, 1.0)])
def test_a_plane_is_flat_and_faces_who_saw_it(normal):
    view = looking()
    points, faces, cells = fuse_adaptively([sight(view, normal)], np.zeros(3))
    unit = np.asarray(normal) / np.linalg.norm(normal)
    # Distances to a plane are linear, so that crossings of edges lie on it but for float32 in the field.
    assert np.abs(points @ unit).max() < 1e-4
    a, b, c = (points[faces[:, k]] for k in range(3))
    area = np.cross(b - a, c - a) @ unit
    assert area[area < 0].sum() > -1e-4 * area.sum()  # slivers alone turn over, by the rounding of their corners
    assert len(cells) == len(points) > PIXELS / 4


def test_the_origin_of_the_numbers_moves_nothing():
    view = looking()
    here, faces, _ = fuse_adaptively([sight(view)], np.zeros(3))
    there, _, _ = fuse_adaptively([sight(view)], np.array([0.25, -0.5, 0.0]))
    assert abs(len(here) - len(there)) < 0.1 * len(here) and len(faces)
    assert np.abs(there[:, 2]).max() < 1e-4


def test_cells_are_powers_of_two_of_the_finest_and_grow_with_the_distance():
    near, far = looking((0.0, 0.0, 1.0)), looking((20.0, 0.0, 8.0), (20.0, 0.0, 0.0))
    points, _, cells = fuse_adaptively([sight(near), sight(far)], np.zeros(3))
    levels = np.log2(cells / cells.min())
    np.testing.assert_allclose(levels, np.round(levels), atol=1e-9)
    of_near, of_far = np.abs(points[:, 0]) < 0.3, np.abs(points[:, 0] - 20.0) < 2.0
    assert levels[of_far].min() - levels[of_near].max() >= 2  # eight times as far: three levels, or two by rounding


def test_a_view_is_trusted_by_the_cosine_at_which_it_sees():
    seen = sight(looking())
    rays = looking().ray_directions()
    cosine = 1.0 / np.linalg.norm(rays, axis=-1)
    behind = np.where(np.isfinite(seen.plane[..., 3]), seen.plane[..., 3], np.inf)
    expected = cosine / (1 + (1e-4 / (0.03 * behind)) ** 2) / (1 + (behind / 6.0) ** 2)
    np.testing.assert_allclose(seen.weight, expected, rtol=1e-5)


def test_what_is_packed_is_what_the_sights_hold():
    sights = [sight(looking()), sight(View.look_at((1, 0, 2), (0, 0, 0), (0, 1, 0), 40, 31, 17))]
    origin = np.array([0.5, 1.0, -2.0])
    maps = packed(sights, origin)
    assert maps.starts.tolist() == [0, PIXELS] and len(maps.pixels) == PIXELS + 31 * 17
    assert maps.square_starts.tolist() == [0, (SIZE // TILE) ** 2]
    for number, each in enumerate(sights):
        place = np.array([0.1, 0.2, 0.3])
        direct = each.view.camera_from_world[:3] @ [*place, 1.0]
        shifted = maps.poses[number] @ [*(place - origin), 1.0]
        np.testing.assert_allclose(shifted, direct, atol=1e-12)
        rows = slice(maps.starts[number], maps.starts[number] + each.weight.size)
        np.testing.assert_array_equal(maps.pixels[rows, 4].reshape(each.weight.shape), each.weight)
    assert maps.deepest.max() == np.float32(max((e.plane[..., 3] + 3 * e.spread).max() for e in sights))
