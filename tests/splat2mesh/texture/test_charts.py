"""splat2mesh.texture.charts: no texel shows two faces, no chart is stretched, and squares are filled as asked."""

import numpy as np
import open3d as o3d
import pytest

from splat2mesh.texture.charts import GUTTER, STEEPEST, charts_of
from splat2mesh.texture.fill import filled

SIZE = 128


def shape(name):
    made = {
        "ball": lambda: o3d.geometry.TriangleMesh.create_sphere(1.0, 12),
        "ring": lambda: o3d.geometry.TriangleMesh.create_torus(1.0, 0.4, 24, 12),
        "box": lambda: o3d.geometry.TriangleMesh.create_box(1.0, 2.0, 3.0).subdivide_midpoint(2),
        "cone": lambda: o3d.geometry.TriangleMesh.create_cone(1.0, 2.0, 20, 6),
    }[name]()
    return np.asarray(made.vertices).astype(np.float32), np.asarray(made.triangles).astype(np.int64)


def lengths(points, faces):
    return np.linalg.norm(points[faces] - np.roll(points[faces], -1, axis=1), axis=2)


@pytest.mark.parametrize("name", ["ball", "ring", "box", "cone"])
def test_no_texel_lies_in_two_faces(name):
    points, faces = shape(name)
    charts = charts_of(points, faces, np.full(len(faces), 15.0))
    uv, _ = charts.packed(SIZE)
    place = (np.stack(np.meshgrid(np.arange(SIZE), np.arange(SIZE)), axis=-1).reshape(-1, 2) + 0.5)[:, None]
    a, b, c = (uv[charts.faces[:, corner]][None] for corner in range(3))

    def side(p, q):
        return (q[..., 0] - p[..., 0]) * (place[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (
            place[..., 0] - p[..., 0]
        )

    sides = np.stack([side(a, b), side(b, c), side(c, a)])
    inside = (sides > 1e-9).all(axis=0) | (sides < -1e-9).all(axis=0)  # on an edge a centre belongs to either
    assert inside.sum(axis=1).max() == 1
    assert uv.min() >= GUTTER and uv.max() <= SIZE - GUTTER


@pytest.mark.parametrize("name", ["ball", "ring", "box"])
def test_texels_are_as_dense_as_asked_up_to_the_slope_of_the_chart(name):
    points, faces = shape(name)
    charts = charts_of(points, faces, np.full(len(faces), 15.0))
    uv, scale = charts.packed(512)
    assert scale == 1.0
    ratio = lengths(uv, charts.faces) / lengths(points, faces) / 15.0
    # Projection shortens by at most the cosine of the steepest face; a plane turned to the mean may add as much again.
    assert ratio.max() < 1 + 1e-5 and ratio.min() > 0.5 * STEEPEST
    np.testing.assert_array_equal(charts.vertex[charts.faces], faces)


def test_a_corner_that_asks_for_twice_as_many_gets_twice_as_many():
    points, faces = shape("box")
    fine = (points[faces][:, :, 0] > 0.999).all(axis=1)  # one side of the box
    charts = charts_of(points, faces, np.where(fine, 40.0, 15.0))
    ratio = lengths(charts.across, charts.faces) / lengths(points, faces)
    np.testing.assert_allclose(ratio[fine], 40.0, rtol=1e-5)  # float32 points
    np.testing.assert_allclose(ratio[~fine], 15.0, rtol=1e-5)


def test_what_does_not_fit_is_made_smaller_alike_or_refused():
    points, faces = shape("ring")
    charts = charts_of(points, faces, np.full(len(faces), 40.0))
    uv, scale = charts.packed(SIZE)
    assert 0.1 < scale < 1.0 and charts.packed(SIZE, 0.99) is None
    np.testing.assert_allclose(lengths(uv, charts.faces), scale * lengths(charts.across, charts.faces), atol=1e-9)


def test_texels_between_charts_take_the_colours_around():
    rng = np.random.default_rng(0)
    every = rng.integers(0, 256, (49, 3), dtype=np.uint8)
    np.testing.assert_array_equal(filled(7, np.arange(49), every), every.reshape(7, 7, 3))
    one = filled(7, np.array([3 * 7 + 2]), np.array([[9, 80, 200]], np.uint8))
    np.testing.assert_array_equal(one, np.broadcast_to([9, 80, 200], (7, 7, 3)))
    two = filled(4, np.array([0, 15]), np.array([[0, 0, 0], [200, 200, 200]], np.uint8))
    assert two[0, 1, 0] == 0 and two[3, 2, 0] == 200 and two[0, 3, 0] == 100  # its block of four holds both
