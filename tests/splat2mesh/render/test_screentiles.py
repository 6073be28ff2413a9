"""The screen in tiles: every pixel is in one tile, and images are put together from all of them."""

import numpy as np
import pytest

from splat2mesh.render.footprints import TILE, camera_of
from splat2mesh.render.screentiles import AREA, ScreenTiles
from splat2mesh.render.view import View


def empty(width, height):
    camera = camera_of(View.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 50, width, height))
    return camera, ScreenTiles.empty(camera, 4, transmittance=1, median=3)


@pytest.mark.parametrize(("width", "height"), [(16, 16), (33, 17), (5, 70)])
def test_what_is_written_into_a_tile_is_found_at_its_place_in_the_image(width, height):
    camera, tiles = empty(width, height)
    row, column = np.indices((height, width))
    tile = row // TILE * tiles.across + column // TILE
    place = 2 * AREA + row % TILE * TILE + column % TILE  # of plane 2
    number = np.arange(width * height, dtype=np.float32).reshape(height, width)
    tiles.pixels[tile, place] = number
    np.testing.assert_array_equal(tiles.images(camera)[2], number)


def test_nothing_is_drawn_yet_and_what_lies_outside_lets_no_light_through():
    camera, tiles = empty(33, 17)
    images = tiles.images(camera)
    assert images.shape == (4, 17, 33)
    np.testing.assert_array_equal(images[[0, 2]], 0)
    np.testing.assert_array_equal(images[1], 1)
    assert np.isnan(images[3]).all()
    assert tiles.pixels[:, AREA : 2 * AREA].sum() == 33 * 17
    assert tiles.across == 3 and tiles.open.all() and sorted(tiles.dealt) == list(range(6))
