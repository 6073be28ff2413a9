"""Vertex motors against kingdon's algebra and a readable twin, in hard places."""

import warnings

import kingdon
import numpy as np
import pytest
from motors import MOMENT, ROTOR, TWIN, motor, taken_apart, up_to

from relight.sh import cga
from relight.sh.normals import unit_normals
from splat2mesh.base.errors import DataWarning, InputError

EPS = np.finfo(np.float64).eps
EPS32 = np.finfo(np.float32).eps
# One rounding of every number moves a motor by EPS32 / 2 of its length: the half from the rotor and the half from the
# translation add up in a point that is read back. A normal, quadratic in the rotor, moves by as much.
TIGHT32 = EPS32

ALGEBRA = kingdon.Algebra(4, 1)
NAMES = list(ALGEBRA.canon2bin)
"""Blades in the documented order: grade by grade, lexicographic."""


def of_kingdon(multivector):
    return np.array([getattr(multivector, name) for name in NAMES], float)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def test_the_twelve_places_are_those_of_a_motor():
    assert [NAMES[i] for i in ROTOR] == ["e", "e12", "e13", "e23"]
    assert [NAMES[i] for i in MOMENT] == ["e14", "e24", "e34", "e1234"]
    assert [NAMES[i] for i in TWIN] == ["e15", "e25", "e35", "e1235"]


def hard_vertices(offset=0.0, scale=1.0):
    """Vertices with normals all over the sphere and thickly about both poles, down to leans of 1e-8."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(2000, 3))
    normals[::2, [0, 2]] *= np.geomspace(1e-8, 1, 1000)[:, None] / np.abs(normals[::2, 1:2])
    return (offset + scale * rng.normal(size=(2000, 3))).astype(np.float32), unit(normals).astype(np.float32)


def test_vertex_motors_are_translator_times_one_plus_n_e2():
    points, normals = hard_vertices()
    rows = np.flatnonzero(normals[:, 1] > -0.99)[:40]  # below, 1 + n e2 cancels
    motors = cga.vertex_motors(points, normals)
    infinity = ALGEBRA.vector([0, 0, 0, 1, 1])
    for row in rows:
        turn = 1 + ALGEBRA.vector([*normals[row].astype(float), 0, 0]) * ALGEBRA.blades["e2"]
        turn = turn / np.sqrt((turn * turn.reverse()).e)
        expected = (1 - 0.5 * ALGEBRA.vector([*points[row].astype(float), 0, 0]) * infinity) * turn
        assert np.abs(motors[row] - of_kingdon(expected)).max() < TIGHT32


@pytest.mark.parametrize(("offset", "scale"), [(0, 1), (0, 1e-6), (0, 1e6), (1e6, 1), (-1e6, 1e-3)])
def test_vertex_motors_keep_points_and_normals_to_a_rounding(offset, scale):
    points, normals = hard_vertices(offset, scale)
    turn, shift = taken_apart(cga.vertex_motors(points, normals))
    length = np.linalg.norm(points.astype(float), axis=1, keepdims=True)
    assert (np.abs(shift - points) < TIGHT32 * length).all()
    assert np.abs(turn.apply([0.0, 1.0, 0.0]) - normals).max() < 2 * TIGHT32  # unit_normals rounds them once more


@pytest.mark.parametrize(("offset", "scale"), [(0, 1), (0, 1e-6), (1e6, 1)])
def test_the_compiled_kernel_rounds_its_readable_twin_once(offset, scale):
    points, normals = hard_vertices(offset, scale)
    motors = cga.vertex_motors(points, normals)
    expected = motor(up_to(unit_normals(normals).astype(float)), points.astype(float))
    # One rounding of each number, plus what cancels in float64 in sums of products with the point.
    slack = 8 * EPS * (1 + np.abs(points).max(axis=1, keepdims=True))
    assert (np.abs(motors - expected) <= 0.5 * EPS32 * np.abs(expected) + slack).all()


@pytest.mark.parametrize("lean", [1e-3, 1e-6, 1e-7, 1e-8, 1e-20, 1e-44, 0.0])
def test_normals_about_straight_down(lean):
    turn = 2 * np.pi * np.arange(64) / 64
    normals = np.stack([lean * np.cos(turn), np.full(64, -1.0), lean * np.sin(turn)], axis=1)
    points = np.random.default_rng(0).normal(size=(64, 3))
    rotation, shift = taken_apart(cga.vertex_motors(points, normals))
    assert np.abs(shift - points).max() < 4 * TIGHT32
    # Half a turn about a horizontal axis, at right angles to the lean: the axis is not lost, however small the lean.
    rounded = normals.astype(np.float32).astype(float)  # 1e-44 keeps three bits in float32
    axis = np.where(np.hypot(rounded[:, 0], rounded[:, 2])[:, None] > 0, rounded[:, [2, 0]] * [1, -1], [1.0, 0.0])
    axis = axis / np.hypot(*axis.T)[:, None]
    quat = rotation.as_quat(scalar_first=True)
    assert np.abs(quat[:, [1, 3]] - axis * np.cos(lean / 2)).max() < TIGHT32
    assert np.abs(quat[:, 0] - np.sin(np.hypot(rounded[:, 0], rounded[:, 2]) / 2)).max() < TIGHT32
    assert np.array_equal(quat[:, 2], np.zeros(64))


def test_exactly_straight_down_is_a_half_turn_about_x():
    found = cga.vertex_motors(np.zeros((1, 3)), [[0, -1, 0]])[0]
    assert np.array_equal(found, -np.eye(32, dtype=np.float32)[NAMES.index("e23")])


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
    assert (motors[10:15][:, ROTOR] == [1, 0, 0, 0]).all()


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
