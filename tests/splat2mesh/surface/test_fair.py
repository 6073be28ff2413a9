"""Fairing: the least squares it promises, noise gone and shape kept, thin surfaces trusted more than fuzzy ones."""

import os
import subprocess
import sys

import numpy as np
import pytest
from mesh_samples import arrays, border_vertices, face_normals, sheet, sheet_points, slivered_sphere, sphere, volume
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from splat2mesh.surface.clean import fill_holes
from splat2mesh.surface.decimate import decimate
from splat2mesh.surface.fair import LEAST_THICKNESS, MOST_THICKNESS, STRENGTH, TOLERANCE, fair


def ball(vertices=2000):
    """A unit sphere of irregular triangles, and its median edge."""
    points, faces = decimate(*arrays(sphere(resolution=80)), vertices)
    return points / np.linalg.norm(points, axis=1, keepdims=True), faces, median_edge(points, faces)


def median_edge(points, faces):
    return float(np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1)))


def grid(size=30):
    """A flat grid with unit edges: points and faces."""
    return sheet_points(size, size), sheet(size, size)


def irregular():
    """An open irregular sheet with noise, and a closed octahedron beside it: points and faces."""
    rng = np.random.default_rng(0)
    flat = rng.uniform(0, 8, (120, 2))
    corners = np.vstack([np.eye(3), -np.eye(3)]) + np.array([12, 0, 0])
    eight = [(0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5)]
    points = np.vstack([np.column_stack([flat, rng.normal(0, 0.2, len(flat))]), corners])
    return points, np.vstack([Delaunay(flat).simplices, np.array(eight) + len(flat)])


def dense_fair(points, faces, thickness, pixel):
    """The same minimum by loops and a dense solver; also the weight of the least trusted vertex."""
    count = len(points)
    neighbors, uses = [set() for _ in points], {}
    for face in faces.tolist():
        for start, end in zip(face, face[1:] + face[:1], strict=True):
            neighbors[start].add(end)
            neighbors[end].add(start)
            uses[frozenset((start, end))] = uses.get(frozenset((start, end)), 0) + 1
    border = {vertex for edge, times in uses.items() if times == 1 for vertex in edge}
    laplacian = np.zeros((count, count))
    for vertex in range(count):
        if vertex not in border and neighbors[vertex]:
            laplacian[vertex, vertex] = 1
            for neighbor in neighbors[vertex]:
                laplacian[vertex, neighbor] = -1 / len(neighbors[vertex])
    strength = STRENGTH * min(pixel / median_edge(points, faces), 1) ** 4
    trust = (LEAST_THICKNESS + np.minimum(thickness, MOST_THICKNESS)) ** -2.0
    # Least squares of sqrt(trust) (x - points) and sqrt(strength) L x, without forming the normal equations.
    system = np.vstack([np.diag(np.sqrt(trust)), np.sqrt(strength) * laplacian])
    wanted = np.vstack([np.sqrt(trust)[:, None] * points, np.zeros_like(points)])
    pull = np.linalg.norm(strength * laplacian.T @ (laplacian @ points), axis=0)
    return np.linalg.lstsq(system, wanted, rcond=None)[0], pull / trust.min()


@pytest.mark.parametrize("pixels_per_edge", [0.1, 0.4, 3.0])
def test_it_is_the_least_squares_solution(pixels_per_edge):
    points, faces = irregular()
    thickness = np.random.default_rng(1).uniform(0, 4, len(points))
    thickness[::7] = np.inf
    pixel = pixels_per_edge * median_edge(points, faces)
    expected, reach = dense_fair(points, faces, thickness, pixel)
    found = fair(points, faces, thickness, pixel)
    assert found.shape == points.shape and found.dtype == np.float64
    # A residual of TOLERANCE times the right-hand side is an error of as much over the smallest eigenvalue at most,
    # which the smallest trust bounds from below.
    assert (np.linalg.norm(found - expected, axis=0) <= TOLERANCE * reach).all()
    # In practice far less, most where smoothing is strongest: 1.5% of the way at 3 pixels per edge.
    step = np.linalg.norm(expected - points)
    assert np.linalg.norm(found - expected) < 0.02 * step and step > 0.01


