"""The arrow to the north: against the sun of a date, in the south at noon, and where it lies in pictures."""

import numpy as np
import pytest

from relight.cli import main
from relight.light.daylight import DaylightRequest
from relight.output.north_picture import MARK, north, north_picture
from splat2mesh.scene.color import luminance
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def floor():
    """A square of 2 units, facing up."""
    corners = np.float32([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    up = np.tile(np.float32([0, 1, 0]), (4, 1))
    faces = np.int32([[0, 2, 1], [0, 3, 2]])
    return Scene([Mesh(corners, up, faces, np.full((4, 3), 90, np.uint8))])


@pytest.mark.parametrize("north_deg", [0.0, 20.0, 90.0, -135.0])
def test_at_noon_the_sun_stands_opposite_of_the_arrow(north_deg):
    sun = DaylightRequest.parse("2026-06-21T12:02+00:00", "51.48,0", north_deg).environment()
    column, width = int(luminance(sun.radiance).max(axis=0).argmax()), sun.radiance.shape[1]
    longitude = np.pi * (1.0 - 2.0 * (column + 0.5) / width) + np.radians(
        sun.rotation_deg
    )  # of OpenEXR's image, turned
    toward = np.array([np.sin(longitude), 0.0, np.cos(longitude)])
    # A texel is .7 degrees wide; the sun crosses the south within minutes of 12:02.
    assert toward @ north(north_deg) < -np.cos(np.radians(2.0))


@pytest.mark.parametrize(("north_deg", "tip"), [(0.0, (0, -1)), (90.0, (-1, 0)), (180.0, (0, 1)), (270.0, (1, 0))])
def test_in_a_picture_from_above_the_tip_of_the_arrow_points_there(north_deg, tip):
    scene = floor()
    above = {"eye": [0.0, 4.0, 0.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 0.0, -1.0], "fov_deg": 40.0}
    image = north_picture(scene, scene.colors_linear, north_deg, above)
    rows, columns = np.nonzero((image == np.uint8(MARK)).all(axis=2))
    along = np.stack([columns, rows], axis=1) @ np.array(tip)  # -z is the top of the picture, +x its right
    across = np.stack([columns, rows], axis=1) @ np.array(tip)[::-1]
    assert np.ptp(along) > 2.0 * np.ptp(across)
    # The broad head and the N are at the tip: ink is wider there than at the tail.
    middle = along.min() + 0.35 * np.ptp(along)
    assert np.ptp(across[along > middle]) > 2.0 * np.ptp(across[along < middle])


def test_a_plan_of_a_date_writes_it(tmp_path, capsys):
    floor().save(tmp_path / "floor")
    date = ["--sun", "2026-06-21T12:00+00:00", "--at", "51.48,0", "--north", "30"]
    assert main([str(tmp_path / "floor"), *date, "--plan", "--albedo", "captured"]) == 0
    assert (tmp_path / "floor" / "north.png").exists() and "an arrow to the north" in capsys.readouterr().out
    assert main([str(tmp_path / "floor"), "--env", "noon", "--plan", "-o", str(tmp_path / "noon")]) == 0
    assert not (tmp_path / "noon" / "north.png").exists()
