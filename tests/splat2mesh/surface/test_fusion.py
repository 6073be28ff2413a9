"""Fusion of exact depth maps: the surface comes back to a fraction of a voxel, closed, outward, the same every time."""

import numpy as np
import pytest

from splat2mesh.render.view import View
from splat2mesh.surface.fusion import ENOUGH_WEIGHT, SHARP, PlaneMap, fuse

VOXEL = 0.02

# A voxel at height h over the unit sphere, seen at angle a from the normal, is measured against the tangent plane
# h tan(a) away, which lies (h tan(a))^2 / 2 too low: with h of a voxel and a of 75 degrees 0.14 of a voxel.
SHARE = 0.2


def sphere_views(count=14, distance=4.0, pixels=160, center=(0, 0, 0)):
    k = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * k / count, k * np.pi * (3 - np.sqrt(5))
    eyes = np.stack([np.sqrt(1 - z * z) * np.cos(azimuth), np.sqrt(1 - z * z) * np.sin(azimuth), z], axis=1)
    return [View.look_at(center + distance * eye, center, [0.1, 1, 0.2], 35.0, pixels) for eye in eyes]


def sphere_hit(view, center, radius):
    """Camera z (NaN beside it) and unit world normals where each pixel's ray enters a sphere, in float64."""
    rays, to_eye = view.ray_directions(), view.center - np.asarray(center, float)
    a, b, c = (rays**2).sum(-1), rays @ to_eye, to_eye @ to_eye - radius**2
    with np.errstate(invalid="ignore"):
        depth = (-b - np.sqrt(b * b - a * c)) / a
    normal = (to_eye + rays * depth[..., None]) / radius
    return depth, normal


def plane_hit(view, normal, height):
    """The same for the plane normal . x = height, seen from its normal's side."""
    rays = view.ray_directions()
    depth = (height - view.center @ normal) / (rays @ normal)
    return np.where(depth > 0, depth, np.nan), np.broadcast_to(normal, rays.shape)


def nearest_of(*hits):
    depth, normal = hits[0]
    for other, other_normal in hits[1:]:
        closer = np.isnan(depth) | (other < depth)
        depth, normal = np.where(closer, other, depth), np.where(closer[..., None], other_normal, normal)
    return depth, normal


def depth_map(view, hit, radius=1.0):
    depth, normal = hit
    return PlaneMap.from_depth(view, depth, normal, np.zeros_like(depth), radius)


def sphere_maps(center=(0, 0, 0)):
    center = np.asarray(center, float)
    return [depth_map(view, sphere_hit(view, center, 1.0)) for view in sphere_views(center=center)]


def arrays_of(mesh):
    return np.asarray(mesh.vertices), np.asarray(mesh.triangles)


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6


def test_a_sphere_comes_back_to_a_fraction_of_a_voxel_closed_and_outward():
    mesh = fuse(sphere_maps(), VOXEL)
    vertices, faces = arrays_of(mesh)
    error = np.linalg.norm(vertices, axis=1) - 1
    assert np.abs(error).max() < SHARE * VOXEL
    # Closed: every edge has exactly two faces, and it is one sphere (Euler characteristic 2).
    assert mesh.is_edge_manifold(allow_boundary_edges=False)
    assert mesh.euler_poincare_characteristic() == 2
    assert volume(vertices, faces) == pytest.approx(4 / 3 * np.pi, rel=3 * SHARE * VOXEL)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    outward = (normals * (a + b + c)).sum(axis=1)
    sliver = np.linalg.norm(normals, axis=1) < 1e-4 * VOXEL**2  # marching cubes leaves some: no direction to judge
    assert (outward[~sliver] > 0).all() and sliver.mean() < 0.01


def test_half_the_voxel_gives_less_than_a_quarter_of_the_error():
    error = []
    for voxel in (2 * VOXEL, VOXEL):
        vertices, _ = arrays_of(fuse(sphere_maps(), voxel))
        error.append(np.sqrt(np.mean((np.linalg.norm(vertices, axis=1) - 1) ** 2)))
    assert error[1] < error[0] / 4  # second order


@pytest.mark.parametrize("normal", [[0, 1, 0], [0.3, 0.9, -0.2], [1, 1, 1]])
def test_a_plane_comes_back_flat_and_faces_its_viewers(normal):
    normal = np.asarray(normal) / np.linalg.norm(normal)
    side = np.cross(normal, [0.2, 0.1, 1.0])
    eyes = [3 * normal, 2.5 * normal + side, 2.5 * normal - side]
    views = [View.look_at(eye, 0.2 * normal, [0.3, 0.2, 1], 30.0, 96) for eye in eyes]
    vertices, faces = arrays_of(fuse([depth_map(view, plane_hit(view, normal, 0.2)) for view in views], VOXEL))
    assert len(faces) > 500
    # The distance to a plane is linear, so nothing is lost to interpolation: float32 depth about 3 is left.
    np.testing.assert_allclose(vertices @ normal, 0.2, atol=1e-5)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    assert (normals @ normal >= -1e-9).all() and (normals.sum(axis=0) @ normal) > 0


