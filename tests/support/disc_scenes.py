"""A level floor, discs above it, and the light that they hide in closed form."""

import numpy as np

from relight.insert.objects import InsertedObject, Part
from relight.insert.standing import Standing
from relight.insert.surroundings import Receiving
from relight.light.environment import Environment
from relight.transfer.occluder import Frame, Occluder
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

WHITE = Environment(np.ones((16, 32, 3), np.float32), "white")


def grid(side, size=10.0, height=0.0):
    """A level square of side x side vertices, facing up, as (vertices, normals, faces)."""
    across = np.linspace(-size / 2, size / 2, side)
    x, z = np.meshgrid(across, across)
    vertices = np.stack([x.ravel(), np.full(x.size, height), z.ravel()], axis=1).astype(np.float32)
    a = (np.arange(side - 1)[:, None] * side + np.arange(side - 1)).ravel()
    faces = np.concatenate([np.stack([a, a + side, a + 1], 1), np.stack([a + 1, a + side, a + side + 1], 1)])
    return vertices, np.tile(np.float32([0, 1, 0]), (len(vertices), 1)), faces.astype(np.int32)


def disc(radius, height, points=256, up=False):
    """A level disc about the y axis that faces down, or up."""
    angle = np.arange(points) * 2 * np.pi / points
    rim = np.stack([radius * np.cos(angle), np.full(points, height), radius * np.sin(angle)], axis=1)
    vertices = np.concatenate([rim, [[0.0, height, 0.0]]]).astype(np.float32)
    faces = np.stack([np.arange(points), (np.arange(points) + 1) % points, np.full(points, points)], axis=1)
    normals = np.tile(np.float32([0, 1 if up else -1, 0]), (len(vertices), 1))
    return vertices, normals, (faces[:, ::-1] if up else faces).astype(np.int32)


def standing_of(scene, vertices, normals, faces, albedo):
    colors = np.ones((len(vertices), 4), np.float32)
    none = np.zeros((len(vertices), 3), np.float32)
    part = Part(vertices, normals, faces, colors, None, np.full_like(none, albedo), none)
    frame = Frame.around(scene.vertices, scene.faces)
    return Standing.of(frame, [InsertedObject("disc", [part])], [np.eye(4)])


def floor(albedo=0.0, side=101, size=10.0):
    vertices, normals, faces = grid(side, size)
    scene = Scene([Mesh(vertices, normals, faces, np.zeros((len(vertices), 3), np.uint8))])
    return scene, Occluder(vertices, normals, faces), np.full_like(vertices, albedo)


def every(occluder):
    return Receiving(occluder.origins, occluder.normals)


def form_factor(distance, height, radius):
    """Of a level disc at a height, seen by a level place at a distance from its axis (Howell, B-12)."""
    h, r = height / np.maximum(distance, 1e-9), radius / np.maximum(distance, 1e-9)
    z = 1 + h**2 + r**2
    found = 0.5 * (1 - (1 + h**2 - r**2) / np.sqrt(z**2 - 4 * r**2))
    return np.where(distance < 1e-9, radius**2 / (radius**2 + height**2), found)
