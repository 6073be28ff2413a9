"""Conformal algebra against kingdon's, motors against 4x4 matrices, vertex motors in hard places."""

import warnings

import kingdon
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from relight.sh import cga, rotors
from relight.sh.normals import unit_normals
from splat2mesh.base.errors import DataWarning, InputError

EPS = np.finfo(np.float64).eps
EPS32 = np.finfo(np.float32).eps
# A few roundings of numbers of size 1.
TIGHT = 16 * EPS
# One rounding of every number moves a motor by EPS32 / 2 of its length: the half from the rotor and the half from the
# translation add up in a point that is read back. A normal, quadratic in the rotor, moves by as much.
TIGHT32 = EPS32

NAMES = ["e" + "".join(map(str, blade)) for blade in cga.BLADES]
E_0 = np.eye(32)[5] / 2 - np.eye(32)[4] / 2
E_INF = np.eye(32)[4] + np.eye(32)[5]


@pytest.fixture(scope="module")
def algebra():
    return kingdon.Algebra(4, 1)


def of_kingdon(multivector):
    """Coefficients by name, so that nothing rests on kingdon's order."""
    return np.array([getattr(multivector, name) for name in NAMES], float)


def to_kingdon(algebra, multivector):
    return algebra.multivector(**dict(zip(NAMES, multivector, strict=True)))


def randoms(*shape, seed=0):
    return np.random.default_rng(seed).normal(size=shape)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def some_motors(count, seed=0, offset=1.0):
    """Motors and the matrices that SciPy makes of the same rotations and offsets."""
    rng = np.random.default_rng(seed)
    quat, shift = rng.normal(size=(count, 4)), offset * rng.normal(size=(count, 3))
    matrices = np.zeros((count, 4, 4))
    matrices[:, :3, :3] = Rotation.from_quat(quat, scalar_first=True).as_matrix()
    matrices[:, :3, 3], matrices[:, 3, 3] = shift, 1
    return cga.motor(rotors.from_quat(quat), shift), matrices


def transformed(matrices, points):
    return np.einsum("...ij,...j->...i", matrices[..., :3, :3], points) + matrices[..., :3, 3]


# --- The algebra -------------------------------------------------------------------------------------------------


def test_blades_are_canonical(algebra):
    assert NAMES == list(algebra.canon2bin)
    assert NAMES[:8] == ["e", "e1", "e2", "e3", "e4", "e5", "e12", "e13"]
    assert NAMES[-1] == "e12345"


def test_products_of_all_basis_blades_are_those_of_kingdon(algebra):
    basis = np.eye(32)
    products = cga.geometric_product(basis[:, None], basis[None])
    for a, left in enumerate(basis):
        for b, right in enumerate(basis):
            expected = to_kingdon(algebra, left) * to_kingdon(algebra, right)
            assert np.array_equal(products[a, b], of_kingdon(expected))


def test_products_reverses_and_sandwiches_are_those_of_kingdon(algebra):
    a, b = randoms(2, 5, 32)
    products, sandwiches = cga.geometric_product(a, b), cga.apply(a, b)
    for x, y, product, sandwich in zip(a, b, products, sandwiches, strict=True):
        p, q = to_kingdon(algebra, x), to_kingdon(algebra, y)
        assert np.array_equal(cga.reverse(x), of_kingdon(p.reverse()))
        assert np.abs(product - of_kingdon(p * q)).max() < 32 * TIGHT  # sums of 32 terms ...
        assert np.abs(sandwich - of_kingdon(p * q * p.reverse())).max() < 32 * 32 * TIGHT  # ... and of 32 of those


def test_null_vectors():
    for left, right, inner in ((E_0, E_0, 0), (E_INF, E_INF, 0), (E_0, E_INF, -1)):
        anticommutator = cga.geometric_product(left, right) + cga.geometric_product(right, left)
        assert np.array_equal(anticommutator, 2 * inner * np.eye(32)[0])


def test_points_are_null_and_their_products_are_distances():
    points = randoms(20, 3)
    ups = cga.up(points)
    assert np.abs(cga.geometric_product(ups, ups)).max() < TIGHT * np.abs(ups).max() ** 2
    inner = cga.geometric_product(ups[:, None], ups[None])[..., 0]
    distance = np.linalg.norm(points[:, None] - points[None], axis=-1)
    assert np.abs(inner + 0.5 * distance**2).max() < TIGHT * np.abs(ups).max() ** 2