def test_a_sphere_before_a_wall_leaves_nothing_between_them():
    up = np.array([0.0, 1.0, 0.0])
    views = [view for view in sphere_views(count=24) if view.center[1] > 0.3]
    maps = []
    for view in views:
        wall, normal = plane_hit(view, up, -2.0)
        points = view.center + view.ray_directions() * wall[..., None]
        wall[np.abs(points[..., [0, 2]]).max(axis=-1) > 3] = np.nan
        maps.append(depth_map(view, nearest_of(sphere_hit(view, (0, 0, 0), 1.0), (wall, normal))))
    vertices, _ = arrays_of(fuse(maps, VOXEL))
    on_sphere = np.abs(np.linalg.norm(vertices, axis=1) - 1)
    on_wall = np.abs(vertices[:, 1] + 2)
    assert (on_sphere < VOXEL).sum() > 1000 and (on_wall < VOXEL).sum() > 1000
    assert np.minimum(on_sphere, on_wall).max() < VOXEL


def test_the_bytes_do_not_depend_on_the_number_of_threads(monkeypatch):
    maps, meshes = sphere_maps(), []
    for threads in (1, 2, 1):
        monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda threads=threads: threads)
        meshes.append(arrays_of(fuse(maps, VOXEL)))
    for vertices, faces in meshes[1:]:
        assert vertices.tobytes() == meshes[0][0].tobytes()
        assert faces.tobytes() == meshes[0][1].tobytes()


def test_far_from_the_origin_nothing_is_lost():
    shift = np.array([1000.0, -1000.0, 1000.0])
    near, far = (arrays_of(fuse(sphere_maps(center), VOXEL)) for center in ((0, 0, 0), shift))
    assert len(far[0]) == len(near[0])
    error = np.linalg.norm(far[0] - shift, axis=1) - 1
    assert np.abs(error).max() < SHARE * VOXEL
    np.testing.assert_array_equal(far[1], near[1])
    # The same voxels, since the shift is whole: float64 positions of 1000 and float32 depth about 4.
    np.testing.assert_allclose(far[0] - shift, near[0], atol=1e-4 * VOXEL)


def test_the_unit_of_length_does_not_matter():
    small, large = 1e-3, 1e3
    for unit in (small, large):
        views = [
            View.look_at(unit * view.center, [0, 0, 0], [0.1, 1, 0.2], 35.0, view.width) for view in sphere_views()
        ]
        maps = [depth_map(view, sphere_hit(view, (0, 0, 0), unit), unit) for view in views]
        vertices, _ = arrays_of(fuse(maps, VOXEL * unit))
        assert np.abs(np.linalg.norm(vertices, axis=1) / unit - 1).max() < SHARE * VOXEL


def test_trust_falls_with_slant_and_with_spread():
    view = View.look_at([0, 0, 4], [0, 0, 0], [0, 1, 0], 35.0, 65)
    depth, normal = sphere_hit(view, (0, 0, 0), 1.0)
    sharp = PlaneMap.from_depth(view, depth, normal, np.zeros_like(depth), 1.0)
    fuzzy = PlaneMap.from_depth(view, depth, normal, np.full_like(depth, SHARP), 1.0)
    hit = np.isfinite(depth)
    assert sharp.weight[32, 32] == pytest.approx(1.0, abs=1e-6)
    assert (sharp.weight[~hit] == 0).all() and (sharp.weight[hit] > 0).all()
    np.testing.assert_allclose(fuzzy.weight[hit], sharp.weight[hit] / 2, rtol=1e-5)
    rays = view.ray_directions()
    cosine = -(rays * normal).sum(axis=-1) / np.linalg.norm(rays, axis=-1)
    np.testing.assert_allclose(sharp.weight[hit], cosine[hit], atol=1e-6)
    np.testing.assert_allclose(sharp.plane[hit], np.concatenate([normal, depth[..., None]], -1)[hit], atol=1e-6)


def test_every_view_is_announced_once():
    seen = []
    fuse(sphere_maps(), 0.2, lambda: seen.append(1))
    assert len(seen) == 14


def test_views_that_see_nothing_make_an_empty_mesh():
    view = sphere_views()[0]
    empty = np.full((160, 160), np.nan)
    maps = [depth_map(view, (empty, np.zeros((160, 160, 3))))]
    assert len(fuse(maps, VOXEL).triangles) == 0


def test_a_surface_that_nobody_can_trust_makes_an_empty_mesh():
    view = sphere_views()[0]
    depth, normal = sphere_hit(view, (0, 0, 0), 1.0)
    spread = np.full_like(depth, SHARP * np.sqrt(2 / ENOUGH_WEIGHT))  # leaves less than half of what is enough
    fuzzy = PlaneMap.from_depth(view, depth, normal, spread, 1.0)
    assert len(fuse([fuzzy], VOXEL).triangles) == 0
