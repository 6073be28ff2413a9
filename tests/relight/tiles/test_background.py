"""What belongs to no tile of a city: sky shows the new light, lawns and hedges take the change of light."""

import numpy as np
import pytest
from splat_samples import assert_same, open_air

from relight import Environment
from relight.splats.light_ratio import CURVE_OFFSET, CURVE_POWER
from relight.splats.sky import FarSplats, sky_rows
from relight.tiles.background import Background, background_of, far_splats, relit_background
from relight.tiles.shared import flat, restored
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import NUMBERS, SH_C0
from splat2mesh.tiles.store import Store

GAIN = 0.25
EVEN = Environment(np.full((8, 16, 3), 0.3, np.float32), "even")


@pytest.fixture
def far(tmp_path):
    """A city of one level square under a far background in two pieces, dealt in turns: its Background in light GAIN
    times as strong, the pieces, and for each the splats that are sky by the rule for single scenes."""
    splats, rows, _ = open_air()
    splats.means[:200, 1] = 0.0
    parts = [rows[::2], rows[1::2]]
    for piece, part in enumerate(parts):
        arrays = {name: getattr(splats, name)[part] for name in NUMBERS}
        Store(tmp_path).write_arrays(f"splats/far_{piece:05d}.npz", offset=np.zeros(3), **arrays)
    corners = np.array([[-1, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]], np.float32)
    up = np.tile(np.float32([0, 1, 0]), (4, 1))
    square = Mesh(corners, up, np.int32([[0, 1, 2], [0, 2, 3]]), np.full((4, 3), 90, np.uint8))
    light = np.ones((4, 3))
    made = background_of(Store(tmp_path), [0, 1], Scene([square]), light, GAIN * light)
    is_sky = np.isin(rows, sky_rows(splats, rows, np.eye(4)))
    return made, [far_splats(Store(tmp_path), piece) for piece in (0, 1)], [is_sky[::2], is_sky[1::2]]


def test_sky_shows_the_new_light_and_the_rest_takes_its_change(far):
    background, pieces, expected = far
    for splats, sky in zip(pieces, expected, strict=True):
        relit = relit_background(splats, background, EVEN, np.eye(4), 1.0, "new")
        rows = np.arange(len(splats))
        shown = FarSplats(splats, rows, rows, np.eye(4), eye=np.zeros(3)).under(splats, EVEN, 1.0).sh[:, 0]
        before, after = (each.sh[:, 0] * SH_C0 + 0.5 + CURVE_OFFSET for each in (splats, relit))
        lawn = np.isclose(after, before * GAIN ** (1 / CURVE_POWER), atol=1e-3).all(axis=1)
        new = np.isclose(relit.sh[:, 0], shown, atol=1e-4).all(axis=1)
        assert (lawn ^ new).all()
        assert (new == sky).mean() > 0.99  # the votes of neighbours are taken within a piece
        assert 100 < new.sum() < len(new) - 100


def test_what_is_kept_stays_and_what_is_dropped_is_sky_alone(far):
    background, (splats, _), (sky, _) = far
    assert relit_background(splats, background, EVEN, np.eye(4), 1.0, "keep") is splats
    gone = relit_background(splats, background, EVEN, np.eye(4), 1.0, "drop").opacities == 0.0
    assert (gone == sky).mean() > 0.99


def test_it_comes_back_from_a_file_to_the_bit(far, tmp_path):
    background, (splats, _), _ = far
    Store(tmp_path).write_arrays("light.npz", **flat("background", background), other=1)
    kept = restored(Background | None, "background", Store(tmp_path).read_arrays("light.npz"))
    assert_same(
        *(relit_background(splats, each, EVEN, np.eye(4), 1.0, "new") for each in (kept, background)),
    )
    assert restored(Background, "background", {"other": 1}) is None


def test_damaged_far_splats_stay_and_harm_no_others(far, tmp_path):
    background, (splats, _), _ = far
    whole = relit_background(splats, background, EVEN, np.eye(4), 1.0, "new")
    splats.means[3] = np.nan
    relit = relit_background(splats, background, EVEN, np.eye(4), 1.0, "new")
    np.testing.assert_array_equal(relit.sh[3], splats.sh[3])
    assert (relit.sh == whole.sh).all(axis=(1, 2)).mean() > 0.95
