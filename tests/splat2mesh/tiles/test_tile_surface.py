"""The mesh of a tile: what hangs loose goes, what reaches a border stays, and no edge has more than two faces."""

import numpy as np

from splat2mesh.surface.clean import SMALLEST_FACES, without_floaters
from splat2mesh.tiles.surface import without_crowded


def strip(count, first=0):
    """A strip of so many faces: (count, 3), of count + 2 vertices from `first` on."""
    start = first + np.arange(count)
    return np.stack([start, start + 1, start + 2], axis=1)


def test_small_parts_go_but_for_those_that_reach_a_border():
    large, small, border = strip(SMALLEST_FACES), strip(5, 200), strip(5, 300)
    seam = np.zeros(400, bool)
    seam[302] = True
    kept, dropped = without_floaters(np.concatenate([large, small, border]), seam)
    np.testing.assert_array_equal(kept, np.concatenate([large, border]))
    assert dropped == 1
    kept, dropped = without_floaters(np.concatenate([strip(SMALLEST_FACES - 1), small]), np.zeros(400, bool))
    assert len(kept) == 0 and dropped == 2
    assert without_floaters(np.zeros((0, 3), np.int32), seam)[1] == 0


def test_of_the_faces_at_an_edge_the_two_largest_stay():
    # Four faces share the edge 0-1; their third corners are ever farther away.
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2], [0, -3, 0], [0, 0, -4]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [1, 0, 4], [0, 1, 5]])
    nobody = np.zeros(6, bool)
    np.testing.assert_array_equal(without_crowded(points, faces, nobody), faces[2:])
    fixed = np.arange(6) == 2
    np.testing.assert_array_equal(without_crowded(points, faces, fixed), faces[[0, 2, 3]])
    np.testing.assert_array_equal(without_crowded(points, faces[:2], nobody), faces[:2])
