"""Rotors against SciPy's rotations, the harmonics they turn against SciPy's."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from relight.light.environment import turned_about_y
from relight.sh import harmonics, rotors
from splat2mesh.base.errors import InputError

EPS = np.finfo(np.float64).eps
# A few roundings of numbers of size 1: products, square roots, SciPy's own.
TIGHT = 16 * EPS
# Degree 9: values up to 1.2, three turns and two products of 19 terms each, and the oracle's own rounding: 1e-14.
SH_TIGHT = 2e-13


def some_rotors(count, seed=0):
    rotors_4 = np.random.default_rng(seed).normal(size=(count, 4))
    return rotors_4 / np.linalg.norm(rotors_4, axis=1, keepdims=True)


def some_directions(count, seed=1):
    directions = np.random.default_rng(seed).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def scipy_rotation(rotor):
    """SciPy's rotation of the quaternion that the module's first paragraph documents."""
    s, e12, e13, e23 = np.moveaxis(np.asarray(rotor), -1, 0)
    return Rotation.from_quat(np.stack([s, -e23, e13, -e12], axis=-1), scalar_first=True)


def scipy_basis(directions, bands):
    """The basis of relight.sh by another route: SciPy's complex harmonics, made real and all-positive."""
    x, y, z = directions.T
    theta, phi = np.arctan2(np.hypot(x, y), z), np.arctan2(y, x)
    columns = []
    for degree in range(bands):
        for m in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(m), theta, phi) * (-1) ** m
            columns.append(value.real if m == 0 else np.sqrt(2) * (value.imag if m < 0 else value.real))
    return np.stack(columns, axis=1)


def turning(rotor, bands):
    """The (K, K) matrix M with Y(R d) = M Y(d)."""
    return rotors.rotate(np.eye(bands**2), rotor)


# Rotors where the factors Rz Ry Rz are not unique or nearly so.
AWKWARD = {
    "identity": [1, 0, 0, 0],
    "minus identity": [-1, 0, 0, 0],
    "half turn about x": [0, 0, 0, -1],
    "half turn about y": [0, 0, 1, 0],
    "half turn about z": [0, -1, 0, 0],
    "turn about z": [0.6, -0.8, 0, 0],
    "nearly about z": [0.6, -0.8, 1e-8, -1e-9],
    "nearer about z": [0.6, -0.8, -1e-300, 1e-310],
    "nearly a half turn about an axis in xy": [1e-9, 1e-10, 0.6, -0.8],
    "half turn about an axis in xy, negative zeros": [-0.0, -0.0, -0.6, 0.8],
    "tiny turn": [1, 1e-12, -1e-12, 1e-12],
}


@pytest.fixture(params=AWKWARD, ids=str)
def awkward(request):
    return np.array(AWKWARD[request.param], float)


def test_axis_and_angle_are_those_of_scipy():
    for axis, angle in zip(some_directions(50), np.linspace(-7, 7, 50), strict=True):
        found = scipy_rotation(rotors.from_axis_angle(3.0 * axis, angle)).as_matrix()
        assert np.abs(found - Rotation.from_rotvec(axis * angle).as_matrix()).max() < TIGHT


def test_length_and_sign_of_a_rotor_do_not_matter():
    rotor, coefficients = some_rotors(1)[0], np.random.default_rng(1).normal(size=(25, 3))
    for factor in (-1, 1e-200, 1e200):
        again = rotors.rotate(coefficients, factor * rotor)
        assert np.abs(again - rotors.rotate(coefficients, rotor)).max() < SH_TIGHT


@pytest.mark.parametrize("bands", range(1, 11))
def test_harmonics_turn_as_by_quadrature_and_as_scipys_at_turned_directions(bands):
    directions = some_directions(60)
    for rotor in some_rotors(8, bands):
        matrix = turning(rotor, bands)
        turn = scipy_rotation(rotor).as_matrix()
        assert np.abs(matrix - harmonics.rotation_matrix(turn, bands)).max() < SH_TIGHT
        expected = scipy_basis(directions @ turn.T, bands)
        assert np.abs(scipy_basis(directions, bands) @ matrix.T - expected).max() < SH_TIGHT


def test_awkward_rotors_turn_harmonics_as_any_other(awkward):
    directions = some_directions(60)
    expected = scipy_basis(scipy_rotation(awkward).apply(directions), 10)
    turned = scipy_basis(directions, 10) @ turning(awkward, 10).T
    # Directions 1e-12 from another move a function of degree 9 by 1e-11 at most; both sides see the same ones.
    assert np.abs(turned - expected).max() < SH_TIGHT


def test_turned_light_is_seen_in_the_turned_direction():
    coefficients = np.random.default_rng(0).normal(size=(100, 3))
    directions = some_directions(50)
    rotor = some_rotors(1)[0]
    turned = rotors.rotate(coefficients, rotor)
    seen = scipy_basis(scipy_rotation(rotor).apply(directions), 10) @ turned
    assert np.abs(seen - scipy_basis(directions, 10) @ coefficients).max() < 10 * SH_TIGHT  # sums of 100 such terms


def test_turns_about_y_are_those_of_the_command_line():
    coefficients = np.random.default_rng(0).normal(size=(64, 3))
    expected = harmonics.rotation_matrix(Rotation.from_rotvec([0, 0.7, 0]).as_matrix(), 8) @ coefficients
    assert np.abs(turned_about_y(coefficients, np.degrees(0.7)) - expected).max() < SH_TIGHT


def test_leading_axes_are_turned_alike():
    rotor, coefficients = some_rotors(1)[0], np.random.default_rng(0).normal(size=(5, 16, 2))
    for one, turned in zip(coefficients, rotors.rotate(coefficients, rotor), strict=True):
        assert np.abs(rotors.rotate(one, rotor) - turned).max() < SH_TIGHT


@pytest.mark.parametrize("rotor", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 0], 1.0, [1, 0, 0]])
def test_rotors_without_a_direction_or_of_another_shape_are_refused(rotor):
    with pytest.raises(InputError, match=r"shape \(4,\), be finite and not 0, found"):
        rotors.rotate(np.zeros((4, 3)), rotor)


def test_another_number_of_coefficients_is_refused():
    with pytest.raises(InputError, match="K = 1, 4, 9"):
        rotors.rotate(np.zeros((8, 3)), [1, 0, 0, 0])
