"""A mesh whose floor mirrors, for what collides with it: closed where splats show a reflection, without its image."""

import numpy as np
from numpy.typing import NDArray

from splat2mesh.base.arrays import Faces
from splat2mesh.scene.scene import Scene

from .binding import Binding
from .floor_mirror import FloorMirror
from .mirrored_mesh import mirrored_vertices


def closed_floor(scene: Scene, mirror: FloorMirror, binding: Binding) -> tuple[NDArray[np.float64], Faces]:
    """Vertices (V, 3) in the frame of the scene and faces (F, 3): those of the Scene without the mirror world, and a
    level grid in the gaps of the floor. binding: of its splats, with the floor."""
    image = np.zeros(len(scene.vertices), bool)
    image[mirrored_vertices(scene, mirror, binding)] = True
    kept, numbers = np.unique(scene.faces[~image[scene.faces].any(axis=1)], return_inverse=True)
    vertices, faces = scene.vertices[kept].astype(np.float64), numbers.reshape(-1, 3).astype(np.int32)
    if binding.mirrored is None:
        return vertices, faces
    cells, steps = binding.mirrored.gaps()
    if not len(cells):
        return vertices, faces
    normal, offset = binding.mirrored.plane
    around = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1]), axis=-1).reshape(-1, 1, 2)  # to reach under its rim
    cells = np.unique((cells + around).reshape(-1, 2), axis=0)
    corners = (cells[:, None] + [[0, 0], [1, 0], [1, 1], [0, 1]]).reshape(-1, 2)
    corners, number = np.unique(corners, axis=0, return_inverse=True)
    a, b, c, d = number.reshape(-1, 4).T.astype(np.int32) + np.int32(len(vertices))
    if np.linalg.det(np.asarray(scene.scene_from_splat)[:3, :3]) * np.cross(*steps) @ normal < 0.0:
        b, d = d, b
    grid = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    matrix = np.asarray(scene.scene_from_splat, np.float64)
    points = (corners @ steps + offset * normal) @ matrix[:3, :3].T + matrix[:3, 3]
    return np.concatenate([vertices, points]), np.concatenate([faces, grid])
