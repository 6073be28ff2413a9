"""The camera of the picture of an added object: it sees the object and the ground around it, from above."""

from types import SimpleNamespace

import numpy as np
import trimesh

from relight.output.inserted_picture import camera_of
from relight.transfer.occluder import Frame, Occluder

BALL = trimesh.creation.icosphere(2, radius=0.3).apply_translation([0.0, 0.3, 0.0])


def camera(eyes, *walls):
    """The camera in a place of a floor and boxes, ((middle), (sizes)), where the capture stood at the eyes."""
    floor = trimesh.creation.box((12.0, 0.1, 12.0)).apply_translation([0.0, -0.05, 0.0])
    boxes = [trimesh.creation.box(size).apply_translation(middle) for middle, size in walls]
    place = trimesh.util.concatenate([floor, *boxes])
    vertices, faces = place.vertices.astype(np.float32), place.faces.astype(np.int32)
    frame = Frame.around(vertices, faces)
    occluder = Occluder(vertices, place.vertex_normals, faces)
    inserted = SimpleNamespace(
        standing=SimpleNamespace(vertices=BALL.vertices, frame=frame), around=SimpleNamespace(occluder=occluder)
    )
    found = camera_of(inserted, SimpleNamespace(capture={"eyes": eyes} if eyes else {}))
    return np.array(found["eye"]), np.array(found["target"]), found["fov_deg"]


def test_a_free_eye_above_the_object_is_taken_as_it_is():
    eye, target, fov = camera([[1.2, 0.8, 0.0], [5.0, 0.2, 0.0]])
    np.testing.assert_allclose(eye, [1.2, 0.8, 0.0])
    np.testing.assert_allclose(target, [0.0, 0.3, 0.0], atol=1e-6)
    # The ball's box, whose half diagonal is .3 sqrt(3), fits with room around it.
    assert fov > 2 * np.degrees(np.arctan(0.3 * np.sqrt(3) / np.linalg.norm(eye - target)))


def test_a_wall_between_sends_the_camera_to_another_eye():
    wall = (0.9, 0.5, 0.0), (0.1, 1.2, 3.0)
    eye, _, _ = camera([[1.2, 0.8, 0.0], [-1.2, 0.8, 0.3]], wall)
    assert eye[0] < 0.9


def test_eyes_below_a_table_do_not_make_the_picture():
    table = (2.2, 0.75, 0.0), (1.6, 0.05, 1.6)
    eye, target, _ = camera([[1.6, 0.2, 0.0], [2.0, 0.3, 0.2]], table)
    assert eye[1] - target[1] > 0.25 * np.linalg.norm(eye - target)


def test_without_standpoints_it_looks_from_slightly_above():
    eye, target, _ = camera([])
    slope = (eye - target)[1] / np.linalg.norm(eye - target)
    assert 0.3 < slope < 0.4
