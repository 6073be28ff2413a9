"""Where to look at a tile from: clear of everything, under the sky, about a spacing apart."""

import numpy as np

from splat2mesh.tiles.stations import CELLS, CLEAR_CELLS, NEAR, SOLID, stations_of

SPACING = 7.0
CELL = SPACING / CELLS
CORE = np.array([[0.0, 0.0], [28.0, 14.0]])


def sheet(height, low=(-7.0, -7.0), high=(35.0, 21.0)):
    """Points of a level sheet, half a cell apart: (N, 3)."""
    x, z = np.meshgrid(*(np.arange(a, b, CELL / 2) for a, b in zip(low, high, strict=True)))
    return np.stack([x.ravel(), np.full(x.size, height), z.ravel()], axis=1)


def test_over_level_ground_each_column_has_some_and_all_are_clear_of_it():
    ground = sheet(0.0)
    stations = stations_of(ground, np.ones(len(ground)), CORE, SPACING)
    centers = np.array([station.center for station in stations])
    columns = np.unique(np.floor(centers[:, [0, 2]] / SPACING), axis=0)
    assert len(columns) == 4 * 2 and len(stations) == 2 * len(columns)  # one near the ground, one a spacing above
    assert ((centers[:, [0, 2]] >= CORE[0]) & (centers[:, [0, 2]] < CORE[1])).all()
    heights = centers[:, 1]
    assert (heights >= (CLEAR_CELLS - 1) * CELL).all() and (heights < SPACING).all()
    # The near plane is a share of the way to the nearest taken cell, known to a cell.
    np.testing.assert_allclose([station.near for station in stations], NEAR * heights, atol=NEAR * CELL)


def test_nobody_stands_where_no_way_leads_to_the_sky():
    hall = (2.0, 2.0), (12.0, 12.0)
    walls = [sheet(4.0, *hall), sheet(0.0)]
    for axis in (0, 2):
        for side in (2.0, 12.0):
            along, up = np.meshgrid(np.arange(2.0, 12.0, CELL / 2), np.arange(0.0, 4.0, CELL / 2))
            wall = np.stack([along.ravel(), up.ravel(), along.ravel()], axis=1)
            wall[:, axis] = side
            walls.append(wall)
    points = np.concatenate(walls)
    stations = stations_of(points, np.ones(len(points)), CORE, SPACING)
    inside = [s for s in stations if 2 < s.center[0] < 12 and 2 < s.center[2] < 12 and 0 < s.center[1] < 4]
    assert stations and not inside


def test_what_is_faint_takes_no_room_and_nothing_is_no_place():
    ground = sheet(0.0)
    assert stations_of(ground, np.full(len(ground), SOLID), CORE, SPACING) == []
    fog = sheet(3.0)
    both = np.concatenate([ground, fog])
    opacities = np.concatenate([np.ones(len(ground)), np.full(len(fog), SOLID)])
    alone = stations_of(ground, np.ones(len(ground)), CORE, SPACING)
    for with_fog, without in zip(stations_of(both, opacities, CORE, SPACING), alone, strict=True):
        np.testing.assert_array_equal(with_fog.center, without.center)
