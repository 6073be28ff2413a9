"""The closed surface around a mesh: two faces at every edge, all of the mesh inside, near to it."""

import numpy as np
import pytest
import trimesh
from closed_bodies import inside

from splat2mesh.base.errors import InputError
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.surface.wrap import FARTHEST, closed_around

CELLS = 2e4


def solid(vertices, faces):
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.fixture
def sheets():
    """Two triangles that share a corner, a strip and a point of it far away: nothing closed, nothing oriented."""
    mesh = trimesh.util.concatenate(
        [
            trimesh.Trimesh([[0, 0, 0], [2, 0, 0.3], [0, 1, 0]], [[0, 1, 2]]),
            trimesh.Trimesh([[0, 0, 0], [-1, 0.2, 0], [-0.4, -1, 1]], [[0, 2, 1]]),
            trimesh.Trimesh([[1, 1, 1], [1, 2, 1], [1.1, 1, 1.4]], [[0, 1, 2]]),
        ]
    )
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def test_sheets_lie_within_a_closed_surface_that_is_near(sheets):
    pytest.importorskip("manifold3d")
    points, faces, voxel = closed_around(*sheets, cells=CELLS)
    mesh = solid(points, faces)
    assert mesh.is_watertight and mesh.is_winding_consistent and mesh.volume > 0
    samples = trimesh.sample.sample_surface(trimesh.Trimesh(*sheets), 2000, seed=1)[0]
    assert inside(points, faces, samples).all()
    far = np.linalg.norm(RayCaster(*sheets).closest(points).points - points, axis=1)
    assert far.max() < FARTHEST * voxel


def test_a_hollow_is_filled_unless_somebody_stood_in_it():
    pytest.importorskip("manifold3d")
    room = trimesh.creation.box((3, 2, 2.5))
    arrays = np.asarray(room.vertices), np.asarray(room.faces)
    full, open_ = (solid(*closed_around(*arrays, eyes, CELLS)[:2]) for eyes in (None, [[0.2, 0.1, 0]]))
    assert full.is_watertight and open_.is_watertight
    middle = [[0, 0, 0], [0.5, 0.5, 0.5]]
    assert inside(full.vertices, full.faces, middle).all()
    assert not inside(open_.vertices, open_.faces, middle).any()
    assert open_.volume < 0.6 * full.volume


def test_twice_the_same_bytes(sheets):
    pytest.importorskip("manifold3d")
    first, second = (closed_around(*sheets, cells=CELLS) for _ in range(2))
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def test_a_point_has_no_surface_around():
    pytest.importorskip("manifold3d")
    with pytest.raises(InputError, match="expected a mesh with an extent"):
        closed_around(np.ones((3, 3)), np.array([[0, 1, 2]]), cells=CELLS)
