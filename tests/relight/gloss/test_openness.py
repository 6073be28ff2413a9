"""What a place of a surface sees above itself."""

import numpy as np
import pytest
from glossy_scene import glaze
from live_scene import TILT, scene_and_splats

from relight.gloss.openness import BANDS, openness
from relight.sh import harmonics
from splat2mesh.scene.color import linear_from_srgb

TURN = TILT[:3, :3]


@pytest.fixture(scope="module")
def glazed():
    scene, splats = scene_and_splats()
    binding = glaze(scene, splats)[0]
    colors = linear_from_srgb(scene.colors_srgb / 255.0).astype(np.float32)
    nodes = np.arange(len(binding.surface.points))
    return scene, binding, openness(binding.surface, nodes, binding.surface.of_vertices(colors), TURN)


def test_where_nothing_hides_the_light_all_of_it_is_seen(glazed):
    """The top of the ball: the coefficients are those of 1, to rounding."""
    scene, binding, (visible, hidden) = glazed
    top = binding.surface.node[scene.vertices[:, 1].argmax()]
    np.testing.assert_allclose(visible[top], [np.sqrt(4 * np.pi), 0, 0, 0], atol=1e-5)
    assert not hidden[top].any()


def test_below_the_ball_it_is_seen_to_the_sides_and_the_ball_hides_the_rest(glazed):
    scene, binding, (visible, hidden) = glazed
    plate = np.flatnonzero((np.abs(scene.vertices[:, 1]) < 1e-4) & (scene.normals[:, 1] > 0.9))
    below = plate[np.hypot(*scene.vertices[plate][:, [0, 2]].T).argmin()]
    row = binding.surface.node[below]
    up, aside = (harmonics.evaluate(np.array([way]), BANDS)[0] @ visible[row] for way in ([0, 1.0, 0], [0.99, 0.1, 0]))
    assert up < 0.6 and aside > 0.85  # four numbers spread a ball of 39 degrees
    ball = scene.vertices[:, 1] > 0.2
    of_ball = linear_from_srgb(scene.colors_srgb[ball] / 255.0)
    assert (hidden[row] > of_ball.min(axis=0)).all() and (hidden[row] < of_ball.max(axis=0)).all()