def test_points_come_back_at_any_scale_and_weight():
    for scale in (1e-6, 1.0, 1e3, 1e6):
        points = scale * randoms(50, 3)
        weights = np.geomspace(1e-3, 1e3, 50)[:, None]
        # The weight 1 is the difference of two numbers of size |x|^2 / 2 + 1/2, each of them rounded.
        tolerance = 2 * EPS * (1 + (points**2).sum(axis=1, keepdims=True)) * scale
        assert (np.abs(cga.down(weights * cga.up(points)) - points) <= 5 * tolerance).all()


# --- Motors ------------------------------------------------------------------------------------------------------


def test_motors_are_translator_times_rotor(algebra):
    rotor, shift = unit(randoms(10, 4)), randoms(10, 3, seed=1)
    infinity = to_kingdon(algebra, E_INF)
    for r, t, motor in zip(rotor, shift, cga.motor(rotor, shift), strict=True):
        turn = algebra.multivector(e=r[0], e12=r[1], e13=r[2], e23=r[3])
        move = 1 - 0.5 * algebra.vector([*t, 0, 0]) * infinity
        assert np.abs(motor - of_kingdon(move * turn)).max() < TIGHT


def test_motors_move_points_as_matrices_do():
    motors, matrices = some_motors(50)
    points = randoms(50, 3, seed=5)
    expected = transformed(matrices, points)
    assert np.abs(cga.to_matrix(motors) - matrices).max() < TIGHT
    assert np.abs(cga.move(motors, points) - expected).max() < TIGHT
    # Coordinates up to 3, |x|^2 / 2 to 30, and two sandwiched products of such numbers.
    assert np.abs(cga.down(cga.apply(motors, cga.up(points))) - expected).max() < 1e-12


def test_composed_motors_move_points_as_products_of_matrices_do():
    (a, matrices_a), (b, matrices_b) = some_motors(50, 1), some_motors(50, 2)
    expected = transformed(matrices_a @ matrices_b, randoms(50, 3))
    moved = cga.move(cga.geometric_product(a, b), randoms(50, 3))
    assert np.abs(moved - expected).max() < 4 * TIGHT  # offsets up to 4


@pytest.mark.parametrize("offset", [1e-6, 1e6])
def test_movement_keeps_its_digits_at_any_offset(offset):
    a, matrices_a = some_motors(50, 1, offset)
    points = offset * randoms(50, 3)
    assert np.abs(cga.move(a, points) - transformed(matrices_a, points)).max() < TIGHT * offset


def test_inverses_undo_motors():
    motors, _ = some_motors(50, offset=100.0)
    points = randoms(50, 3)
    assert np.abs(cga.move(cga.inverse(motors), cga.move(motors, points)) - points).max() < 400 * TIGHT  # offsets 400
    assert np.abs(cga.inverse(motors) - cga.reverse(motors)).max() < 100 * TIGHT


def test_rotor_and_translation_come_back_from_motors_of_any_length():
    rotor, shift = unit(randoms(50, 4)), randoms(50, 3, seed=1)
    back_rotor, back_shift = cga.rotor_and_translation(-3.0 * cga.motor(rotor, shift))
    assert np.abs(back_rotor + rotor).max() < TIGHT
    assert np.abs(back_shift - shift).max() < TIGHT


def test_normals_turn_and_planes_keep_their_points():
    motors, matrices = some_motors(50)
    points, normals = randoms(50, 3, seed=5), unit(randoms(50, 3, seed=6))
    planes = cga.plane(normals, np.sum(points * normals, axis=1))
    moved = cga.apply(motors, planes)
    turned = np.einsum("nij,nj->ni", matrices[:, :3, :3], normals)
    distance = np.sum(turned * transformed(matrices, points), axis=1)
    assert np.abs(moved - cga.plane(turned, distance)).max() < 1e-13
    assert np.abs(cga.apply(motors, cga.plane(normals))[:, cga.EUCLIDEAN] - turned).max() < 1e-13
    moved_points = cga.up(transformed(matrices, points))
    incidence = cga.geometric_product(moved, moved_points) + cga.geometric_product(moved_points, moved)
    assert np.abs(incidence[:, 0]).max() < 1e-12


# --- Vertex motors -----------------------------------------------------------------------------------------------


