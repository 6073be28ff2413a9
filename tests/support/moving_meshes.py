"""Meshes of parts that move: a flat table, and a ball whose seam has doubled vertices."""

import numpy as np

from relight.animation.animation import face_normals
from splat2mesh.scene.mesh import Mesh


def mesh(vertices, faces):
    vertices, faces = np.asarray(vertices, np.float32), np.asarray(faces, np.int32)
    return Mesh(vertices, face_normals(vertices, faces), faces, np.full(vertices.shape, 200, np.uint8))


def grid(side):
    """A flat square of side x side vertices in the plane y = 0 that reaches from -1 to 1."""
    x, z = np.meshgrid(np.linspace(-1, 1, side), np.linspace(-1, 1, side), indexing="ij")
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel()
    vertices = np.stack([x, np.zeros_like(x), z], axis=-1).reshape(-1, 3)
    return vertices, np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)])


def ball(radius, center, rings=12):
    """A sphere with a seam of doubled vertices, as texture coordinates make one."""
    polar, turn = np.linspace(0, np.pi, rings + 1), np.linspace(0, 2 * np.pi, 2 * rings + 1)
    turn[-1] = 0.0  # to the bit
    p, t = np.meshgrid(polar, turn, indexing="ij")
    vertices = np.stack([np.sin(p) * np.sin(t), np.cos(p), np.sin(p) * np.cos(t)], axis=-1).reshape(-1, 3)
    index = np.arange(vertices.shape[0]).reshape(p.shape)
    a, b, c, d = index[:-1, :-1].ravel(), index[1:, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, 1:].ravel()
    return radius * vertices + center, np.concatenate([np.stack([a, b, c], 1), np.stack([c, b, d], 1)])
