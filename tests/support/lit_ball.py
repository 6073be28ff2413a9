"""A ball lit from one side, as a mesh and as splats in a frame of their own: light and albedo are known."""

import numpy as np
import open3d as o3d

from splat2mesh.scene.color import bytes_from_unit, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats

TILT = np.array([[0, 1, 0, 0.5], [0, 0, -1, 0.25], [-1, 0, 0, -2], [0, 0, 0, 1.0]])
"""scene_from_splat: a turn that takes every axis to another, and a step."""

RADIUS = 1.0


def albedo_at(normals):
    """Linear albedo (N, 3): brown above, blue below, never dark."""
    share = 0.5 + 0.5 * np.clip(3.0 * normals[:, 1:2], -1.0, 1.0)
    return share * [0.5, 0.35, 0.2] + (1.0 - share) * [0.2, 0.3, 0.5]


def received_at(normals):
    """Irradiance (N, 3) of the capture: warm from +x, dim from behind."""
    return 0.25 + 0.9 * np.maximum(normals[:, :1], 0.0) * [1.0, 0.9, 0.7]


def ball_scene(resolution=20):
    """(Scene, albedo (V, 3) float32): the ball in the scene frame, in two chunks or more."""
    ball = o3d.geometry.TriangleMesh.create_sphere(RADIUS, resolution)
    vertices = np.asarray(ball.vertices, np.float32)
    normals = vertices / np.linalg.norm(vertices, axis=1, keepdims=True)
    colors = bytes_from_unit(srgb_from_linear((albedo_at(normals) * received_at(normals)).astype(np.float32)))
    scene = Scene.from_mesh(Mesh(vertices, normals, np.asarray(ball.triangles), colors), 500, scene_from_splat=TILT)
    return scene, albedo_at(scene.normals).astype(np.float32)


def splats_of_ball(count=1500, degree=1, seed=0):
    """Splats of it, in their own frame, and their normals (N, 3) in the scene frame."""
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    back = np.linalg.inv(TILT)
    means = RADIUS * normals @ back[:3, :3].T + back[:3, 3]
    turned = normals @ back[:3, :3].T
    quats = np.stack([1 + turned[:, 2], -turned[:, 1], turned[:, 0], np.zeros(count)], axis=1)
    sh = np.zeros((count, (degree + 1) ** 2, 3))
    shown = srgb_from_linear((albedo_at(normals) * received_at(normals)).astype(np.float32))
    sh[:, 0] = (shown - 0.5) / SH_C0
    sh[:, 1:] = rng.normal(0, 0.02, sh[:, 1:].shape)
    scales = np.tile([0.06, 0.06, 0.004], (count, 1))
    return Splats(means, scales, quats, np.full(count, 0.9), sh), normals
