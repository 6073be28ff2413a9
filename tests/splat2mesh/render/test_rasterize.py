"""The rasteriser against its plain twin, closed forms, and inputs that break rasterisers."""

import numpy as np
import pytest
from rasterize_reference import rasterize_reference

from splat2mesh.base.errors import InputError
from splat2mesh.render import footprints as module
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.splats.splats import SH_C0, Splats

# The kernels blend in float32 with an exponential good to 3e-6, and a pixel's weights add up to at most 1.
TOLERANCE = 1e-5
FRONT = np.eye(4)


def scattered(n, seed=0, coefficients=1, size=0.15):
    """n splats of every shape in the unit ball."""
    rng = np.random.default_rng(seed)
    means = rng.normal(size=(n, 3)) * 0.5
    scales = size * np.exp(rng.normal(0, 0.7, (n, 3)))
    sh = rng.normal(0, 1 / np.sqrt(coefficients), (n, coefficients, 3))
    return Splats(means, scales, rng.normal(size=(n, 4)), rng.random(n), sh)


def plain(means, scale, opacity=1.0, color=0.5):
    """Isotropic splats of one colour: means (N, 3); scale, opacity and colour are broadcast."""
    n = len(means)
    sh = np.broadcast_to((np.asarray(color) - 0.5) / SH_C0, (n, 3))[:, None]
    quats = np.tile([1.0, 0, 0, 0], (n, 1))
    return Splats(means, np.broadcast_to(scale, (n, 3)), quats, np.broadcast_to(opacity, n).astype(float), sh)


def joined(*parts):
    return Splats(
        *(np.concatenate([getattr(p, name) for p in parts]) for name in "means scales quats_wxyz opacities sh".split())
    )


def wall(z, spacing=0.05, extent=3.0, **look):
    """A square lattice of splats, wide enough to fill any view below, at camera z."""
    x = np.arange(-extent, extent, spacing)
    grid = np.stack(np.meshgrid(x, x), axis=-1).reshape(-1, 2)
    return plain(np.column_stack([grid, np.full(len(grid), z)]), spacing, **look)


def front_view(width=48, height=40, focal=50.0):
    """A camera at the origin that looks along +z."""
    return View(width, height, focal, focal, width / 2, height / 2, FRONT)


def fields(rendering):
    return [getattr(rendering, name).tobytes() for name in ("color", "alpha", "depth_median")]


def assert_agrees(fast, slow, stray=0.005):
    """Equal to rounding, but for a share `stray` of pixels where rounding moved a splat over a cutoff.

    There colour and opacity may differ by the faintest splat drawn (1/255 of a colour below 4), depth freely.
    """
    for name, step in (
        ("color", 4 / 255),
        ("alpha", 1 / 255),
        ("depth_median", None),
    ):
        got, wanted = getattr(fast, name), getattr(slow, name)
        assert got.shape == wanted.shape and got.dtype == np.float32
        error = np.abs(got - wanted) / np.maximum(1, np.nan_to_num(np.abs(wanted)))
        error[np.isnan(got) & np.isnan(wanted)] = 0
        assert np.mean(~(error <= TOLERANCE)) <= stray, name
        if step:
            assert error.max() <= step, name


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_agrees_with_reference(coefficients):
    splats = scattered(300, coefficients, coefficients)
    view = View.look_at((0.5, 1, 2.5), (0, 0, 0), (0, 1, 0), 50, 70, 45)
    fast = rasterize(splats, view)
    assert fast.alpha.max() > 0.9
    assert_agrees(fast, rasterize_reference(splats, view))


def test_agrees_with_reference_from_within_and_off_axis():
    # Splats beside and behind the camera reach into the image, and the guard band of the Jacobian matters.
    splats = scattered(400, seed=5, coefficients=4)
    pose = View.look_at((0.1, 0, 0.2), (1, 0.2, 0), (0, 1, 0), 90, 8).camera_from_world
    view = View(53, 37, 30.0, 22.0, 12.0, 25.0, pose)
    assert_agrees(rasterize(splats, view), rasterize_reference(splats, view))


def test_isotropic_splat_is_a_gaussian_disc():
    z, scale, opacity, view = 4.0, 0.3, 0.8, front_view()
    color = np.array([0.2, 0.9, 0.4])
    seen = rasterize(plain([[0, 0, z]], scale, opacity, color), view)
    x, y = np.meshgrid(np.arange(view.width) + 0.5 - view.cx, np.arange(view.height) + 0.5 - view.cy)
    # Zwicker et al. 2002 on the optical axis: the projected variance plus the low-pass.
    alpha = opacity * np.exp(-(x * x + y * y) / (2 * ((view.fx * scale / z) ** 2 + 0.3)))
    near_cutoff = np.abs(alpha - 1 / 255) < 1e-6
    alpha[alpha < 1 / 255] = 0
    assert not near_cutoff.any()
    np.testing.assert_allclose(seen.alpha, alpha, atol=TOLERANCE)
    np.testing.assert_allclose(seen.color, alpha[..., None] * color, atol=TOLERANCE)
    np.testing.assert_array_equal(seen.depth_median, np.where(alpha >= 0.5, np.float32(z), np.nan))