def test_noise_goes_and_the_sphere_keeps_its_size():
    truth, faces, edge = ball(4000)
    noise = 0.2 * edge
    noisy = truth + np.random.default_rng(0).normal(0, noise, truth.shape)
    pixel = 0.5 * edge
    found = fair(noisy, faces, np.ones(len(truth)), pixel)
    before, after = np.linalg.norm(noisy, axis=1), np.linalg.norm(found, axis=1)
    assert after.std() < 0.35 * before.std()  # 0.24 measured
    assert after.mean() == pytest.approx(before.mean(), abs=0.05 * noise)  # 0.02 measured
    # Normals come back too: noise of a fifth of an edge turns faces by tens of degrees.
    normals = [face_normals(points, faces) for points in (truth, noisy, found)]
    truly, before, after = (n / np.linalg.norm(n, axis=1, keepdims=True) for n in normals)
    assert np.median((truly * before).sum(axis=1)) < 0.97 and np.median((truly * after).sum(axis=1)) > 0.995
    assert (truly * after).sum(axis=1).min() > 0  # nothing turned over


def test_slivers_and_turned_faces_are_evened_out():
    points, faces = decimate(*slivered_sphere(), 1000)
    points, faces, _ = fill_holes(points, faces, 1.0)
    outward = points[faces].mean(axis=1)
    before = face_normals(points, faces)
    assert ((before * outward).sum(axis=1) < 0).any()
    size = np.linalg.norm(before, axis=1)
    assert size.min() < 1e-6 * np.median(size)
    after = face_normals(fair(points, faces, np.ones(len(points)), 0.5 * median_edge(points, faces)), faces)
    size = np.linalg.norm(after, axis=1)
    assert ((after * outward).sum(axis=1) > 0).all()
    assert size.min() > 0.01 * np.median(size)  # 0.03 measured


def test_a_clean_sphere_hardly_shrinks():
    truth, faces, edge = ball(4000)
    found = fair(truth, faces, np.ones(len(truth)), 0.5 * edge)
    # The Laplacian of a sphere is edge^2 / 4 in size: a fold of it, a small part of an edge, is what it may lose.
    assert 0 <= 1 - np.linalg.norm(found, axis=1).mean() < 0.01 * edge
    assert volume(found, faces) == pytest.approx(volume(truth, faces), rel=0.003)


def test_a_regular_plane_and_its_border_do_not_move():
    points, faces = grid()
    turned = Rotation.from_rotvec([0.4, -0.8, 0.3]).apply(points) + np.array([3, -1, 2])
    found = fair(turned, faces, np.full(len(points), np.inf), 1.0)
    np.testing.assert_allclose(found, turned, atol=1e-9)  # rounding: inner vertices are the mean of their neighbours


def test_noise_in_a_plane_stays_in_it():
    points, faces = grid()
    points[:, :2] += np.random.default_rng(0).normal(0, 0.2, (len(points), 2))
    found = fair(points, faces, np.ones(len(points)), 1.0)
    assert (found[:, 2] == 0).all() and np.abs(found - points).max() > 0.1
    assert np.median(face_normals(found, faces)[:, 2]) > 0.5


def test_borders_are_pulled_far_less_than_the_inside():
    """They are free of smoothing themselves; what reaches them is the bending of their inner neighbours."""
    points, faces = grid()
    border = border_vertices(faces, len(points))
    noisy = points + np.random.default_rng(0).normal(0, 0.2, points.shape)
    moved = np.linalg.norm(fair(noisy, faces, np.ones(len(points)), 1.0) - noisy, axis=1)
    assert moved[border].mean() < 0.5 * moved[~border].mean()
    # A dent in the middle is levelled; the reach of that is (strength / trust)^(1/4), 2.6 edges, and a border 5.5 of
    # them away does not notice.
    dented = points.copy()
    dented[:, 2] = np.exp(-((points[:, :2] - 14.5) ** 2).sum(axis=1) / 8)
    moved = np.linalg.norm(fair(dented, faces, np.ones(len(points)), 0.55) - dented, axis=1)
    assert moved.max() > 0.2 and moved[border].max() < 0.003 * moved.max()


def test_a_lone_triangle_and_a_loose_vertex_stay():
    points = np.random.default_rng(0).normal(size=(4, 3)) + 100
    np.testing.assert_array_equal(fair(points, np.array([[0, 1, 2]]), np.full(4, np.inf), 10.0), points)


