"""Rotors against SciPy's rotations and kingdon's algebra; the harmonics they turn against SciPy's."""

import kingdon
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
    return rotors.normalise(np.random.default_rng(seed).normal(size=(count, 4)))


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


# Rotors where the factors Rz Ry Rz are not unique or nearly so, and where the matrix of a rotation hides its axis.
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


# --- What a rotor is ---------------------------------------------------------------------------------------------


def test_the_sandwich_in_kingdon_is_the_matrix():
    algebra = kingdon.Algebra(3)
    vectors = some_directions(20)
    turned = np.einsum("nij,nj->ni", rotors.to_matrix(some_rotors(20)), vectors)
    for rotor, vector, expected in zip(some_rotors(20), vectors, turned, strict=True):
        s, e12, e13, e23 = rotor
        element = algebra.multivector(e=s, e12=e12, e13=e13, e23=e23)
        image = element * algebra.vector(vector) * element.reverse()
        assert np.abs([image.e1 - expected[0], image.e2 - expected[1], image.e3 - expected[2]]).max() < TIGHT


def test_a_quarter_turn_about_y_takes_z_to_x():
    matrix = rotors.to_matrix(rotors.from_axis_angle([0, 1, 0], np.pi / 2))
    assert np.abs(matrix @ [0, 0, 1] - [1, 0, 0]).max() < TIGHT


def test_axis_and_angle_are_those_of_scipy():
    axes, angles = some_directions(50), np.linspace(-7, 7, 50)
    expected = Rotation.from_rotvec(axes * angles[:, None]).as_matrix()
    assert np.abs(rotors.to_matrix(rotors.from_axis_angle(3.0 * axes, angles)) - expected).max() < TIGHT


def test_one_axis_takes_many_angles():
    turns = rotors.from_axis_angle([0, 0, 1], np.array([0.0, 0.5]))
    assert np.array_equal(turns, rotors.from_axis_angle([[0, 0, 1]] * 2, [0.0, 0.5]))


def test_quaternions_are_those_of_scipy_and_come_back():
    quat = np.random.default_rng(3).normal(size=(50, 4))
    rotor = rotors.from_quat(quat)
    assert np.abs(rotors.to_matrix(rotor) - Rotation.from_quat(quat, scalar_first=True).as_matrix()).max() < TIGHT
    assert np.abs(rotors.to_quat(rotor) - quat / np.linalg.norm(quat, axis=1, keepdims=True)).max() < TIGHT


def test_matrices_come_back_as_the_rotor_or_its_negative():
    rotor = some_rotors(1000)
    back = rotors.from_matrix(rotors.to_matrix(rotor))
    assert np.abs(back - rotor * np.where(rotor[:, :1] < 0, -1, 1)).max() < TIGHT


def test_awkward_rotations_survive_the_matrix(awkward):
    matrix = rotors.to_matrix(awkward)
    assert np.abs(matrix - scipy_rotation(awkward).as_matrix()).max() < TIGHT
    assert np.abs(rotors.to_matrix(rotors.from_matrix(matrix)) - matrix).max() < TIGHT


def test_half_turns_about_any_axis_survive_the_matrix():
    axes = some_directions(200)
    matrices = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    assert np.abs(rotors.to_matrix(rotors.from_matrix(matrices)) - matrices).max() < TIGHT


def test_length_and_sign_of_a_rotor_do_not_matter():
    rotor = some_rotors(9)[:, None, :] * np.array([1, -1, 1e-200, 1e200])[:, None]
    coefficients = np.random.default_rng(1).normal(size=(25, 3))
    for function in (rotors.to_matrix, lambda r: rotors.rotate(coefficients, r)):
        values = function(rotor)
        assert np.abs(values - values[:, :1]).max() < SH_TIGHT


# --- Products ----------------------------------------------------------------------------------------------------


