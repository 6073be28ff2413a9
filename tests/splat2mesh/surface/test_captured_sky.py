"""The captured sky: what it covers and binds, at the right angle, in the scene's unit; its file."""

import numpy as np
import pytest
from disc_splats import plain

from splat2mesh.base.errors import InputError
from splat2mesh.base.sphere import row_solid_angles, texel_directions
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.measured import CapturedSky, Measured
from splat2mesh.splats.splats import SH_C0, Splats
from splat2mesh.surface.captured_sky import captured_sky
from splat2mesh.surface.measure import measured_of
from splat2mesh.views.viewpoints import even_directions

GREY = 0.6  # display value
FLIP = np.diag([1.0, -1.0, -1.0, 1.0])


def painted(splats, colors):
    """The splats with display colours (N, 3)."""
    sh = ((np.asarray(colors) - 0.5) / SH_C0)[:, None]
    return Splats(splats.means, splats.scales, splats.quats_wxyz, splats.opacities, sh)


def dome(above=0.0, count=4000, radius=30.0):
    """Opaque splats all over the directions whose y is above a height, scene frame, and these directions."""
    directions = even_directions(count)
    directions = directions[directions[:, 1] > above]
    return plain(radius * directions, 0.07 * radius, 0.99), directions


def subject(count=2000):
    return painted(plain(even_directions(count), 0.05, 0.9), np.full((count, 3), 0.4))


def together(sky):
    """(Splats, far) of a subject and a sky around it."""
    names = "means", "scales", "quats_wxyz", "opacities", "sh"
    parts = subject(), sky
    splats = Splats(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))
    return splats, np.arange(len(splats)) >= len(parts[0])


def texel(direction, sky):
    return np.unravel_index((texel_directions(*sky.bound.shape[:2]) @ direction).argmax(), sky.bound.shape[:2])


def test_solid_angles_add_up_to_the_sphere():
    assert row_solid_angles(64, 128).sum() * 128 == pytest.approx(4 * np.pi, rel=1e-12)


def test_a_grey_dome_binds_with_its_linear_radiance_and_covers_its_half():
    sky_splats, directions = dome()
    splats, far = together(painted(sky_splats, np.full((len(directions), 3), GREY)))
    sky = captured_sky(splats, far, np.eye(4))
    assert sky.coverage == pytest.approx(0.5, abs=0.06)  # splats of 4 degrees overlap the horizon
    assert sky.clipped_share == 0.0
    high = texel_directions(64, 128)[..., 1] > 0.2
    # A single splat is never quite opaque, and the dome's overlap: the blend is within a byte of its colour.
    np.testing.assert_allclose(sky.radiance[high], linear_from_srgb(np.float32(GREY)), atol=0.02)
    np.testing.assert_allclose(sky.bound[high], 1.0, atol=0.05)


@pytest.mark.parametrize("frame", [np.eye(4), FLIP])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1), (-1, 0, 0), (0, 0.6, -0.8)])
def test_one_bright_patch_is_found_where_it_stands(frame, axis):
    sky_splats, directions = dome(-1.0)
    axis = np.asarray(axis, float)
    colors = np.where((directions @ axis > np.cos(0.3))[:, None], 1.2, 0.3) * np.ones(3)
    at = sky_splats.means @ frame[:3, :3]  # the splat's frame: the inverse of a rotation is its transpose
    moved = Splats(at, sky_splats.scales, sky_splats.quats_wxyz, sky_splats.opacities, sky_splats.sh)
    sky = captured_sky(*together(painted(moved, colors)), frame)
    weight = sky.clipped.mean(axis=2) * row_solid_angles(64, 128)
    found = (texel_directions(64, 128) * weight[..., None]).sum(axis=(0, 1))
    assert found / np.linalg.norm(found) @ axis > np.cos(np.radians(2.0))  # a texel is 2.8 degrees
    assert (sky.clipped[texel(axis, sky)] == 1.0).all()
    assert (sky.clipped[texel(-axis, sky)] == 0.0).all()


def test_a_wholly_clipped_sky_binds_nothing():
    sky_splats, directions = dome()
    sky = captured_sky(*together(painted(sky_splats, np.full((len(directions), 3), 1.3))), np.eye(4))
    assert sky.bound.max() == 0.0
    assert sky.clipped_share == 1.0
    assert (sky.clipped[texel(np.array([0.0, 1.0, 0.0]), sky)] == 1.0).all()


def test_no_far_splats_or_a_speck_of_them_are_no_sky():
    splats, far = together(painted(dome()[0], np.full((len(dome()[1]), 3), GREY)))
    assert captured_sky(splats, np.zeros_like(far), np.eye(4)) is None
    assert captured_sky(splats, far & (np.arange(len(far)) == len(far) - 1), np.eye(4)) is None


def test_what_was_measured_comes_back_from_its_file_and_writes_the_same_bytes(tmp_path):
    splats, far = together(painted(dome()[0], np.full((len(dome()[1]), 3), GREY)))
    measured = measured_of(splats, np.flatnonzero(far), subject().means, np.eye(4))
    assert measured.sky.coverage > 0.3
    for name in ("one.npz", "two.npz"):
        measured.save(tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    found = Measured.load(tmp_path / "one.npz", len(subject()))
    np.testing.assert_allclose(found.sky.radiance, measured.sky.radiance, rtol=1e-3)
    np.testing.assert_allclose(found.sky.bound, measured.sky.bound, atol=0.5 / 255)
    np.testing.assert_allclose(found.splat_volume, measured.splat_volume, atol=0.5 / 255)


def test_damaged_splats_are_no_sky_and_no_volume():
    splats, far = together(painted(dome()[0], np.full((len(dome()[1]), 3), GREY)))
    means = splats.means.copy()
    means[[0, -1]] = np.nan
    broken = Splats(means, splats.scales, splats.quats_wxyz, splats.opacities, splats.sh)
    measured = measured_of(broken, np.flatnonzero(far), subject().means, np.eye(4))
    assert measured.sky.coverage == pytest.approx(0.5, abs=0.06)
    assert measured.splat_volume[0] == 0.0


def test_the_sky_is_seen_from_where_the_capture_stood():
    sky_splats, directions = dome()
    splats, far = together(painted(sky_splats, np.where(directions[:, :1] > 0, 1.2, 0.3) * np.ones(3)))
    turned = measured_of(splats, np.flatnonzero(far), subject().means, np.eye(4), eyes=[(12.0, 0, 0), (14.0, 0, 0)])
    middle = measured_of(splats, np.flatnonzero(far), subject().means, np.eye(4))
    assert turned.sky.clipped.sum() > 1.2 * middle.sky.clipped.sum()  # they are nearer the bright half


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 not a zip", b"\x00" * 64])
def test_a_damaged_file_is_refused(tmp_path, data):
    path = tmp_path / "measured.npz"
    path.write_bytes(data)
    with pytest.raises(InputError, match="damaged"):
        Measured.load(path, 3)


def test_a_file_of_another_scene_is_refused(tmp_path):
    empty = np.zeros(4, np.float32)
    Measured(None, empty, empty).save(tmp_path / "measured.npz")
    assert Measured.load(tmp_path / "measured.npz", 4).sky is None
    with pytest.raises(InputError, match="the scene has 5"):
        Measured.load(tmp_path / "measured.npz", 5)


def test_coverage_is_by_solid_angle():
    share = np.zeros((64, 128, 3), np.float32)
    share[:32] = 1.0
    assert CapturedSky(share, share, 0 * share).coverage == pytest.approx(0.5, rel=1e-6)
