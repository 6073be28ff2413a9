"""The network on skinned meshes in Unity, run by Mono: motors, turned light and vertex colours, against Python."""

import numpy as np
import pytest
from lit_ball import ball_scene
from mono import compiled, ran, rows
from network_file import network_bytes
from scipy.spatial.transform import Rotation

from relight import Environment
from relight.output.lamps_glb import ShownLight
from relight.output.live_glb import write_live_glb
from relight.sh import cga, harmonics
from relight.transfer.neuralgash import UnitFrame, neural_gash, unit_points

MIRROR = np.array([-1.0, 1.0, 1.0])
"""Between Unity's left-handed axes and ours."""

EXPOSURE, ANGLE_DEG = 0.5, 20.0
NONE = (0.0, 0.0, 0.0, 1.0)
WHITE = (1.0, 1.0, 1.0)

ERROR = 5e-5
"""Of radiance, relative to the brightest: weights of 16 bits and sums of float32, 6e-6 measured."""


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    return compiled(tmp_path_factory.mktemp("unity"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """StreamingAssets: a light, and the network as the exporter writes it."""
    place = tmp_path_factory.mktemp("assets")
    (place / "neural-gash.bin").write_bytes(network_bytes())
    scene, albedo = ball_scene(4)
    nine = np.zeros((len(albedo), 9), np.float32), np.zeros((len(albedo), 3), np.float32)
    write_live_glb(place / "live.glb", scene, albedo, nine, ShownLight(light().rotated(ANGLE_DEG), EXPOSURE))
    return place


def light():
    return Environment.load("studio")


def poses(count=60, seed=4):
    """Rest and pose of a body with no symmetry, in our frame: (positions, normals) each (V, 3) float32."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(2):
        points = rng.normal(size=(count, 3)) * [1.0, 0.5, 2.0] + [3.0, 1.0, -2.0]
        normals = rng.normal(size=(count, 3))
        found.append((points.astype(np.float32), normals.astype(np.float32)))
    return found


def text(*arrays):
    return "\n".join(" ".join(map(str, each.ravel().tolist())) for each in arrays)


def shaded(program, folder, turn=NONE, axis=(0.0, 1.0, 0.0), angle=0.0, stops=0.0, albedo=WHITE):
    """Vertex colours of the second pose, (V, 3), as the component writes them."""
    given = [np.hstack([points * MIRROR, normals * MIRROR]) for points, normals in poses()]
    (folder / "poses.txt").write_text(text(*given))
    done = ran(program, "skinned", folder, folder / "poses.txt", *turn, *axis, angle, stops, *albedo)
    assert done.returncode == 0, done.stderr
    return rows(done.stdout, 3)


def expected(sh):
    """Exposed radiance of the second pose by Python under coefficients (9, 3) in the frame of the object."""
    (rest, _), (points, normals) = poses()
    transfer = neural_gash(points, normals, frame=UnitFrame.of(rest))
    return EXPOSURE * np.maximum(transfer @ sh, 0.0)


def test_the_colours_are_the_radiance_of_python(program, folder):
    found = shaded(program, folder)
    known = expected(light().rotated(ANGLE_DEG).sh(3))
    np.testing.assert_allclose(found, known, atol=ERROR * known.max())
    mirrored = neural_gash(poses()[1][0] * MIRROR, poses()[1][1] * MIRROR, frame=UnitFrame.of(poses()[0][0] * MIRROR))
    wrong = EXPOSURE * np.maximum(mirrored @ light().rotated(ANGLE_DEG).sh(3), 0.0)
    assert np.abs(wrong - known).max() > 0.1 * known.max()  # an axis that is not flipped would be seen


def test_an_object_that_turns_with_the_light_keeps_its_colours(program, folder):
    axis = np.array([2.0, -1.0, 0.5])
    # Unity's AngleAxis is clockwise where the axis points at you.
    turn = np.r_[axis / np.linalg.norm(axis) * np.sin(np.radians(-35.0)), np.cos(np.radians(-35.0))]
    known = shaded(program, folder)
    found = shaded(program, folder, turn, axis, 70.0)
    np.testing.assert_allclose(found, known, atol=1e-6 * known.max())


def test_the_light_turns_against_the_object(program, folder):
    turn = np.array([0.3, -0.5, 0.7, 0.4])
    turn /= np.linalg.norm(turn)
    in_unity = Rotation.from_quat(turn).as_matrix()  # the same formula, whatever the hand
    ours = np.diag(MIRROR) @ in_unity @ np.diag(MIRROR)
    axis = np.array([0.2, 1.0, -3.0])
    turned = Rotation.from_rotvec(np.radians(110.0) * MIRROR * axis / np.linalg.norm(axis)).as_matrix()
    sh = harmonics.rotation_matrix(ours.T @ turned, 3) @ light().rotated(ANGLE_DEG).sh(3)
    found = shaded(program, folder, turn, axis, 110.0, 1.0, (0.5, 0.25, 1.0))
    known = expected(sh) * 2.0 * [0.5, 0.25, 1.0]
    np.testing.assert_allclose(found, known, atol=ERROR * known.max())


def test_motors_are_those_of_python(program, tmp_path):
    rng = np.random.default_rng(2)
    points = (rng.normal(size=(200, 3)) * 10.0 + 100.0).astype(np.float32)
    normals = rng.normal(size=(200, 3)).astype(np.float32)
    normals[:6] = [[0, -1, 0], [0, 1, 0], [1e-4, -1, 0], [0, -1, -1e-4], [3, 0, 0], [0, -7, 1e-20]]
    (tmp_path / "points.txt").write_text(text(points))
    (tmp_path / "normals.txt").write_text(text(normals))
    done = ran(program, "motors", tmp_path / "points.txt", tmp_path / "normals.txt")
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(rows(done.stdout, 32), cga.vertex_motors(unit_points(points), normals), atol=1.2e-7)
    (tmp_path / "normals.txt").write_text(text(np.zeros((200, 3))))
    done = ran(program, "motors", tmp_path / "points.txt", tmp_path / "normals.txt")
    up = cga.vertex_motors(unit_points(points), np.tile([0.0, 1.0, 0.0], (200, 1)))
    np.testing.assert_allclose(rows(done.stdout, 32), up, atol=1.2e-7)


@pytest.mark.parametrize("axis", [(0, 1, 0), (1, 0, 0), (-0.3, 2.0, 5.0)])
def test_light_turns_as_by_quadrature(program, axis):
    sh = np.random.default_rng(1).normal(size=(9, 3))
    done = ran(program, "turned", *axis, 130.0, *sh.ravel())
    turn = Rotation.from_rotvec(np.radians(130.0) * np.array(axis) / np.linalg.norm(axis)).as_matrix()
    np.testing.assert_allclose(rows(done.stdout, 3), harmonics.rotation_matrix(turn, 3) @ sh, atol=1e-12)


@pytest.mark.parametrize("kept", [3, 11, 40, -1])
def test_a_network_that_is_cut_short_is_refused_in_one_line(program, folder, tmp_path, kept):
    (tmp_path / "live.glb").write_bytes((folder / "live.glb").read_bytes())
    (tmp_path / "neural-gash.bin").write_bytes((folder / "neural-gash.bin").read_bytes()[:kept])
    (tmp_path / "poses.txt").write_text("0 0 0 0 1 0 0 0 0 0 1 0")
    done = ran(program, "skinned", tmp_path, tmp_path / "poses.txt", *NONE, 0, 1, 0, 0, 0, 1, 1, 1)
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert done.stderr.startswith("Relight: neural-gash.bin: ")
