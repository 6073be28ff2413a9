"""Views for a scene that was made before: from the eyes of a place, or around an object, in the frame of the splat."""

import numpy as np
import pytest
from ball_splats import RADIUS, solid_ball

from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.texture.looks import looks_of
from splat2mesh.texture.texture import texture_of

TURN = np.array([[1.0, 0, 0, 3.0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""scene_from_splat: z is up in the splat, and its origin lies at x = 3."""


def scene_with(capture, points=((0.0, 0, 0), (1, 0, 0), (0, 0, 1))):
    count = len(points)
    mesh = Mesh(
        np.float32(points), np.float32([[0, 1, 0]] * count), np.int32([[0, 1, 2]]), np.full((count, 3), 9, np.uint8)
    )
    return Scene.from_mesh(mesh, 10**6, scene_from_splat=TURN, capture=capture)


@pytest.mark.parametrize("kind", ["inside", "both"])
def test_a_place_is_seen_from_its_eyes(kind):
    eyes = np.array([[3.0, 0.5, 0.0], [3.2, 0.4, 0.1]])
    (look,) = looks_of(scene_with({"from": kind, "eyes": eyes.tolist()}), solid_ball())
    assert len(look.views) == len(look.near) == 12 and (look.near > 0).all()
    centers = np.unique(np.round([view.center for view in look.views], 9), axis=0)
    np.testing.assert_allclose(TURN[:3, :3] @ centers.T + TURN[:3, 3:], eyes.T, atol=1e-9)


def test_an_object_is_seen_from_around():
    (look,) = looks_of(scene_with({"from": "outside"}), solid_ball())
    centers = np.array([view.center for view in look.views])
    assert (np.linalg.norm(centers, axis=1) > RADIUS).all()
    assert np.abs(centers.mean(axis=0)).max() < 0.5 * np.linalg.norm(centers, axis=1).mean()


def test_a_texture_needs_no_views_at_all():
    made = texture_of(scene_with({}), [], 32)
    assert made.unseen == 0 and (made.colors == 9).all()
