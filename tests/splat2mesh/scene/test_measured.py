"""What was measured on splats: the sphere's area, a round trip, and what counts as foliage."""

import numpy as np
import pytest

from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.scene.measured import THICKET, CapturedSky, Measured


def sky(bound, clipped, height=8, width=16):
    shape = (height, width, 3)
    return CapturedSky(np.full(shape, 0.5, np.float32), *(np.full(shape, v, np.float32) for v in (bound, clipped)))


@pytest.mark.parametrize(("height", "width"), [(1, 1), (2, 5), (64, 128)])
def test_texels_cover_the_sphere_and_those_of_a_row_alike(height, width):
    areas = row_solid_angles(height, width)
    assert areas.shape == (height, 1) and width * areas.sum() == pytest.approx(4 * np.pi, rel=1e-12)
    np.testing.assert_allclose(areas, areas[::-1], rtol=1e-12)


def test_directions_are_unit_start_up_and_their_mean_is_none():
    found = texel_directions(64, 128)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1.0, rtol=1e-12)
    assert (found[0, :, 1] > 0.99).all() and (found[-1, :, 1] < -0.99).all()
    np.testing.assert_allclose((found * row_solid_angles(64, 128)[..., None]).sum(axis=(0, 1)), 0.0, atol=1e-12)
    # The centre looks along +z, a quarter to the left of it is +x.
    np.testing.assert_allclose(found[31:33, 63:65].mean(axis=(0, 1)), [0, 0, 1], atol=1e-3)
    np.testing.assert_allclose(found[31:33, 31:33].mean(axis=(0, 1)), [1, 0, 0], atol=1e-3)


def test_shares_of_the_sky_are_by_area():
    whole = sky(0.75, 0.25)
    assert whole.coverage == pytest.approx(1.0) and whole.clipped_share == pytest.approx(0.25)
    half = sky(1.0, 0.0)
    half.bound[4:] = 0.0  # the lower half was not seen
    assert half.coverage == pytest.approx(0.5) and half.clipped_share == 0.0
    assert sky(0.0, 0.0).clipped_share == 0.0


def test_what_is_saved_comes_back_and_the_same_contents_are_the_same_bytes(tmp_path):
    shares = np.arange(256, dtype=np.float32) / 255
    measured = Measured(sky(1.0, 0.0), shares, shares[::-1].copy())
    measured.save(tmp_path / "a.npz")
    measured.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    found = Measured.load(tmp_path / "a.npz", 256)
    np.testing.assert_array_equal(found.splat_volume, shares)
    np.testing.assert_array_equal(found.vertex_volume, shares[::-1])
    for before, after in zip(measured.sky, found.sky, strict=True):
        np.testing.assert_array_equal(after, before)
    assert found.depth is None and found.described()["sky"] == {"coverage": 1.0, "clipped_share": 0.0}


def test_a_file_of_another_scene_or_none_is_refused(tmp_path):
    Measured(None, np.zeros(3, np.float32), np.zeros(4, np.float32)).save(tmp_path / "a.npz")
    with pytest.raises(InputError, match="of 4 vertices, the scene has 5"):
        Measured.load(tmp_path / "a.npz", 5)
    np.savez(tmp_path / "b.npz", other=np.zeros(3))
    with pytest.raises(InputError, match="damaged"):
        Measured.load(tmp_path / "b.npz", 4)


def test_without_a_sky_only_a_thicket_has_foliage():
    thin, thick = (np.full(10, THICKET + step, np.float32) for step in (-0.1, 0.1))
    assert not Measured(None, thin, thin).foliage.any()
    np.testing.assert_array_equal(Measured(None, thick, thick).foliage, thick)
    np.testing.assert_array_equal(Measured(sky(1.0, 0.0), thin, thin).foliage, thin)