def test_fuzzy_parts_move_more_than_thin_ones():
    truth, faces, edge = ball()
    noisy = truth * (1 + np.random.default_rng(0).normal(0, 0.1 * edge, (len(truth), 1)))
    thin = truth[:, 0] < 0
    found = fair(noisy, faces, np.where(thin, 0.0, 2.0), 0.25 * edge)
    moved = np.linalg.norm(found - noisy, axis=1)
    assert moved[~thin].mean() > 1.5 * moved[thin].mean()
    # Each half is what it would be alone, away from the seam.
    for value, half in ((0.0, truth[:, 0] < -0.4), (2.0, truth[:, 0] > 0.4)):
        alone = fair(noisy, faces, np.full(len(truth), value), 0.25 * edge)
        np.testing.assert_allclose(found[half], alone[half], atol=0.01 * edge)


def test_thickness_counts_up_to_a_limit_and_infinity_is_that_limit():
    points, faces, edge = ball()
    points = points + np.random.default_rng(0).normal(0, 0.1 * edge, points.shape)
    steps = [
        np.linalg.norm(fair(points, faces, np.full(len(points), t), 0.5 * edge) - points)
        for t in (0.0, 0.5, 1.0, MOST_THICKNESS, 10.0, np.inf)
    ]
    assert (np.diff(steps[:4]) > 0.01 * steps[0]).all()
    assert steps[3] == steps[4] == steps[5] and np.isfinite(steps[5])


def test_edges_that_are_long_in_training_pixels_are_hardly_smoothed():
    points, faces, edge = ball()
    points = points + np.random.default_rng(0).normal(0, 0.1 * edge, points.shape)
    moved = [
        np.linalg.norm(fair(points, faces, np.ones(len(points)), pixel * edge) - points)
        for pixel in (0.01, 0.02, 0.5, 1.1, 2.0)
    ]
    # Weak smoothing is proportional to its strength, and that to the fourth power; beyond one pixel it is held.
    assert moved[1] / moved[0] == pytest.approx(16, rel=0.02) and moved[1] < 1e-3 * moved[3]
    assert moved[2] < moved[3] == moved[4]


def test_it_turns_shifts_and_scales_with_the_mesh():
    points, faces = irregular()
    thickness, pixel = np.random.default_rng(1).uniform(0, 3, len(points)), 0.4 * median_edge(points, faces)
    found = fair(points, faces, thickness, pixel)
    turn = Rotation.from_rotvec([0.7, -1.1, 0.4])
    for scale, shift in ((1.0, [0, 0, 0]), (1e-3, [0, 0, 0]), (1e3, [1e3, -2e3, 5e3])):
        moved = fair(scale * turn.apply(points) + shift, faces, thickness, scale * pixel)
        # The three coordinates are solved for apart, each to TOLERANCE: an error of a thousandth of what moves.
        back = turn.apply(moved - shift, inverse=True) / scale
        np.testing.assert_allclose(back, found, atol=2e-3 * np.abs(found - points).max())
    # Without a turn every operation scales: to rounding.
    np.testing.assert_allclose(fair(8 * points, faces, thickness, 8 * pixel), 8 * found, rtol=1e-12)


def test_it_is_the_same_every_time_and_leaves_its_input_alone():
    points, faces = irregular()
    before = points.copy(), faces.copy()
    thickness = np.full(len(points), np.inf)
    first, second = (fair(points, faces, thickness, 1.0) for _ in range(2))
    assert first.tobytes() == second.tobytes() and np.isfinite(first).all()
    np.testing.assert_array_equal(points, before[0])
    np.testing.assert_array_equal(faces, before[1])


THREADED = """
import hashlib, sys
import numpy as np
from mesh_samples import sheet, sheet_points
from splat2mesh.surface.fair import fair
points = sheet_points(150, 150) + np.random.default_rng(0).normal(0, 0.2, (150 * 150, 3))
print(hashlib.sha256(fair(points, sheet(150, 150), np.ones(len(points)), 1.0).tobytes()).hexdigest())
"""


def test_the_bytes_do_not_depend_on_the_threads_of_blas():
    known = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    found = [
        subprocess.run(
            [sys.executable, "-c", THREADED],
            env=known | {"OPENBLAS_NUM_THREADS": str(threads)},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in (1, 2)
    ]
    assert found[0] == found[1] and len(found[0]) == 65
