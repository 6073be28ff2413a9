"""A mesh that its Gaussians carry: rigid motions to a rounding, what rests to the bit, smooth bends, tears."""

from dataclasses import replace

import numpy as np
import pytest
from moving_meshes import ball, grid, mesh
from scipy.spatial.transform import Rotation

from relight.splats.binding import Binding
from relight.transfer.precomputed import PosedPrecomputed, Precomputed
from relight.transfer.settings import Settings
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import Splats

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
TABLE, BALL = 0, 1


def table_scene():
    return Scene([mesh(*grid(24)), mesh(*ball(0.3, [-0.3, 0.31, 0.1]))], scene_from_splat=FLIP)


def flat(points, turns):
    """A flat Gaussian at every point, about as wide as an edge."""
    count = len(points)
    scales = np.tile([0.04, 0.04, 0.002], (count, 1))
    return Splats(points, scales, turns, np.full(count, 0.9), np.zeros((count, 1, 3)))


def splats_of(scene):
    """One on every place of the mesh, and which of them are the ball's."""
    _, rows = np.unique(scene.vertices, axis=0, return_index=True)
    points, normals = scene.vertices[rows] @ FLIP[:3, :3], scene.normals[rows] @ FLIP[:3, :3]
    turns = [Rotation.align_vectors([normal], [[0.0, 0.0, 1.0]])[0].as_quat(scalar_first=True) for normal in normals]
    return flat(points, turns), rows >= len(scene.chunks[TABLE].vertices)


def table():
    """A table, and the splats on it."""
    scene = Scene([mesh(*grid(40))])
    return scene, flat(scene.vertices.astype(float), np.tile([0.7, 0.7, 0.0, 0.0], (1600, 1)))


@pytest.fixture(scope="module")
def bound():
    scene = table_scene()
    splats, of_ball = splats_of(scene)
    return scene, splats, of_ball, Binding(splats, scene, views=())


def moved(splats, rows, rotation, shift):
    means, quats = splats.means.astype(float), splats.quats_wxyz.astype(float)
    means[rows] = rotation.apply(means[rows]) + shift
    quats[rows] = (rotation * Rotation.from_quat(quats[rows], scalar_first=True)).as_quat(scalar_first=True)
    return replace(splats, means=means, quats_wxyz=quats)


@pytest.mark.parametrize(
    ("turn", "shift"), [((0, 0, 0), (0.5, 0, 0.1)), ((0, 100, 0), (0, -0.5, 0)), ((170, 20, 60), (0.3, -0.8, 0.2))]
)
def test_a_rigid_motion_carries_the_mesh_as_by_hand(bound, turn, shift):
    scene, splats, of_ball, binding = bound
    rotation, flip = Rotation.from_euler("xyz", turn, degrees=True), FLIP[:3, :3]
    found = binding.carried.at(moved(splats, of_ball, rotation, shift)).scene(scene)
    np.testing.assert_array_equal(found.chunks[TABLE].vertices, scene.chunks[TABLE].vertices)
    np.testing.assert_array_equal(found.chunks[TABLE].normals, scene.chunks[TABLE].normals)
    body = scene.chunks[BALL]
    by_hand = (rotation.apply(body.vertices @ flip) + shift) @ flip
    np.testing.assert_allclose(found.chunks[BALL].vertices, by_hand, atol=2e-6)  # roundings of float32 at about 1
    np.testing.assert_allclose(found.chunks[BALL].normals, rotation.apply(body.normals @ flip) @ flip, atol=1e-5)
    assert len(found.faces) == len(scene.faces)


def test_it_sees_what_a_mesh_moved_by_hand_sees(bound):
    scene, splats, of_ball, binding = bound
    rotation, shift = Rotation.from_euler("y", 40, degrees=True), np.array([0.3, 0.0, 0.0])
    carried = binding.carried.at(moved(splats, of_ball, rotation, shift)).scene(scene)
    flip, body = FLIP[:3, :3], scene.chunks[BALL]
    points, normals = (rotation.apply(each @ flip).astype(np.float32) for each in (body.vertices, body.normals))
    hand = replace(body, vertices=((points + shift) @ flip).astype(np.float32), normals=normals @ flip)
    by_hand = replace(scene, chunks=[scene.chunks[TABLE], hand])
    settings, first = Settings("raytraced", 4, 32), Precomputed(scene, 0)
    found, expected, before = (
        each.transfer(settings)[0]
        for each in (PosedPrecomputed(first, carried), PosedPrecomputed(first, by_hand), first)
    )
    # A ray that grazes may fall to either side of an edge by a rounding.
    assert np.abs(found - expected).mean() < 1e-3 * np.abs(before - expected).mean()


def test_what_rests_and_shakes_keeps_every_bit(bound):
    scene, splats, _, binding = bound
    shake = 0.9 / np.sqrt(3.0) * 0.04 * np.random.default_rng(0).uniform(-1, 1, splats.means.shape)
    mesh = binding.carried.at(replace(splats, means=splats.means + shake))
    assert not mesh.pose.moved.any() and not mesh.pose.torn(binding.surface.faces).any()
    np.testing.assert_array_equal(mesh.scene(scene).vertices, scene.vertices)


def test_a_bend_is_followed_smoothly():
    scene, splats = table()
    points = scene.vertices.astype(float)

    def bent(at):
        return np.stack([at[:, 0], at[:, 1] + 0.3 * at[:, 0] ** 2, at[:, 2]], axis=1)

    then = Binding(splats, scene, views=()).carried.at(replace(splats, means=bent(points)))
    assert not then.pose.torn(then.first.faces).any()
    rows, found = then.pose.moved[then.first.node], then.scene(scene)
    np.testing.assert_allclose(found.vertices[rows], bent(points)[rows], atol=0.01)  # a quarter of a splat
    slope = np.stack([-0.6 * points[:, 0], np.ones(len(points)), np.zeros(len(points))], axis=1)
    slope /= np.linalg.norm(slope, axis=1, keepdims=True)
    inside = rows & (np.abs(points[:, [0, 2]]).max(axis=1) < 0.95)
    assert np.einsum("ij,ij->i", found.normals[inside], slope[inside]).min() > np.cos(np.radians(5.0))


def test_faces_between_what_moves_and_what_rests_tear():
    scene, splats = table()
    half = scene.vertices[:, 0] > 0.0
    lifted = replace(splats, means=splats.means + np.where(half[:, None], [0.0, 0.5, 0.0], 0.0))
    then = Binding(splats, scene, views=()).carried.at(lifted).scene(scene)
    np.testing.assert_allclose(then.vertices[:, 1], 0.5 * half, atol=1e-6)  # and none hangs between
    across = half[scene.faces].any(axis=1) & ~half[scene.faces].all(axis=1)
    assert len(then.faces) == (~across).sum() and across.sum() == 78