def test_products_are_those_of_kingdon():
    algebra = kingdon.Algebra(3)
    a, b = np.random.default_rng(0).normal(size=(2, 20, 4))
    names = ("e", "e12", "e13", "e23")
    for left, right, product in zip(a, b, rotors.multiply(a, b), strict=True):
        expected = algebra.multivector(**dict(zip(names, left, strict=True)))
        expected = expected * algebra.multivector(**dict(zip(names, right, strict=True)))
        assert np.abs(product - [getattr(expected, name) for name in names]).max() < TIGHT


def test_the_product_turns_by_the_second_first():
    a, b = some_rotors(50, 1), some_rotors(50, 2)
    expected = (scipy_rotation(a) * scipy_rotation(b)).as_matrix()
    assert np.abs(rotors.to_matrix(rotors.multiply(a, b)) - expected).max() < TIGHT


def test_the_inverse_undoes_rotors_of_any_length():
    rotor = some_rotors(50) * np.geomspace(1e-3, 1e3, 50)[:, None]
    assert np.abs(rotors.multiply(rotor, rotors.inverse(rotor)) - rotors.IDENTITY).max() < TIGHT


def test_the_reverse_undoes_unit_rotors():
    rotor = some_rotors(50)
    assert np.abs(rotors.multiply(rotors.reverse(rotor), rotor) - rotors.IDENTITY).max() < TIGHT


def test_a_hundred_thousand_small_turns_do_not_drift():
    # The steps lead along a path known in closed form, about a changing axis and through many whole turns. Each step
    # and each product rounds by half an EPS in each of four numbers; at random that grows to sqrt(N) EPS
    # = 7e-14, and if all conspired to N EPS = 2e-11.
    time = np.linspace(0, 1, 100_001)[:, None]
    path = rotors.multiply(
        rotors.exp(40 * time * [0.3, -0.5, 0.81]), rotors.exp(np.sin(7 * time) * [1.0, 2.0, 0.5] + [0, 0, 0.4])
    )
    steps = rotors.multiply(path[1:], rotors.reverse(path[:-1]))
    chains = path[:1].repeat(2, axis=0)
    for step in steps:
        chains = rotors.multiply(step, chains)
        chains[0] /= np.sqrt(chains[0] @ chains[0])  # what `normalise` does, without the checks that take most of it
    kept, free = chains
    assert abs(np.linalg.norm(kept) - 1) < 2 * EPS
    assert abs(np.linalg.norm(free) - 1) < 1e-12
    for rotor in (kept, free):
        error = rotors.multiply(rotor, rotors.reverse(path[-1]))
        angle = 2 * np.linalg.norm(rotors.log(error * np.sign(error[0])))
        assert angle < 1e-12


def test_normalise_gives_length_one_at_any_scale():
    rotor = some_rotors(100) * np.geomspace(1e-300, 1e300, 100)[:, None]
    assert np.abs(np.linalg.norm(rotors.normalise(rotor), axis=1) - 1).max() < 2 * EPS


# --- Exponential, logarithm, between -----------------------------------------------------------------------------


def test_exp_turns_by_twice_the_bivector():
    bivector = np.random.default_rng(0).normal(size=(100, 3)) * np.geomspace(1e-12, 3, 100)[:, None]
    e12, e13, e23 = bivector.T
    expected = Rotation.from_rotvec(2 * np.stack([-e23, e13, -e12], axis=1)).as_matrix()
    assert np.abs(rotors.to_matrix(rotors.exp(bivector)) - expected).max() < TIGHT


def test_exp_undoes_log_on_both_sheets(awkward):
    for rotor in (awkward, -awkward):
        assert np.abs(rotors.exp(rotors.log(rotor)) - rotors.normalise(rotor)).max() < TIGHT


def test_log_undoes_exp_even_for_tiny_turns():
    # Down to 1e-140: squares below 1e-308 lose their digits.
    bivector = some_directions(200) * np.geomspace(1e-140, 3.1, 200)[:, None]
    size = np.linalg.norm(bivector, axis=1, keepdims=True)
    # Near a whole turn, pi, the rotor nears -1, and what remains of its plane is only as good as pi - |b|.
    tolerance = TIGHT * size / (np.pi - np.minimum(size, 3.1)) * np.pi
    assert (np.abs(rotors.log(rotors.exp(bivector)) - bivector) <= tolerance).all()


