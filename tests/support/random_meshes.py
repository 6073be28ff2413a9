"""Meshes of random numbers, for the tests of files."""

import numpy as np

from splat2mesh.scene.mesh import Mesh


def random_mesh(vertices=200, faces=300, seed=0):
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(vertices, 3))
    return Mesh(
        rng.normal(size=(vertices, 3)).astype(np.float32),
        (normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
        rng.integers(0, vertices, (faces, 3), dtype=np.int32),
        rng.integers(0, 256, (vertices, 3), dtype=np.uint8),
    )
