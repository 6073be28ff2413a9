"""Bounced light averaged over rings: closer to the truth by as many rays, linear, exact where nothing differs."""

import numpy as np
import open3d as o3d
import pytest

from relight.transfer.bounces import Interreflection, Sharing, visible_fraction
from relight.transfer.first_bounce import first_bounce
from relight.transfer.neighbors import Neighbors
from relight.transfer.occluder import Occluder
from relight.transfer.visibility import raytraced_scene
from scenes import build


@pytest.fixture(scope="module")
def table():
    """(Occluder, Neighbors, visible (V,), what vertices send (V, 3)) of a tabletop."""
    truth = build("tabletop", 3, 12_000)
    occluder = Occluder(truth.vertices, truth.normals, truth.faces)
    visible = visible_fraction(raytraced_scene(occluder, 3, 128, 0))
    sent = truth.albedo_linear * np.maximum(0.2, truth.normals @ [0.3, 0.9, 0.3])[:, None] * visible[:, None]
    return occluder, Neighbors(occluder.origins, occluder.normals, occluder.faces), visible, sent.astype(np.float32)


def matrices(table, rays, seed=0):
    """The matrix of plain rays, and the one that averages over rings."""
    occluder, neighbors, visible, _ = table
    return [
        Interreflection(occluder, rays, seed, visible, sharing=Sharing(neighbors=each)) for each in (None, neighbors)
    ]


@pytest.mark.parametrize(("rays", "most"), [(16, 0.7), (64, 0.8)])
def test_the_error_falls_as_by_more_rays(table, rays, most):
    occluder, _, _, sent = table
    rows = np.random.default_rng(2).choice(len(sent), 800, replace=False)
    truth = first_bounce(occluder, sent, 2048, rows, seed=9)
    plain, averaged = (np.linalg.norm(matrix.bounce(sent)[rows] - truth) for matrix in matrices(table, rays))
    assert averaged < most * plain  # three seeds each gave .54 to .58 and .66 to .67


def test_it_neither_makes_nor_loses_light(table):
    _, _, _, sent = table
    plain, averaged = (matrix.bounce(sent).sum() for matrix in matrices(table, 64))
    assert averaged == pytest.approx(plain, rel=0.01)


def test_it_is_linear(table):
    _, _, _, sent = table
    _, matrix = matrices(table, 16)
    other = np.random.default_rng(0).random(sent.shape, np.float32)
    both = matrix.bounce(sent) + matrix.bounce(other)
    np.testing.assert_allclose(matrix.bounce(sent + other), both, atol=1e-5 * float(both.max()))


def test_where_all_meet_the_same_not_a_bit_is_lost():
    """From inside a closed ball everything is front, and sends the same."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    vertices = np.asarray(mesh.vertices).astype(np.float32)
    occluder = Occluder(vertices, -vertices, np.asarray(mesh.triangles))
    matrix = Interreflection(
        occluder, 32, sharing=Sharing(neighbors=Neighbors(occluder.origins, occluder.normals, occluder.faces))
    )
    np.testing.assert_array_equal(matrix.bounce(np.full(len(vertices), 0.5, np.float32)), np.float32(0.5))


def test_vertices_inside_a_body_neither_give_nor_take():
    """The inner of two balls looks at the backs of the outer one."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, 12)
    vertices, faces = np.asarray(mesh.vertices).astype(np.float32), np.asarray(mesh.triangles)
    inner = 0.5 * vertices
    occluder = Occluder(
        np.concatenate([vertices, inner]), np.tile(vertices, (2, 1)), np.concatenate([faces, faces + len(vertices)])
    )
    neighbors = Neighbors(occluder.origins, occluder.normals, occluder.faces)
    matrix = Interreflection(occluder, 32, sharing=Sharing(neighbors=neighbors))
    assert not matrix.bounce(np.ones(len(occluder.origins), np.float32))[len(vertices) :].any()