# --- Up to a normal ----------------------------------------------------------------------------------------------


def leaning(lean):
    """64 normals around (0, -1, 0), each leaning away from it by `lean`."""
    turn = 2 * np.pi * np.arange(64) / 64
    height = np.full(64, -np.sqrt(1 - lean**2))
    return np.stack([lean * np.cos(turn), height, lean * np.sin(turn)], axis=1)


@pytest.mark.parametrize("lean", [0.5, 1e-2, 1e-4, 1e-6, 1e-7, 1e-8, 1e-9, 1e-100, 1e-300])
def test_up_is_taken_to_normals_however_near_to_straight_down(lean):
    normals = leaning(lean)
    rotor = rotors.taking_up_to(normals)
    assert np.abs(np.linalg.norm(rotor, axis=1) - 1).max() < 2 * EPS
    assert np.abs(rotors.to_matrix(rotor)[:, :, 1] - normals).max() < TIGHT
    # ... and the lean itself, from the two numbers that hold it, to a few roundings of it: cos and sin of half
    # the turn multiply to half the lean.
    recovered = 2 * rotor[:, :1] * rotor[:, [1, 3]] * [1, -1]
    assert np.abs(recovered - normals[:, [0, 2]]).max() < 8 * EPS * lean


def test_up_is_taken_to_any_normal_the_short_way():
    normals = some_directions(1000)
    rotor = rotors.taking_up_to(4.0 * normals)
    assert np.abs(rotors.to_matrix(rotor)[:, :, 1] - normals).max() < TIGHT
    assert (rotor[:, 2] == 0).all()  # no turn about y
    angle = np.arccos(normals[:, 1])
    assert np.abs(2 * np.linalg.norm(rotors.log(rotor), axis=1) - angle).max() < 1e-13  # arccos loses digits at +-1


def test_straight_down_is_a_half_turn_about_x():
    expected = np.diag([1.0, -1.0, -1.0])
    for down in ([0, -1, 0], [0, -3, 0], [-0.0, -1, -0.0]):
        assert np.array_equal(rotors.to_matrix(rotors.taking_up_to(down)), expected)
    assert np.abs(rotors.to_matrix(rotors.taking_up_to([0, -1, 1e-12])) - expected).max() < 3e-12  # its limit


def test_straight_up_is_exactly_the_identity():
    assert np.array_equal(rotors.taking_up_to([0, 2, 0]), rotors.IDENTITY)


# --- Harmonics ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bands", range(1, 11))
def test_harmonics_turn_as_by_quadrature_and_as_scipys_at_turned_directions(bands):
    directions = some_directions(60)
    for rotor in some_rotors(8, bands):
        matrix = rotors.rotation_matrix(rotor, bands)
        turn = scipy_rotation(rotor).as_matrix()
        assert np.abs(matrix - harmonics.rotation_matrix(turn, bands)).max() < SH_TIGHT
        expected = scipy_basis(directions @ turn.T, bands)
        assert np.abs(scipy_basis(directions, bands) @ matrix.T - expected).max() < SH_TIGHT


def test_awkward_rotors_turn_harmonics_as_any_other(awkward):
    directions = some_directions(60)
    expected = scipy_basis(scipy_rotation(awkward).apply(directions), 10)
    turned = scipy_basis(directions, 10) @ rotors.rotation_matrix(awkward, 10).T
    # Directions 1e-12 from another move a function of degree 9 by 1e-11 at most; both sides see the same ones.
    assert np.abs(turned - expected).max() < SH_TIGHT


def test_turned_light_is_seen_in_the_turned_direction():
    coefficients = np.random.default_rng(0).normal(size=(100, 3))
    directions = some_directions(50)
    rotor = some_rotors(1)[0]
    turned = rotors.rotate(coefficients, rotor)
    seen = scipy_basis(scipy_rotation(rotor).apply(directions), 10) @ turned
    assert np.abs(seen - scipy_basis(directions, 10) @ coefficients).max() < 10 * SH_TIGHT  # sums of 100 such terms


