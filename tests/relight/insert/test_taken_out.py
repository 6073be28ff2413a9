"""What is taken out again leaves nothing behind."""

import numpy as np
import pytest
from insert_places import disc, floor_place, request, rows

from relight.jobs.folders import relight_files

pytestmark = pytest.mark.filterwarnings("ignore:the light of the capture is unknown")


@pytest.fixture
def place(tmp_path):
    return floor_place(tmp_path)


@pytest.mark.slow
def test_an_object_put_in_and_taken_out_again_leaves_every_bit(place, tmp_path):
    """Though the cache of the scene has been through it."""
    relight_files(request(place, [], tmp_path / "before", env="captured"))
    asked = f"{disc(tmp_path, 0.2)} at=-2,.3,-2"
    relight_files(request(place, [asked], tmp_path / "with", env="captured"))
    relight_files(request(place, [], tmp_path / "after", env="captured"))
    before, between, after = (tmp_path / name / "relit_splat.ply" for name in ("before", "with", "after"))
    assert between.read_bytes() != before.read_bytes() == after.read_bytes()
    np.testing.assert_array_equal(rows(after), rows(tmp_path / "floor.ply"))
    assert not (after.parent / "inserted.glb").exists()
