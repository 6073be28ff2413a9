"""Vertices behind fog: the equation that their moves solve, and what thickness, noise and scale do to them."""

import numpy as np
import pytest
from mesh_samples import arrays, face_normals, sheet, sheet_points, sphere

from splat2mesh.scene.mesh import vertex_normals
from splat2mesh.surface.behind_fog import SHARE, behind_fog
from splat2mesh.surface.fair import TOLERANCE

SIZE = 30
UP = np.array([0.0, 0.0, 1.0])


def plate():
    """A flat grid with unit edges: points, normals, faces."""
    points, faces = sheet_points(SIZE, SIZE).astype(np.float64), sheet(SIZE, SIZE)
    return points, np.tile(UP, (len(points), 1)), faces


def ball():
    points, faces = arrays(sphere(resolution=12))
    return points, vertex_normals(points, faces), faces


def dense_moves(points, normals, faces, thickness, most, fog):
    """The same moves by loops and a dense solver."""
    neighbors = [set() for _ in points]
    for face in faces.tolist():
        for start in face:
            neighbors[start] |= set(face) - {start}
    # the median of the first edges of faces, as the length of an edge
    edge = np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1))
    reach = (fog / edge) ** 2
    system, right = np.zeros((len(points),) * 2), np.zeros((len(points), 3))
    for row, others in enumerate(neighbors):
        system[row, row] = (1.0 + reach) * len(others)
        system[row, list(others)] = -reach
        depth = min(thickness[row], most) if np.isfinite(thickness[row]) else 0.0
        right[row] = SHARE * len(others) * depth * normals[row]
    return np.linalg.solve(system, right)


@pytest.mark.parametrize("fog", [0.0, 0.3, 2.0])
def test_moves_solve_the_equation(fog):
    points, normals, faces = ball()
    thickness = np.random.default_rng(1).uniform(0.0, 0.2, len(points))
    thickness[::9] = np.inf
    expected = dense_moves(points, normals, faces, thickness, 0.15, fog)
    found = points - behind_fog(points, normals, faces, thickness, 0.15, fog)
    np.testing.assert_allclose(found, expected, atol=20 * TOLERANCE * 0.15)  # the residual is TOLERANCE


@pytest.mark.parametrize("thickness,moved", [(0.0, 0.0), (0.2, 0.2), (5.0, 0.3), (np.inf, 0.0)])
def test_even_fog_moves_a_plate_as_a_whole(thickness, moved):
    points, normals, faces = plate()
    found = behind_fog(points, normals, faces, np.full(len(points), thickness), 0.3, 4.0)
    np.testing.assert_allclose(points - found, SHARE * moved * normals, atol=1e-3 * 0.3)


def test_noise_of_the_thickness_makes_no_bumps():
    points, normals, faces = plate()
    thickness = np.random.default_rng(2).uniform(0.0, 2.0, len(points))  # mean 1, deviation .58
    rough, smooth = (behind_fog(points, normals, faces, thickness, 2.0, fog) for fog in (0.0, 5.0))
    assert np.std(rough[:, 2]) > 0.5 * SHARE and np.std(smooth[:, 2]) < 0.1 * SHARE
    # twice the area of each face: 1 where it is flat
    tilts = [np.linalg.norm(face_normals(each, faces), axis=1).mean() for each in (rough, smooth)]
    assert tilts[0] > 1.1 and tilts[1] < 1.002


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_nothing_depends_on_the_unit(scale):
    points, normals, faces = ball()
    thickness = np.linspace(0.0, 0.2, len(points))
    expected = behind_fog(points, normals, faces, thickness, 0.15, 0.4)
    found = behind_fog(scale * points, normals, faces, scale * thickness, scale * 0.15, scale * 0.4)
    np.testing.assert_allclose(found / scale, expected, atol=1e-9)
    assert behind_fog(points.astype(np.float32), normals, faces, thickness, 0.15, 0.4).dtype == np.float32
