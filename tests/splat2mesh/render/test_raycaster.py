import numpy as np

from splat2mesh.render.raycaster import RayCaster

CORNERS = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def caster():
    return RayCaster(CORNERS, [[0, 1, 2]])


def test_a_ray_meets_the_triangle_where_geometry_says():
    rays = np.array([[[0.25, 0.5, -3.0, 0, 0, 2.0], [0.25, 0.5, 3.0, 0, 0, 1.0]], [[0.9, 0.9, -3, 0, 0, 1]] * 2])
    hits = caster().first_hits(rays)
    np.testing.assert_array_equal(hits.faces, [[0, -1], [-1, -1]])
    assert abs(hits.distance[0, 0] - 1.5) < 1e-6 and np.isinf(hits.distance.ravel()[1:]).all()
    np.testing.assert_allclose(hits.uv[0, 0], [0.25, 0.5], atol=1e-7)
    np.testing.assert_allclose(np.abs(hits.normals[0, 0]), [0, 0, 1])


def test_both_sides_hide_up_to_a_distance():
    rays = np.array([[0.25, 0.5, z, 0, 0, -z] for z in (-2.0, 2.0)])
    assert caster().occluded(rays).all() and not caster().occluded(rays, far=0.99).any()
    assert caster().occluded(rays, far=1.01).all() and not caster().occluded(-rays).any()


def test_the_closest_points_lie_inside_on_edges_and_on_corners():
    found = caster().closest([[0.25, 0.5, 7.0], [0.5, -1.0, 0.0], [-1.0, -1.0, 1.0]])
    np.testing.assert_allclose(found.points, [[0.25, 0.5, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, 0.0]], atol=1e-7)
    np.testing.assert_allclose(found.uv @ CORNERS[1:], found.points, atol=1e-7)
    np.testing.assert_array_equal(found.faces, 0)
