"""What the tests of the viewer share: a small scene, and sessions that wait for their light."""

import numpy as np
import open3d as o3d
from inline_worker import InlineWorker

from relight import Environment
from relight.viewer.lighting import FinishedShading, keys
from relight.viewer.request import SessionRequest
from relight.viewer.session import Session
from relight.viewer.state import choices_of
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

SIZE = 480, 360  # of small windows


def ball_on_plate(resolution=10, **fields):
    """A ball over a plate, 500 vertices in two chunks, coloured by position: the ball's shadow falls on the plate."""
    plate = o3d.geometry.TriangleMesh.create_box(3.0, 0.2, 3.0).translate((-1.5, -1.4, -1.5)).subdivide_midpoint(3)
    ball = o3d.geometry.TriangleMesh.create_sphere(0.8, resolution).translate((0.0, 0.1, 0.0))
    return as_scene(plate + ball, **fields)


def as_scene(mesh, color=None, max_chunk_vertices=300):
    """A Scene of an open3d mesh; without a colour it is coloured by position."""
    mesh.compute_vertex_normals()
    vertices = np.asarray(mesh.vertices, np.float32)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    colors = np.uint8(60 + 160 * (vertices - low) / (high - low))
    if color is not None:
        colors[:] = color
    normals, faces = np.asarray(mesh.vertex_normals, np.float32), np.asarray(mesh.triangles, np.int32)
    return Scene.from_mesh(Mesh(vertices, normals, faces, colors), max_chunk_vertices)


class ByHand:
    """A worker that says what a test has it say, and nothing else. asked: the wishes so far."""

    def __init__(self, *_):
        self.asked, self._said = [], []

    def submit(self, wish):
        self.asked.append(wish)

    def poll(self):
        said, self._said = self._said, []
        return said

    def shade(self, wish):
        """Give the light of a wish: black."""
        radiance = np.zeros((1, 3), np.float32)
        lit = FinishedShading(radiance, 0, [], "", frozenset(), None, 0.0)
        self._said.append(("result", "shading", keys(wish)["shading"], lit))

    def say(self, *message):
        self._said.append(message)

    def close(self):
        """Nothing to end."""


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


def session_of(scene, environment="noon", **options):
    """A Session whose worker works within `poll`, and for which no time passes: a light that is moved never rests."""
    options = {"worker": InlineWorker, "tolerance": 0.05, "clock": Clock()} | options
    worker, clock = options.pop("worker"), options.pop("clock")
    return Session(SessionRequest.of(scene, choices_of(environment), **options), worker, clock)


def constant(radiance=1.0):
    """The same light from everywhere."""
    return Environment(np.full((16, 32, 3), radiance, np.float32), "constant")


def bare(window):
    """The settled picture without the panel."""
    window.session.finish()
    return window.picture(panel=False).astype(int)
