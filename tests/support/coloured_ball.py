"""A ball whose colours change from place to place: its scene, its splats, and two lights on it."""

import numpy as np

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

TILT = np.array([[1, 0, 0, 0.5], [0, -1, 0, 0.25], [0, 0, -1, -2], [0, 0, 0, 1.0]])  # exact in floating point


def sphere_scene(max_chunk=40_000, count=3000, frame=TILT):
    """A ball in the scene frame, coloured by place, chunked."""
    import open3d as o3d

    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 24)
    vertices = np.asarray(ball.vertices, np.float32)
    colors = np.round(255 * (0.45 + 0.2 * np.sin(3 * vertices))).astype(np.uint8)
    mesh = Mesh(
        vertices, vertices / np.linalg.norm(vertices, axis=1, keepdims=True), np.asarray(ball.triangles), colors
    )
    return Scene.from_mesh(mesh, max_chunk, scene_from_splat=frame)


def ball_splats(degree=1, count=3000, seed=0, frame=TILT, thickness=0.002):
    """Flat Gaussians on that ball, in the splat's frame, of colours between 0.2 and 0.7."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    back = np.linalg.inv(frame)
    means = normals * (1 + rng.normal(0, 0.003, (count, 1))) @ back[:3, :3].T + back[:3, 3]
    turned = normals @ back[:3, :3].T
    # The rotation that takes +z to the normal, by half angles; no normal is exactly -z.
    quats = np.stack([1 + turned[:, 2], -turned[:, 1], turned[:, 0], np.zeros(count)], axis=1)
    sh = np.zeros((count, (degree + 1) ** 2, 3))
    sh[:, 0] = (rng.uniform(0.3, 0.6, (count, 3)) - 0.5) / SH_C0
    sh[:, 1:] = rng.normal(0, 0.02, sh[:, 1:].shape)
    scales = np.tile([0.05, 0.05, thickness], (count, 1))
    return Splats(means, scales, quats, rng.uniform(0.3, 0.95, count), sh)


def irradiances(scene, seed=0):
    """Light from two sides, both smooth over the ball and brighter than any captured colour."""
    x, y, _ = scene.vertices.T
    before = np.stack([1 + 0.3 * x, 1 + 0.2 * y, 1.1 - 0.3 * x], axis=1)
    after = np.stack([1 - 0.4 * x, 0.7 + 0.2 * y, 0.5 + 0.3 * x], axis=1)
    return before.astype(np.float32), after.astype(np.float32)
