"""The ceiling of a room, and what lies above it."""

import numpy as np

from relight.rooms.seen import UNEVEN, below_ceiling
from relight.transfer.occluder import Frame, Occluder

EYES = np.array([[0.0, 1.2, 0.0], [0.6, 1.4, 0.5], [-0.6, 1.3, -0.5]])


def layers(*heights):
    """Level squares that look down, 4 m wide, and one of 2 m for each further height: an Occluder and its Frame."""
    square = np.array([[-2, 0, -2], [2, 0, -2], [2, 0, 2], [-2, 0, 2]], np.float32)
    vertices = np.concatenate([square * (1.0 if k < 2 else 0.5) + [0, y, 0] for k, y in enumerate(heights)])
    faces = np.concatenate([np.array([[0, 1, 2], [0, 2, 3]]) + 4 * k for k in range(len(heights))])
    normals = np.tile(np.array([[0, -1, 0]], np.float32), (len(vertices), 1))
    return Occluder(vertices.astype(np.float32), normals, faces), Frame.around(vertices, faces)


def test_the_ceiling_is_where_half_of_the_rays_end():
    occluder, frame = layers(0.0, 2.6, 1.9)  # a lamp below it
    under_lamp, beside = (below_ceiling(occluder, frame.unit(EYES + np.array([x, 0.0, 0.0]))) for x in (0.0, 1.4))
    assert under_lamp.tolist() == [True] * 4 + [False] * 4 + [True] * 4
    assert beside.all()


def test_what_lies_above_it_by_more_than_it_is_uneven_is_no_part_of_the_room():
    least = 2.6 + UNEVEN * (2.6 - 1.3)
    occluder, frame = layers(0.0, 2.6, least - 0.02, least + 0.02)
    below = below_ceiling(occluder, frame.unit(EYES))
    assert below.tolist() == [True] * 12 + [False] * 4


def test_nothing_is_above_an_open_place():
    occluder, frame = layers(0.0)
    assert below_ceiling(occluder, frame.unit(EYES)).all()
