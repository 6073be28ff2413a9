"""The pictures in which gloss is found: those of the fit, of an object from above."""

import numpy as np
from coloured_ball import ball_splats, sphere_scene

from relight.gloss.views import outer_looks
from relight.splats import Binding


def test_an_object_is_looked_at_from_above_and_nothing_is_drawn_again():
    scene = sphere_scene()
    bound = Binding(ball_splats(), scene)
    looks = outer_looks(bound, scene)
    points = bound.surface.points
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    height = (looks.eyes - middle) @ np.asarray(scene.scene_from_splat)[1, :3]
    pixels = np.bincount(looks.view_of, minlength=len(looks.eyes))
    assert (
        (pixels[height <= 0.0] == 0).all()
        and (pixels[height > 0.0] > 0).all()
        and 0 < (height > 0.0).sum() < len(height)
    )
    assert looks.blending is bound.looks.blending


def test_numbers_of_pictures_follow_their_pixels():
    looks = Binding(ball_splats(), sphere_scene()).looks
    for number in range(len(looks.eyes)):
        assert np.count_nonzero(looks.view_of == number) == len(looks.of_view(number).known)