def test_order_of_the_file_does_not_matter():
    splats = scattered(500, seed=2)
    view = View.look_at((0, 0.5, 3), (0, 0, 0), (0, 1, 0), 45, 64)
    assert len(np.unique(view.project(splats.means)[1].astype(np.float32))) == 500
    shuffled = splats.take(np.random.default_rng(0).permutation(500))
    assert fields(rasterize(shuffled, view)) == fields(rasterize(splats, view))


def test_threads_and_batches_do_not_matter(monkeypatch):
    splats = scattered(3000, seed=3, coefficients=4, size=0.05)
    view = View.look_at((0, 0.5, 3), (0, 0, 0), (0, 1, 0), 45, 100, 90)
    renderings = []
    for threads, batch in ((1, 32768), (2, 32768), (2, 100)):
        monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda threads=threads: threads)
        monkeypatch.setattr(module, "BATCH", batch)
        renderings.append(fields(rasterize(splats, view)))
    assert renderings[0] == renderings[1] == renderings[2]


def test_opaque_wall_hides_what_is_behind():
    view, front = front_view(), wall(2.0, color=[0.2, 0.4, 0.6])
    alone = rasterize(front, view)
    crowd = scattered(2000, seed=4)
    behind = Splats(crowd.means + np.array([0, 0, 6]), crowd.scales, crowd.quats_wxyz, np.ones(2000), crowd.sh)
    both = rasterize(joined(behind, front), view)
    assert rasterize(behind, view).alpha.max() > 0.99
    # A pixel is finished below a transmittance of 1e-4; the brightest colour behind is below 3.
    np.testing.assert_allclose(both.color, alone.color, atol=3e-4)
    np.testing.assert_array_equal(both.depth_median, np.full((40, 48), 2.0))


def test_a_tile_shows_what_lies_before_its_depth():
    splats, view = scattered(300), View.look_at((0.5, 1, 2.5), (0, 0, 0), (0, 1, 0), 50, 80, 48)
    whole, shown = rasterize(splats, view), np.arange(15) % 2 == 0
    part = rasterize(splats, view, deepest=np.where(shown, np.inf, 0.0).astype(np.float32))
    pixels = np.kron(shown.reshape(3, 5), np.ones((16, 16))) > 0
    for name, empty in (("color", 0), ("alpha", 0), ("depth_median", np.nan)):
        got, wanted = getattr(part, name), getattr(whole, name)
        assert np.array_equal(got[pixels], wanted[pixels], equal_nan=True)  # every bit
        assert np.array_equal(got[~pixels], np.full_like(got[~pixels], empty), equal_nan=True)
    near, far = wall(2.0, color=0.2, opacity=0.3), wall(4.0, color=0.8)
    cut = rasterize(joined(near, far), front_view(), deepest=np.full(9, 3, np.float32))
    assert fields(cut) == fields(rasterize(near, front_view()))


def test_one_colour_covers_the_image():
    color = np.array([0.25, 0.5, 0.75])
    seen = rasterize(wall(3.0, color=color), front_view())
    assert seen.alpha.min() > 0.9999
    np.testing.assert_allclose(seen.color, seen.alpha[..., None] * color, atol=TOLERANCE)


def test_depth_of_a_tilted_plane():
    # Plane z = 3 + 0.5 x + 0.25 y, sampled by discs of radius = spacing = 0.03.
    spacing, view = 0.03, front_view(64, 64, 80.0)
    x, y = np.meshgrid(np.arange(-3, 3, spacing), np.arange(-3, 3, spacing))
    means = np.stack([x, y, 3 + 0.5 * x + 0.25 * y], axis=-1).reshape(-1, 3)
    normal = np.array([0.5, 0.25, -1]) / np.linalg.norm([0.5, 0.25, -1])
    quat = np.array([1 + normal[2], -normal[1], normal[0], 0])  # turns +z onto the normal
    discs = plain(means, [spacing, spacing, spacing / 100], 0.9)
    discs = Splats(discs.means, discs.scales, np.tile(quat, (len(means), 1)), discs.opacities, discs.sh)
    seen = rasterize(discs, view)
    rays = view.ray_directions()
    truth = 3 / (1 - 0.5 * rays[..., 0] - 0.25 * rays[..., 1])
    # A pixel has the depths of the centres of the splats that cover it, the nearest first: never more than a
    # spacing behind the plane, and before it by at most a splat's reach (alpha = 1/255) along the slope.
    slope = np.hypot(0.5, 0.25)
    reach = np.sqrt(2 * np.log(0.9 * 255)) * np.sqrt(spacing**2 + 0.3 * (truth / view.fx) ** 2)
    assert np.all(seen.depth_median - truth < spacing * slope)
    assert np.all(seen.depth_median - truth > -reach * slope)


