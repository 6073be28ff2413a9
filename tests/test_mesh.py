"""Cleaning and decimation: the size asked for, the shape kept, no broken triangle left."""

import numpy as np
import open3d as o3d
import pytest

from splat2mesh.mesh import SMALLEST_COMPONENT, decimate, drop_small_components


def sphere(radius=1.0, center=(0, 0, 0), resolution=60):
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    return mesh.translate(center)


def edge_uses(faces):
    """How many faces use each undirected edge."""
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    return np.unique(edges, axis=0, return_counts=True)[1]


def face_normals(vertices, faces):
    a, b, c = (vertices[faces[:, k]].astype(float) for k in range(3))
    return np.cross(b - a, c - a)


@pytest.mark.parametrize("wanted", [200, 1000, 5000])
def test_decimation_reaches_its_target_and_keeps_the_sphere(wanted):
    vertices, normals, faces = decimate(sphere(), wanted)
    assert vertices.dtype == normals.dtype == np.float32 and faces.dtype == np.int32
    assert 0.9 * wanted <= len(vertices) <= 1.05 * wanted
    # A triangle inscribed in the unit sphere, on n vertices, sags by about 2.4 / n; quadrics put half of it outside.
    radius = np.linalg.norm(vertices, axis=1)
    assert np.abs(radius - 1).max() < 10 / wanted + 0.003  # smoothing moves the large triangles by as much again
    volume = np.einsum("ij,ij->i", vertices[faces[:, 0]], face_normals(vertices, faces)).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi, rel=20 / wanted + 0.005)


def test_the_result_is_closed_clean_and_its_normals_point_outward():
    vertices, normals, faces = decimate(sphere(), 1000)
    np.testing.assert_array_equal(edge_uses(faces), 2)
    assert len(vertices) - 3 * len(faces) // 2 + len(faces) == 2
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))
    assert (np.diff(np.sort(faces, axis=1), axis=1) > 0).all()  # three different corners
    assert len(np.unique(np.sort(faces, axis=1), axis=0)) == len(faces)
    assert (np.linalg.norm(face_normals(vertices, faces), axis=1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    outward = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    # Triangles are about 0.12 wide on a sphere of radius one: normals stray by a fraction of that angle.
    assert (normals * outward).sum(axis=1).min() > np.cos(0.14)  # smoothing turns a few corners a little further


def test_a_mesh_small_enough_keeps_its_vertices():
    mesh = sphere(resolution=20)
    vertices, _, faces = decimate(mesh, len(mesh.vertices))
    assert len(vertices) == len(mesh.vertices) and len(faces) == len(mesh.triangles)
    # Twenty steps of Taubin smoothing on triangles 0.16 wide neither shrink nor swell it.
    assert np.abs(np.linalg.norm(vertices, axis=1) - 1).max() < 0.01


@pytest.mark.parametrize(("scale", "center"), [(1e-3, (0, 0, 0)), (1e3, (0, 0, 0)), (1.0, (1e3, -1e3, 1e3))])
def test_decimation_does_not_depend_on_unit_or_place(scale, center):
    vertices, normals, faces = decimate(sphere(scale, center), 1000)
    local = (vertices.astype(float) - center) / scale
    # float32 results about 1000 from the origin are rounded to 6e-5.
    np.testing.assert_allclose(np.linalg.norm(local, axis=1), 1.0, atol=0.013)  # 10 / wanted + 0.003, as above
    assert (np.einsum("ij,ij->i", normals, local) > 0.9).all()
    assert 900 <= len(vertices) <= 1050 and (edge_uses(faces) == 2).all()


def test_noise_is_smoothed_without_shrinking():
    mesh = sphere(resolution=80)
    noisy = np.asarray(mesh.vertices) * (1 + np.random.default_rng(0).normal(0, 0.005, (len(mesh.vertices), 1)))
    mesh.vertices = o3d.utility.Vector3dVector(noisy)
    vertices, _, _ = decimate(mesh, 4000)
    radius = np.linalg.norm(vertices, axis=1)
    assert np.std(radius) < 0.6 * 0.005
    assert np.mean(radius) == pytest.approx(1.0, abs=0.0025)  # half the noise: decimation comes first


def test_slivers_do_not_keep_decimation_from_its_target():
    """Pairs of vertices a millionth apart, as marching cubes leaves them, once were pulled into degenerate faces."""
    mesh = sphere(resolution=60)
    points, faces = np.asarray(mesh.vertices).copy(), np.asarray(mesh.triangles)
    rng = np.random.default_rng(0)
    for a, b, _ in faces[rng.choice(len(faces), 2000, replace=False)]:
        points[a] = points[b] + 1e-6 * (points[a] - points[b])
    mesh.vertices = o3d.utility.Vector3dVector(points)
    vertices, _, faces = decimate(mesh, 1000)
    assert 900 <= len(vertices) <= 1050
    quality = np.linalg.norm(face_normals(vertices, faces), axis=1)
    assert (quality > 1e-3 * np.median(quality)).all()


def test_edges_with_three_faces_and_degenerate_faces_are_removed():
    fin = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0]]),
        o3d.utility.Vector3iVector([[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 2, 3], [0, 1, 2]]),
    )
    vertices, _, faces = decimate(fin, 100)
    assert len(faces) == 2
    assert edge_uses(faces).max() <= 2
    np.testing.assert_array_equal(np.unique(faces), np.arange(len(vertices)))


def test_small_components_are_dropped_and_counted():
    large = sphere()
    mesh = sphere()
    limit = SMALLEST_COMPONENT * len(large.triangles)
    small = [sphere(0.1, (3 + k, 0, 0), resolution=5) for k in range(4)]
    enough = sphere(0.3, (0, 5, 0), resolution=12)
    assert len(small[0].triangles) < limit <= len(enough.triangles)
    for part in (*small, enough):
        mesh += part
    assert drop_small_components(mesh) == 4
    assert len(mesh.triangles) == len(large.triangles) + len(enough.triangles)
    assert len(mesh.vertices) == len(large.vertices) + len(enough.vertices)
    assert np.asarray(mesh.vertices)[:, 0].max() < 1.01
    assert drop_small_components(mesh) == 0


def test_an_empty_mesh_stays_empty():
    mesh = o3d.geometry.TriangleMesh()
    assert drop_small_components(mesh) == 0
    vertices, normals, faces = decimate(mesh, 1000)
    assert vertices.shape == normals.shape == faces.shape == (0, 3)