def hard_vertices(offset=0.0, scale=1.0):
    """Vertices with normals all over the sphere and thickly about both poles, down to leans of 1e-8."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(2000, 3))
    normals[::2, [0, 2]] *= np.geomspace(1e-8, 1, 1000)[:, None] / np.abs(normals[::2, 1:2])
    return (offset + scale * rng.normal(size=(2000, 3))).astype(np.float32), unit(normals).astype(np.float32)


def test_vertex_motors_are_translator_times_one_plus_n_e2(algebra):
    points, normals = hard_vertices()
    rows = np.flatnonzero(normals[:, 1] > -0.99)[:40]  # below, 1 + n e2 cancels
    motors = cga.vertex_motors(points, normals)
    infinity = to_kingdon(algebra, E_INF)
    for row in rows:
        turn = 1 + algebra.vector([*normals[row].astype(float), 0, 0]) * algebra.blades["e2"]
        turn = turn / np.sqrt((turn * turn.reverse()).e)
        motor = (1 - 0.5 * algebra.vector([*points[row].astype(float), 0, 0]) * infinity) * turn
        assert np.abs(motors[row] - of_kingdon(motor)).max() < TIGHT32


@pytest.mark.parametrize(("offset", "scale"), [(0, 1), (0, 1e-6), (0, 1e6), (1e6, 1), (-1e6, 1e-3)])
def test_vertex_motors_keep_points_and_normals_to_a_rounding(offset, scale):
    points, normals = hard_vertices(offset, scale)
    matrices = cga.to_matrix(cga.vertex_motors(points, normals))
    length = np.linalg.norm(points.astype(float), axis=1, keepdims=True)
    assert (np.abs(matrices[:, :3, 3] - points) < TIGHT32 * length).all()
    assert np.abs(matrices[:, :3, 1] - normals).max() < 2 * TIGHT32  # unit_normals rounds them once more
    moved = cga.move(cga.vertex_motors(points, normals), [0.0, 1.0, 0.0])
    assert (np.abs(moved - points - normals) < TIGHT32 * (2 + length)).all()


@pytest.mark.parametrize(("offset", "scale"), [(0, 1), (0, 1e-6), (1e6, 1)])
def test_the_compiled_kernel_rounds_its_readable_twin_once(offset, scale):
    points, normals = hard_vertices(offset, scale)
    motors = cga.vertex_motors(points, normals)
    expected = cga.motor(rotors.taking_up_to(unit_normals(normals)), points)
    # One rounding of each number, plus what cancels in float64 in sums of products with the point.
    slack = 8 * EPS * (1 + np.abs(points).max(axis=1, keepdims=True))
    assert (np.abs(motors - expected) <= 0.5 * EPS32 * np.abs(expected) + slack).all()


@pytest.mark.parametrize("lean", [1e-3, 1e-6, 1e-7, 1e-8, 1e-20, 1e-44, 0.0])
def test_normals_about_straight_down(lean):
    turn = 2 * np.pi * np.arange(64) / 64
    normals = np.stack([lean * np.cos(turn), np.full(64, -1.0), lean * np.sin(turn)], axis=1)
    rotor, shift = cga.rotor_and_translation(cga.vertex_motors(randoms(64, 3), normals))
    assert np.abs(shift - randoms(64, 3)).max() < 4 * TIGHT32
    # Half a turn about a horizontal axis, at right angles to the lean: the axis is not lost, however small the lean.
    rounded = normals.astype(np.float32).astype(float)  # 1e-44 keeps three bits in float32
    axis = np.where(np.hypot(rounded[:, 0], rounded[:, 2])[:, None] > 0, rounded[:, [2, 0]] * [1, -1], [1.0, 0.0])
    axis = axis / np.hypot(*axis.T)[:, None]
    quat = rotors.to_quat(rotor)
    assert np.abs(quat[:, [1, 3]] - axis * np.cos(lean / 2)).max() < TIGHT32
    assert np.abs(quat[:, 0] - np.sin(np.hypot(rounded[:, 0], rounded[:, 2]) / 2)).max() < TIGHT32
    assert np.array_equal(quat[:, 2], np.zeros(64))


def test_exactly_straight_down_is_a_half_turn_about_x():
    motor = cga.vertex_motors(np.zeros((1, 3)), [[0, -1, 0]])[0]
    assert np.array_equal(motor, -np.eye(32, dtype=np.float32)[NAMES.index("e23")])


DEGENERATE = [[0, 0, 0], [1e-40, 0, 0], [np.nan, 0, 1], [np.inf, 0, 0], [9e-7, 0, 0]]


def test_degenerate_normals_face_up_and_are_counted():
    points, normals = hard_vertices()
    expected = cga.vertex_motors(points, normals)
    broken = normals.copy()
    broken[10:15] = DEGENERATE
    with pytest.warns(DataWarning, match="^5 of 2000 vertices have no normal"):
        motors = cga.vertex_motors(points, broken)
    rest = np.delete(np.arange(2000), np.arange(10, 15))
    assert np.array_equal(motors[rest], expected[rest])
    assert np.array_equal(motors[10:15], cga.vertex_motors(points[10:15], [[0, 1, 0]] * 5))
    assert (motors[10:15, cga.ROTOR] == rotors.IDENTITY).all()


def test_good_normals_of_any_length_raise_no_warning():
    points, normals = hard_vertices()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # A power of two changes no bit of the unit normal.
        assert np.array_equal(cga.vertex_motors(points, 1024 * normals), cga.vertex_motors(points, normals))


def test_motors_of_vertices_do_not_depend_on_their_neighbours():
    points, normals = hard_vertices()
    order = np.random.default_rng(1).permutation(2000)
    motors = cga.vertex_motors(points, normals)
    assert np.array_equal(cga.vertex_motors(points[order], normals[order]), motors[order])
    assert np.array_equal(cga.vertex_motors(points[::7], normals[::7]), motors[::7])
    assert motors.dtype == np.float32
    assert cga.vertex_motors(np.zeros((0, 3)), np.zeros((0, 3))).shape == (0, 32)


def test_twelve_numbers_of_a_motor_differ_from_zero_and_eight_are_independent():
    motors, _ = some_motors(200)
    used = np.flatnonzero(np.abs(motors).max(axis=0))
    assert [NAMES[i] for i in used] == "e e12 e13 e14 e15 e23 e24 e25 e34 e35 e1234 e1235".split()
    assert np.linalg.matrix_rank(motors) == 8


def test_eleven_numbers_of_a_vertex_motor_differ_from_zero_and_seven_are_independent():
    motors = cga.vertex_motors(*hard_vertices())
    used = np.flatnonzero(np.abs(motors).max(axis=0))
    assert [NAMES[i] for i in used] == "e e12 e14 e15 e23 e24 e25 e34 e35 e1234 e1235".split()
    assert np.linalg.matrix_rank(motors.astype(float)) == 7


def test_points_of_any_type_of_number_serve():
    points = np.arange(12).reshape(4, 3)
    expected = cga.vertex_motors(points.astype(np.float32), np.ones((4, 3)))
    for dtype in (int, np.uint8, np.float16, ">f4", float):
        assert np.array_equal(cga.vertex_motors(points.astype(dtype), np.ones((4, 3))), expected)


# --- Refusals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shapes", [((5, 3), (4, 3)), ((3,), (3,)), ((5, 2), (5, 2))])
def test_vertices_whose_arrays_do_not_fit_are_refused(shapes):
    with pytest.raises(InputError, match=r"must both have shape \(V, 3\), found"):
        cga.vertex_motors(np.ones(shapes[0]), np.ones(shapes[1]))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e39])
def test_points_that_are_not_finite_in_float32_are_refused(value):
    points = np.zeros((9, 3))
    points[4, 1] = value
    with pytest.raises(InputError, match="1 of 9 points are not finite"):
        cga.vertex_motors(points, np.ones((9, 3)))


@pytest.mark.parametrize(
    "multivector",
    [np.zeros(32), np.eye(32)[1], E_INF, np.ones(32), np.full(32, np.nan), np.eye(32)[0] + np.eye(32)[8]],
)
def test_multivectors_that_are_no_motors_are_refused(multivector):
    good = cga.motor(rotors.IDENTITY, [1, 2, 3])
    for function in (cga.rotor_and_translation, cga.to_matrix, cga.inverse):
        with pytest.raises(InputError, match="1 of 2 multivectors are not motors"):
            function([good, multivector])


def test_the_equal_pair_without_a_translation_behind_it_is_refused():
    # e1234 + e1235 beside the scalar alone: twelve right places, yet it moves points off Euclidean space.
    multivector = np.eye(32)[0] + np.eye(32)[NAMES.index("e1234")] + np.eye(32)[NAMES.index("e1235")]
    with pytest.raises(InputError, match="1 of 1 multivectors are not motors"):
        cga.rotor_and_translation(multivector)


def test_points_at_infinity_are_refused():
    with pytest.raises(InputError, match="1 of 2 multivectors have no finite point"):
        cga.down([E_0, E_INF])


def test_arrays_of_another_width_are_refused():
    for function in (cga.up, cga.plane, lambda p: cga.move(np.eye(32)[0], p)):
        with pytest.raises(InputError, match=r"\(\.\.\., 3\), found \(4,\)"):
            function(np.zeros(4))
    for function in (cga.down, cga.reverse, cga.rotor_and_translation, lambda m: cga.apply(m, m)):
        with pytest.raises(InputError, match=r"\(\.\.\., 32\), found \(16,\)"):
            function(np.zeros(16))
