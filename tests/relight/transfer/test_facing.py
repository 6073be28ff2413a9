"""Which side of a face a ray met: by the vertex normals, whatever the winding."""

import numpy as np
import pytest

from relight.transfer.facing import met_in_front
from relight.transfer.occluder import Occluder

CORNERS = np.float32([[-9, 0, -9], [9, 0, -9], [0, 0, 9], [0, -3, 0]])
"""A triangle in the plane y = 0, and a vertex below it that no face uses."""


@pytest.mark.parametrize("winding", [[0, 1, 2], [2, 1, 0]])
@pytest.mark.parametrize("up", [1.0, -1.0])
def test_the_front_is_where_the_vertex_normals_point(winding, up):
    normals = np.tile(np.float32([0, up, 0]), (4, 1))
    occluder = Occluder(CORNERS, normals, np.array([winding]))
    directions = np.float32([[0, -1, 0], [0, 1, 0], [0.6, -0.8, 0], [0, 1, 0]])
    origins = -0.1 * directions
    origins[3] = 0.1  # past the face
    hits = occluder.first_hits(np.hstack([origins, directions]).astype(np.float32))
    assert (hits.faces >= 0).tolist() == [True, True, True, False]
    assert met_in_front(occluder, hits, directions).tolist() == [up > 0, up < 0, up > 0, False]