def test_near_plane():
    splats = plain([[0, 0, 1.0], [0, 0, 2.0]], 0.1)
    assert fields(rasterize(splats, front_view(), near=1.5)) == fields(rasterize(splats.take([1]), front_view()))
    for near in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="near > 0"):
            rasterize(splats, front_view(), near=near)


@pytest.mark.parametrize(
    "splats",
    [
        plain([[0, 0, -2.0]], 1.0),
        plain([[0, 0, 0.0]], 1.0),
        plain([[0, 0, 2.0]], 1.0, opacity=0.0),
        plain([[0, 0, 2.0]], 1.0, opacity=0.0039),
        plain([[1e6, 0, 2.0]], 1.0),
        plain([[0, -1e6, 1e6]], 1.0),
        plain([[0, 0, np.inf]], 1.0),
        plain([[np.nan, 0, 2.0]], 1.0),
        plain([[0, 0, 2.0]], np.nan),
        plain([[0, 0, 2.0]], np.inf),
        Splats([[0, 0, 2]], [[1, 1, 1]], [[np.nan, 0, 0, 1]], [1], [[[1, 1, 1]]]),
    ],
    ids=("behind at-camera transparent faint beside-far corner-far infinite nan nan-scale inf-scale nan-quat").split(),
)
def test_what_cannot_be_seen_changes_nothing(splats):
    scene = plain([[0, 0, 3.0], [0.3, 0, 4.0]], 0.2, 0.7)
    assert fields(rasterize(joined(scene, splats), front_view())) == fields(rasterize(scene, front_view()))


@pytest.mark.parametrize(
    "splats",
    [
        plain([[0, 0, 2.0]], 1e4, 0.6),
        plain([[0.5, 0.2, 0.011]], 1e3, 0.6),
        plain([[1e6, 2e5, 4e6]], 1e5, 0.6),
        plain([[0.1, 0.2, 5.0]], 1e-7, 1.0),
        plain([[0, 0, 2.0]], 0.0, 1.0),
        plain([[0, 0, 5.0]], [100.0, 1e-3, 1e-3]),
        Splats([[0.1, 0.2, 3]], [[1e3, 1e-3, 1e-3]], [[0.9, 0.1, 0.2, 0.4]], [1], [[[1, 1, 1]]]),
    ],
    ids="huge huge-at-camera far-and-huge sub-pixel point needle slanted-needle".split(),
)
def test_extreme_but_visible(splats):
    view = front_view(50, 33)
    fast = rasterize(splats, view)
    assert fast.alpha.max() > 0
    assert_agrees(fast, rasterize_reference(splats, view), stray=0.02)


@pytest.mark.parametrize("length", [1e12, 1e37])
def test_endless_needle_is_a_line_as_wide_as_the_pixel_filter(length):
    quat = [np.cos(np.pi / 8), 0, 0, np.sin(np.pi / 8)]  # 45 degrees from x to y
    needle = Splats([[0, 0, 3]], [[length, 1e-30, 1e-30]], [quat], [1], [[[1, 1, 1]]])
    view = front_view()
    x, y = np.meshgrid(np.arange(view.width) + 0.5 - view.cx, np.arange(view.height) + 0.5 - view.cy)
    alpha = np.minimum(np.exp(-((x - y) ** 2) / 2 / (2 * 0.3)), 0.99)  # (x - y)^2 / 2 = squared distance
    alpha[alpha < 1 / 255] = 0
    # float32 holds the angle to 6e-8, which moves the line by 2e-6 pixels at the image's edge.
    np.testing.assert_allclose(rasterize(needle, view).alpha, alpha, atol=TOLERANCE)


def test_nothing_to_see():
    seen = rasterize(scattered(0), front_view(1, 1))
    assert fields(seen) == fields(rasterize_reference(scattered(0), front_view(1, 1)))
    assert seen.color.tolist() == [[[0, 0, 0]]] and seen.alpha.tolist() == [[0]]
    assert np.isnan(seen.depth_median).all()