def test_matrices_of_products_are_products_of_matrices():
    a, b = some_rotors(2)
    product = rotors.rotation_matrix(rotors.multiply(a, b), 10)
    expected = rotors.rotation_matrix(a, 10) @ rotors.rotation_matrix(b, 10)
    assert np.abs(product - expected).max() < SH_TIGHT


def test_turns_about_y_are_those_of_the_command_line():
    coefficients = np.random.default_rng(0).normal(size=(64, 3))
    expected = harmonics.rotate(coefficients, Rotation.from_rotvec([0, 0.7, 0]).as_matrix())
    assert np.abs(turned_about_y(coefficients, np.degrees(0.7)) - expected).max() < SH_TIGHT


def test_many_rotors_turn_many_lights_each_its_own():
    rng = np.random.default_rng(0)
    coefficients, rotor = rng.normal(size=(5, 16, 2)), some_rotors(5)
    turned = rotors.rotate(coefficients, rotor)
    for one, by, expected in zip(coefficients, rotor, turned, strict=True):
        assert np.abs(rotors.rotate(one, by) - expected).max() < SH_TIGHT
        assert np.abs(rotors.rotate(one[:, 0], by) - expected[:, 0]).max() < SH_TIGHT
    crossed = rotors.rotate(coefficients[:, None], rotor[:3])
    assert crossed.shape == (5, 3, 16, 2)
    assert np.abs(crossed[1, 1] - turned[1]).max() < SH_TIGHT
    assert rotors.rotation_matrix(rotor, 4).shape == (5, 16, 16)


# --- Refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("rotor", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [np.inf, 0, 0, 0]])
@pytest.mark.parametrize("function", [rotors.normalise, rotors.inverse, rotors.to_matrix, rotors.log, rotors.from_quat])
def test_rotors_without_a_direction_are_refused(function, rotor):
    with pytest.raises(InputError, match="finite and not 0, found"):
        function([rotors.IDENTITY, rotor])
    with pytest.raises(InputError, match="finite and not 0, found"):
        rotors.rotate(np.zeros((4, 3)), rotor)


@pytest.mark.parametrize("shape", [(), (3,), (4, 3)])
def test_rotors_of_another_shape_are_refused(shape):
    with pytest.raises(InputError, match=r"\(\.\.\., 4\), found"):
        rotors.normalise(np.ones(shape))


@pytest.mark.parametrize("matrix", [-np.eye(3), 2 * np.eye(3), np.full((3, 3), np.nan), np.diag([1, 1, -1.0])])
def test_matrices_that_are_no_rotation_are_refused(matrix):
    with pytest.raises(InputError, match="expected rotation matrices, found"):
        rotors.from_matrix([np.eye(3), matrix])


def test_matrices_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"\(\.\.\., 3, 3\), found \(4, 4\)"):
        rotors.from_matrix(np.eye(4))


@pytest.mark.parametrize("vector", [[0, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0]])
def test_axes_and_normals_without_a_direction_are_refused(vector):
    with pytest.raises(InputError, match="an axis must be finite and longer than 0"):
        rotors.from_axis_angle(vector, 1.0)
    with pytest.raises(InputError, match="a normal must be finite and longer than 0"):
        rotors.taking_up_to([[0, 1, 0], vector])


def test_axes_of_another_shape_are_refused():
    with pytest.raises(InputError, match=r"an axis must have shape \(\.\.\., 3\), found \(4,\)"):
        rotors.from_axis_angle([0, 0, 0, 1], 1.0)


def test_coefficients_and_rotors_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="one rotor"):
        rotors.rotate(np.zeros(9), some_rotors(2))
    with pytest.raises(InputError, match="do not share their leading axes"):
        rotors.rotate(np.zeros((3, 9, 1)), some_rotors(2))
    with pytest.raises(InputError, match="K = 1, 4, 9"):
        rotors.rotate(np.zeros((8, 3)), rotors.IDENTITY)
    with pytest.raises(InputError, match="from 1 to 10, found 11"):
        rotors.rotation_matrix(rotors.IDENTITY, 11)
