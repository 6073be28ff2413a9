"""Splats: geometry and colour against SciPy, validation, and what `clean` drops."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from splat_samples import basis_oracle, make_splats, unit_vectors

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.cleaning import clean, sound, usable
from splat2mesh.splats.harmonics import sh_basis_3dgs
from splat2mesh.splats.splats import FLATTEST, INVISIBLE_OPACITY, MIN_SPLATS, NUMBERS, Splats

# A few float32 roundings (6e-8) of values of order one.
ROUNDING = 1e-6


def test_rotation_matrices_agree_with_scipy():
    splats = make_splats(200, 0)
    expected = Rotation.from_quat(splats.quats_wxyz[:, [1, 2, 3, 0]]).as_matrix()
    np.testing.assert_allclose(splats.rotation_matrices(), expected, atol=ROUNDING)
    assert splats.rotation_matrices().dtype == np.float32


def test_covariance_has_the_scales_along_the_axes():
    splats = make_splats(200, 0)
    covariances, axes = splats.covariances(), splats.rotation_matrices()
    np.testing.assert_array_equal(covariances, covariances.swapaxes(1, 2))
    along = np.einsum("nki,nkl,nlj->nij", axes.astype(float), covariances, axes)
    expected = np.einsum("ni,ij->nij", splats.scales.astype(float) ** 2, np.eye(3))
    # Off-axis entries round relative to the largest variance of the same splat.
    error = np.abs(along - expected).max(axis=(1, 2)) / (splats.scales.max(axis=1) ** 2)
    # The rotations are orthogonal to some 5e-7, and enter twice.
    assert error.max() < 2 * ROUNDING


def test_quaternions_come_out_unit_and_unit_ones_keep_every_bit():
    splats = make_splats(500, 0)
    norms = np.linalg.norm(splats.quats_wxyz.astype(float), axis=1)
    np.testing.assert_allclose(norms, 1, atol=2e-7)  # the rounding of four float32 components
    np.testing.assert_array_equal(splats.take(slice(None)).quats_wxyz, splats.quats_wxyz)
    stretched = replace(splats, quats_wxyz=splats.quats_wxyz * np.float32(-7))
    np.testing.assert_allclose(stretched.quats_wxyz, -splats.quats_wxyz, atol=ROUNDING)


@pytest.mark.parametrize("degree", range(4))
def test_basis_is_scipys_with_the_signs_of_3dgs(degree):
    directions = unit_vectors(300)
    # Polynomials of at most third degree in float64: the rounding is that of the oracle's angles.
    np.testing.assert_allclose(sh_basis_3dgs(directions, degree), basis_oracle(directions, degree), atol=1e-13)


@pytest.mark.parametrize("degree", range(4))
def test_colors_toward_an_eye(degree):
    splats, eye = make_splats(300, degree), np.array([0.3, -4.0, 1.0])
    directions = splats.means.astype(float) - eye
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    expected = np.einsum("nk,nkc->nc", basis_oracle(directions, degree), splats.sh) + 0.5
    assert expected.min() < 0  # so that the clipping is exercised
    np.testing.assert_allclose(splats.colors_toward(eye), np.maximum(expected, 0), atol=5 * ROUNDING)
    assert splats.colors_toward(eye).dtype == np.float32


def test_colors_of_many_splats_are_those_of_each_alone():
    splats = make_splats(70_000, 1)  # more than one block
    rows = [0, 65_535, 65_536, 69_999]
    together = splats.colors_toward((1, 2, 3))[rows]
    np.testing.assert_array_equal(together, splats.take(rows).colors_toward((1, 2, 3)))


def test_diffuse_color_is_the_mean_over_all_directions():
    splats, directions = make_splats(20, 3), unit_vectors(50)
    basis = basis_oracle(np.concatenate([directions, -directions]), 3)
    assert splats.degree == 3
    np.testing.assert_allclose(splats.colors_diffuse, splats.sh[:, 0] * basis[0, 0] + 0.5, atol=ROUNDING)


@pytest.mark.parametrize("rows", [[5, 2, 2], slice(3, 9), np.arange(40) % 3 == 0])
def test_take_selects_the_same_rows_of_every_field(rows):
    splats = replace(make_splats(40, 2), environment=np.arange(40) > 30)
    taken = splats.take(rows)
    for name in (*NUMBERS, "environment"):
        np.testing.assert_array_equal(getattr(taken, name), getattr(splats, name)[rows])
    assert taken.facts is splats.facts
    assert len(taken) == len(splats.means[rows])


@pytest.mark.parametrize(
    ("field", "shape", "found"),
    [
        ("means", (7, 3), r"means of shape \(8, 3\), found \(7, 3\)"),
        ("scales", (8, 2), r"scales of shape \(8, 3\), found \(8, 2\)"),
        ("quats_wxyz", (8, 3), r"quats_wxyz of shape \(8, 4\), found \(8, 3\)"),
        ("opacities", (8, 1), r"found \(8, 1\)|found \(8, 3\)"),
        ("sh", (8, 3), r"sh of shape .* found \(8, 3\)"),
        ("sh", (8, 5, 3), r"K = 1, 4, 9 or 16, found \(8, 5, 3\)"),
        ("sh", (8, 3, 4), r"found \(8, 3, 4\)"),
    ],
)
def test_a_wrong_shape_is_quoted(field, shape, found):
    with pytest.raises(InputError, match=found):
        replace(make_splats(8, 1), **{field: np.ones(shape)})


@pytest.mark.parametrize("value", [-0.1, 1.5])
def test_opacities_outside_the_unit_interval_are_refused(value):
    splats = make_splats(8, 0)
    opacities = splats.opacities.copy()
    opacities[3] = value
    with pytest.raises(InputError, match=rf"found {value}: apply the sigmoid"):
        replace(splats, opacities=opacities)


def test_an_eye_must_be_one_point():
    with pytest.raises(InputError, match=r"found \(2, 3\)"):
        make_splats(8, 0).colors_toward(np.zeros((2, 3)))


def with_rows(splats, **changes):
    """`splats` with single rows of fields overwritten: field=(row, value)."""
    copies = {name: getattr(splats, name).copy() for name in changes}
    for name, edits in changes.items():
        for row, value in edits:
            copies[name][row] = value
    return replace(splats, **copies)


def test_sound_splats_pass_through_untouched():
    splats = make_splats(50, 3)
    cleaned, counts = clean(splats)  # a DataWarning would fail the test
    assert cleaned is splats
    assert counts == {"non_finite": 0, "absurd": 0, "zero_quaternion": 0, "invisible": 0}


def test_each_unusable_splat_is_dropped_and_counted_once():
    broken = with_rows(
        make_splats(60, 1),
        means=[(0, np.nan), (1, np.inf), (10, 2e15)],
        scales=[(2, np.inf), (11, 1e20), (12, -0.1), (13, 0)],
        quats_wxyz=[(3, np.nan), (20, 0), (21, 0)],
        opacities=[(4, np.nan), (0, 0), (20, 0), (30, 0), (31, 0.0039), (32, np.float32(INVISIBLE_OPACITY))],
        sh=[(5, np.nan)],
    )
    with pytest.warns(DataWarning, match="6 with a NaN or infinite value, 4 with a position.*2 with a zero"):
        cleaned, counts = clean(broken)
    assert counts == {"non_finite": 6, "absurd": 4, "zero_quaternion": 2, "invisible": 2}
    kept = [32, *(i for i in range(6, 60) if i not in (10, 11, 12, 13, 20, 21, 30, 31, 32))]
    np.testing.assert_array_equal(cleaned.means, broken.means[sorted(kept)])
    np.testing.assert_array_equal(cleaned.sh, broken.sh[sorted(kept)])


def test_a_scale_of_zero_is_thickened():
    splats = with_rows(make_splats(20, 0), scales=[(4, (0.2, 0, 0.1)), (5, (0.1, 0.2, 1e-30))])
    with pytest.warns(DataWarning, match="thickened 1 splats"):
        cleaned, counts = clean(splats)
    assert counts["absurd"] == 0
    np.testing.assert_allclose(cleaned.scales[4], [0.2, 0.2 * FLATTEST, 0.1], rtol=ROUNDING)
    np.testing.assert_array_equal(np.delete(cleaned.scales, 4, 0), np.delete(splats.scales, 4, 0))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"means": np.nan}, r"0 of 40 splats are usable \(40 non finite\)"),
        ({"opacities": 0.0}, r"0 of 40 splats are usable \(40 invisible\)"),
    ],
)
def test_nothing_left_says_why(changes, reason):
    splats = make_splats(40, 0)
    filled = {name: np.full_like(getattr(splats, name), value) for name, value in changes.items()}
    with pytest.raises(InputError, match=reason):
        clean(replace(splats, **filled))


def test_the_fewest_splats():
    assert len(clean(make_splats(MIN_SPLATS, 0))[0]) == MIN_SPLATS
    with pytest.raises(InputError, match=r"none dropped.*at least 10"):
        clean(make_splats(MIN_SPLATS - 1, 0))


def _random(n, rng):
    return Splats(
        rng.uniform(-1, 1, (n, 3)),
        rng.uniform(0.1, 1, (n, 3)),
        rng.normal(size=(n, 4)),
        rng.random(n),
        rng.random((n, 4, 3)),
    )


def test_spatial_order_does_not_depend_on_the_order_given():
    rng = np.random.default_rng(5)
    splats = _random(3000, rng)  # a cell of 1024^3 holds two of them with a probability of 0.4%
    ordered, again = splats.in_spatial_order(), splats.take(rng.permutation(3000)).in_spatial_order()
    rows = [
        np.hstack([s.means, s.scales, s.quats_wxyz, s.opacities[:, None], s.sh.reshape(3000, -1)])
        for s in (ordered, splats)
    ]
    assert np.array_equal(*(block[np.lexsort(block.T)] for block in rows))  # whole rows moved, none lost
    middle = (np.abs(ordered.means) < 0.97).all(axis=1)  # the outermost hundredth is clipped to the border's cells
    assert np.array_equal(ordered.means[middle], again.means[(np.abs(again.means) < 0.97).all(axis=1)])


def test_spatial_order_brings_neighbours_together():
    means = np.stack(np.meshgrid(*[np.arange(16.0)] * 3), axis=-1).reshape(-1, 3)
    ordered = _random(4096, np.random.default_rng(7))
    ordered = Splats(
        np.random.default_rng(8).permutation(means), ordered.scales, ordered.quats_wxyz, ordered.opacities, ordered.sh
    )
    boxes = ordered.in_spatial_order().means.reshape(512, 8, 3)
    # Eight at a time fill a cube of 2^3, wherever the octree's borders fall between the grid's planes.
    assert np.median(np.ptp(boxes, axis=1).max(axis=1)) == 1


def test_sound_splats_are_those_that_are_kept_and_the_faint_ones():
    rng = np.random.default_rng(0)
    numbers = [rng.uniform(0.1, 0.9, shape) for shape in ((6, 3), (6, 3), (6, 4), (6,), (6, 1, 3))]
    numbers[0][0, 1] = np.nan
    numbers[1][1, 2] = -1.0
    numbers[2][2] = 0.0
    numbers[3][3] = 0.0
    splats = Splats(*numbers)
    np.testing.assert_array_equal(sound(splats), [False, False, False, True, True, True])
    np.testing.assert_array_equal(usable(splats)[0], [False, False, False, False, True, True])
    assert len(sound(splats.take(slice(0)))) == 0
