"""The depth maps of a tile's stations, cut to the part that matters for the tile."""

import numpy as np

from splat2mesh.render.opacityfield import FieldDepth
from splat2mesh.render.view import View
from splat2mesh.surface.sight import Sighting
from splat2mesh.tiles.look import sight_of
from splat2mesh.tiles.plan import INFLUENCE, RING, CityPlan

SIZE = 32


def plan(tiles):
    return CityPlan(
        scene_from_splat=np.eye(4).tolist(),
        up_from="asked for",
        pixel=0.05,
        finest=0.25,
        low=[-50.0] * 3,
        high=[50.0] * 3,
        tiles=tiles,
        counts=[1] * len(tiles),
        pieces=[],
        splats=1,
    )


def face(spread):
    """A view from above of level ground, 90 degrees wide: as far aside as it is high."""
    view = View.look_at((0.0, 40.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 90.0, SIZE)
    blank = np.zeros((SIZE, SIZE), np.float32)
    up = np.broadcast_to(np.float32([0, 1, 0]), (SIZE, SIZE, 3))
    seen = FieldDepth(blank + 40, up, blank + np.float32(spread), np.zeros((SIZE, SIZE, 3), np.float32), blank + 1)
    return Sighting(view, seen, blank + np.float32(0.1))


def test_pixels_beyond_what_a_tile_depends_on_have_no_weight():
    known = plan([[-10, -10, 0, 10], [0, -10, 10, 10]])
    assert known.block == 2.0
    sight = sight_of(face(0.1), known, 0)
    ground = (sight.view.center + sight.view.ray_directions() * sight.plane[..., 3:])[..., [0, 2]]
    margin = (RING + INFLUENCE) * known.block
    core = known.core(0)
    inside = ((ground >= core[0] - margin) & (ground < core[1] + margin)).all(axis=-1)
    assert 0 < inside.sum() < inside.size
    np.testing.assert_array_equal(sight.weight > 0, inside)


def test_no_cell_and_no_thickness_is_larger_than_a_block():
    known = plan([[-40, -40, 40, 40]])
    sight = sight_of(face(100.0), known, 0)
    assert sight.spread.max() == known.block and sight.step.max() <= known.block
    thin = sight_of(face(0.1), known, 0)
    np.testing.assert_array_equal(thin.spread, np.float32(0.1))
