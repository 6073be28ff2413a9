"""The parts of the way of places by themselves: far background."""

import numpy as np

from splat2mesh.scene.mesh import Mesh
from splat2mesh.surface.place import parted


def grid(count, shift=(0.0, 0.0, 0.0)):
    """A level square of count x count quads of side 1: points (V, 3) float32, faces (F, 3) int32."""
    x, z = np.meshgrid(np.arange(count + 1), np.arange(count + 1), indexing="ij")
    points = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3) + np.asarray(shift)
    index = np.arange(len(points)).reshape(count + 1, count + 1)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
    return points.astype(np.float32), quads[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3).astype(np.int32)


def together(*parts):
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    return (
        np.concatenate([points for points, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=True)]).astype(np.int32),
    )


def test_a_mesh_parted_by_a_ball_is_whole_together_and_shares_no_face():
    points, faces = together(grid(10), grid(10, (100.0, 0.0, 0.0)))
    colors = np.arange(len(points) * 3).reshape(-1, 3).astype(np.uint8)
    mesh = Mesh(points, np.tile(np.float32([0, 1, 0]), (len(points), 1)), faces, colors)
    near, far = parted(mesh, np.zeros(3), 30.0)
    assert far is not None and len(near.faces) + len(far.faces) == len(faces)
    for part, rows in ((near, slice(0, 121)), (far, slice(121, 242))):
        np.testing.assert_array_equal(part.vertices, points[rows])
        np.testing.assert_array_equal(part.colors_srgb, colors[rows])
    # A face that reaches into the ball is near.
    near, far = parted(mesh, np.zeros(3), 5.0)
    reaching = (np.linalg.norm(mesh.vertices, axis=1) <= 5.0)[mesh.faces].any(axis=1)
    assert far is not None and len(near.faces) == reaching.sum() and len(far.faces) == (~reaching).sum()
    for radius in (0.0, 1000.0):  # all of it beyond, but for the corner in the middle, or none
        near, far = parted(mesh, np.array([0.0, 1.0, 0.0]), radius)
        assert near is mesh and far is None
