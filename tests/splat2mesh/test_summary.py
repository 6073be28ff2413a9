"""The summary of a written scene."""

from pathlib import Path

import numpy as np

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.summary import summary_of


def test_a_number_of_vertices_that_no_surface_has_is_reported():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    mesh = Mesh(corners, np.tile(np.float32([0, 0, 1]), (3, 1)), np.int32([[0, 1, 2]]), np.full((3, 3), 9, np.uint8))
    scene = Scene([mesh], statistics={"vertices": 3, "faces": 1, "splats": 9})
    for vertices, detail, ending in (
        (
            10**8,
            "draft",
            ["  --vertices 100,000,000: the surface has fewer; a finer --detail finds more"],
        ),
        (10**8, "fine", ["  --vertices 100,000,000: the surface has fewer"]),
        (50_000, "draft", []),  # the default
        ("auto", "draft", []),
    ):
        scene.settings |= {"vertices": vertices, "detail": detail}
        assert summary_of(scene, Path("a")) == ["a: 3 vertices, 1 faces in 1 chunks, from 9 splats", *ending]
