"""Splats moved by similarities look from a moved eye as they did before; every other transform is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from splat_samples import assert_same, basis_oracle, make_splats, unit_vectors

from relight.sh import harmonics
from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.splats.formats.spz import FLIPPED
from splat2mesh.splats.joining import joined
from splat2mesh.splats.placing import parts_of, placed, placed_mesh, sh_rotation_3dgs, similarity
from splat2mesh.views.upright import scene_from_splat

ROTATION = Rotation.from_euler("zyx", [20, -130, 65], degrees=True).as_matrix()
MATRIX = similarity(2.5, ROTATION, [3.0, -1.0, 0.5])


def mapped(matrix, points):
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("degree", range(4))
def test_a_placed_splat_looks_the_same_from_a_placed_eye(degree):
    splats = make_splats(300, degree)
    moved = placed(splats, MATRIX)
    scale = splats.scales.max(axis=1)[:, None, None] ** 2
    np.testing.assert_allclose(moved.means, mapped(MATRIX, splats.means), rtol=1e-6, atol=1e-6)
    expected = 2.5**2 * ROTATION @ splats.covariances() @ ROTATION.T
    np.testing.assert_allclose(moved.covariances() / scale, expected / scale, atol=1e-5)  # float32, 6.25 times as large
    np.testing.assert_allclose(moved.rotation_matrices(), ROTATION @ splats.rotation_matrices(), atol=2e-6)
    for eye in ([0.3, -3.0, 1.5], [2.0, 2.0, 0.0]):
        # Float32 sums of 16 products, and directions that differ by float32 rounding.
        toward = moved.colors_toward(mapped(MATRIX, np.array(eye)))
        np.testing.assert_allclose(toward, splats.colors_toward(eye), atol=2e-5)
    np.testing.assert_array_equal(moved.opacities, splats.opacities)


def test_a_picture_from_a_placed_camera_is_the_same_picture():
    splats = make_splats(200, 3)
    splats = replace(splats, sh=splats.sh / 4)
    pictures = []
    for matrix in (np.eye(4), MATRIX):
        eye, target = mapped(matrix, np.array([[0.5, -6.0, 2.0], [0.0, 0.0, 0.0]]))
        view = View.look_at(eye, target, matrix[:3, :3] @ [0, 0, 1], 40.0, 64)
        pictures.append(rasterize(placed(splats, matrix), view))
    assert pictures[0].alpha.max() > 0.9
    # A pixel at a footprint's cut-off may gain or lose an alpha of 1/255.
    np.testing.assert_allclose(pictures[1].alpha, pictures[0].alpha, atol=1.1 / 255)
    assert np.abs(pictures[1].color - pictures[0].color).mean() < 1e-5


def test_the_harmonics_turn_as_scipy_evaluates_them():
    directions = unit_vectors(300)
    here, back = basis_oracle(directions, 3), basis_oracle(directions @ ROTATION, 3)  # rows of d R are R^-1 d
    # f(R^-1 d) = sum c_i Y_i(R^-1 d) for every c, so M turns the basis.
    np.testing.assert_allclose(here @ sh_rotation_3dgs(ROTATION, 3), back, atol=1e-12)


def test_the_harmonics_turn_as_those_of_relight_do_but_for_the_signs():
    signs = np.where(harmonics.degrees_and_orders(4)[1] % 2, -1.0, 1.0)
    matrix = sh_rotation_3dgs(ROTATION, 3)
    expected = harmonics.rotation_matrix(ROTATION, 4)
    np.testing.assert_allclose(matrix, signs[:, None] * expected * signs, atol=1e-13)
    assert np.abs(matrix - expected).max() > 0.1  # the signs do matter


def test_turns_compose():
    second = similarity(0.4, Rotation.from_rotvec([0.3, 1.0, -2.0]).as_matrix(), [0.0, 7.0, -2.0])
    splats = make_splats(100, 3)
    np.testing.assert_allclose(
        sh_rotation_3dgs(second[:3, :3] / 0.4, 3) @ sh_rotation_3dgs(ROTATION, 3),
        sh_rotation_3dgs(second[:3, :3] / 0.4 @ ROTATION, 3),
        atol=1e-12,
    )
    one, two = placed(placed(splats, MATRIX), second), placed(splats, second @ MATRIX)
    for name in ("means", "scales", "sh"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=1e-5, atol=2e-6)
    np.testing.assert_allclose(one.rotation_matrices(), two.rotation_matrices(), atol=5e-6)


@pytest.mark.parametrize("up", ["+y", "-y", "+z", "-z"])
def test_quarter_turns_are_exact_and_their_own_undoing(up):
    splats, matrix = make_splats(50, 3), scene_from_splat(up)
    moved = placed(splats, matrix)
    np.testing.assert_array_equal(moved.means, (splats.means @ matrix[:3, :3].T).astype(np.float32))
    if up == "-y":
        np.testing.assert_array_equal(moved.sh, splats.sh * FLIPPED[:, None])
    back = placed(moved, np.linalg.inv(matrix))
    np.testing.assert_array_equal(back.means, splats.means)
    np.testing.assert_allclose(back.sh, splats.sh, atol=1e-6)
    np.testing.assert_allclose(back.covariances(), splats.covariances(), rtol=1e-5, atol=1e-6)


def test_placing_nowhere_changes_nothing():
    splats = make_splats(50, 2)
    assert_same(placed(splats, np.eye(4)), splats)
    assert_same(placed(splats, similarity()), splats)


def test_broken_rows_stay_broken_and_alone():
    splats = make_splats(50, 3)
    bad = replace(splats, means=splats.means.copy(), sh=splats.sh.copy(), quats_wxyz=splats.quats_wxyz.copy())
    bad.means[3, 0], bad.sh[5, 7, 1], bad.quats_wxyz[9] = np.nan, np.inf, 0
    found, expected = placed(bad, MATRIX), placed(splats, MATRIX)
    keep = np.setdiff1d(np.arange(50), [3, 5, 9])
    assert_same(found.take(keep), expected.take(keep))
    assert np.isnan(found.means[3]).any() and not np.isfinite(found.sh[5]).all()
    assert not found.quats_wxyz[9].any()


def test_joining_keeps_every_row_in_order_and_pads_harmonics():
    parts = [make_splats(n, degree, n) for n, degree in ((5, 1), (7, 0), (3, 3))]
    whole = joined(list(parts))
    assert len(whole) == 15 and whole.degree == 3
    for rows, part in zip((slice(0, 5), slice(5, 12), slice(12, 15)), parts, strict=True):
        k = part.sh.shape[1]
        assert_same(replace(whole.take(rows), sh=whole.sh[rows, :k]), part)
        assert not whole.sh[rows, k:].any()


def test_a_placed_mesh_keeps_its_outside():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    normals = (corners - 0.25) / np.linalg.norm(corners - 0.25, axis=1, keepdims=True).astype(np.float32)
    mesh = Mesh(corners, normals, faces, np.arange(12, dtype=np.uint8).reshape(4, 3))
    moved = placed_mesh(mesh, MATRIX)
    np.testing.assert_allclose(moved.vertices, mapped(MATRIX, corners), rtol=1e-6)
    np.testing.assert_allclose(moved.normals, normals @ ROTATION.T, atol=1e-6)
    a, b, c = (moved.vertices[faces[:, i]].astype(float) for i in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6  # positive: faces still turn outwards
    assert volume == pytest.approx(2.5**3 / 6, rel=1e-5)
    assert moved.faces is faces and moved.colors_srgb is mesh.colors_srgb
    assert moved.vertices.dtype == moved.normals.dtype == np.float32


def test_parts_of_a_similarity():
    scale, rotation, translation = parts_of(MATRIX)
    assert scale == pytest.approx(2.5, rel=1e-14)
    np.testing.assert_allclose(rotation, ROTATION, atol=1e-15)
    np.testing.assert_array_equal(translation, [3.0, -1.0, 0.5])
    parts_of(MATRIX.astype(np.float32))  # float32 files are near enough


def changed(**cells):
    matrix = MATRIX.copy()
    for cell, value in cells.items():
        matrix[int(cell[1]), int(cell[2])] = value
    return matrix


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.diag([1, 1, -1, 1]), "mirrors"),
        (-np.eye(4) + np.diag([0, 0, 0, 2]), "mirrors"),
        (np.diag([1, 1, 1.001, 1]), "scaled alike in all directions"),
        (changed(m01=0.3), "scaled alike in all directions"),
        (np.diag([0, 0, 0, 1]), "scaled alike in all directions"),
        (changed(m33=2.0), "last row"),
        (changed(m30=0.1), "last row"),
        (changed(m11=np.nan), "finite numbers"),
        (changed(m03=np.inf), "finite numbers"),
        (np.eye(3), "finite numbers"),
    ],
)
def test_other_transforms_are_refused(matrix, message):
    for what in (lambda: placed(make_splats(3, 1), matrix), lambda: parts_of(matrix)):
        with pytest.raises(InputError, match=message) as caught:
            what()
        assert "\n" not in str(caught.value)
