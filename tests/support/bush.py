"""A lawn with a bush on it, made by hand: a smooth sheet, and leaves in a ball that are a volume."""

import numpy as np

from splat2mesh.scene.measured import CapturedSky, Measured
from splat2mesh.scene.mesh import Mesh, vertex_normals
from splat2mesh.scene.optical_depth import OpticalDepth
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.harmonics import SH_C0
from splat2mesh.splats.splats import Splats

CELL, RADIUS, CENTER = 0.03, 0.5, np.array([0.2, 0.7, -0.1])
GREEN, GREY = np.array([40, 120, 30]), np.array([150, 150, 150])


def leaf_places(count, seed):
    """Places in the bush, and random unit axes of a plane at each, (N, 3) each."""
    rng = np.random.default_rng(seed)
    inside = rng.normal(size=(count, 3))
    inside *= (RADIUS * rng.random((count, 1)) ** (1 / 3)) / np.linalg.norm(inside, axis=1, keepdims=True)
    first, other = rng.normal(size=(2, count, 3))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(first, other)
    return CENTER + inside, first, second / np.linalg.norm(second, axis=1, keepdims=True)


def bush_mesh(leaves=1500, side=0.05):
    """Mesh of the sheet, and of leaves; and whether each vertex is of a leaf."""
    line = np.linspace(-2.0, 2.0, 41)
    x, z = (each.ravel() for each in np.meshgrid(line, line, indexing="ij"))
    ground = np.stack([x, 0.0 * x, z], axis=1)
    at = np.arange(41 * 41).reshape(41, 41)
    a, b, c, d = (each.ravel() for each in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    sheet = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    # Leaves share their middle with the next: one plant, in one piece.
    places, first, second = leaf_places(leaves, 1)
    chain = np.roll(places, -1, axis=0)
    corners = np.stack([places, places + side * first, places + side * second, chain], axis=1)
    points = np.concatenate([ground, corners[:, :3].reshape(-1, 3)])
    of_leaf = len(ground) + 3 * np.arange(leaves)[:, None] + [0, 1, 2]
    joint = np.stack([of_leaf[:, 0], np.roll(of_leaf[:, 0], -1), of_leaf[:, 1]], axis=1)
    keep = np.linalg.norm(places - chain, axis=1) < 10.0
    faces = np.concatenate([sheet, of_leaf, joint[keep]]).astype(np.int32)
    is_leaf = np.arange(len(points)) >= len(ground)
    colors = np.where(is_leaf[:, None], GREEN, GREY).astype(np.uint8)
    points = points.astype(np.float32)
    return Mesh(points, vertex_normals(points, faces), faces, colors), is_leaf


def bush_scene(max_chunk_vertices=3000):
    """A measured Scene of the lawn and the bush, from around and within."""
    mesh, _ = bush_mesh()
    scene = Scene.from_mesh(mesh, max_chunk_vertices, capture={"from": "both", "eyes": [[1.5, 1.0, 1.5]]})
    volume = (scene.colors_srgb[:, 0] == GREEN[0]).astype(np.float32)
    count = 100
    middle = (np.arange(count) + 0.5) * CELL - 0.5 * count * CELL
    x, y, z = np.meshgrid(middle, middle, middle, indexing="ij")
    inside = np.linalg.norm(np.stack([x, y, z], axis=-1) - CENTER, axis=-1) < RADIUS
    depth = OpticalDepth.of_levels(
        [np.full(3, -0.5 * count * CELL)], [CELL], [np.where(inside, np.float32(0.1), np.float32(0.0))]
    )
    sky = CapturedSky(*np.ones((3, 8, 16, 3), np.float32))
    scene.measured = Measured(sky, np.zeros(bush_splats()[0].means.shape[0], np.float32), volume, depth)
    scene.settings, scene.statistics = {"seed": 0}, {"vertices": len(mesh.vertices), "faces": len(mesh.faces)}
    return scene


def bush_splats(leaves=1200, ground=900):
    """Splats of the same, and whether each is a leaf: flat ones, those of the lawn level."""
    places, first, second = leaf_places(leaves, 2)
    rng = np.random.default_rng(3)
    level = np.stack([rng.uniform(-2, 2, ground), np.zeros(ground), rng.uniform(-2, 2, ground)], axis=1)
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_matrix(np.stack([first, second, np.cross(first, second)], axis=2)).as_quat()[:, [3, 0, 1, 2]]
    flat = Rotation.from_euler("x", 90, degrees=True).as_quat()[[3, 0, 1, 2]]
    scales = np.concatenate([np.tile([0.04, 0.02, 0.002], (leaves, 1)), np.tile([0.1, 0.1, 0.002], (ground, 1))])
    opacities = np.concatenate([rng.uniform(0.35, 1.0, leaves), np.full(ground, 0.9)])
    colors = np.concatenate([np.tile(GREEN, (leaves, 1)), np.tile(GREY, (ground, 1))]) / 255.0
    splats = Splats(
        np.concatenate([places, level]),
        scales,
        np.concatenate([turned, np.tile(flat, (ground, 1))]),
        opacities,
        ((colors - 0.5) / SH_C0)[:, None, :],
    )
    return splats, np.arange(leaves + ground) < leaves
