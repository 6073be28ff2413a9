"""The opacity field against its plain twin, closed forms, the rasteriser, and inputs that break rasterisers."""

from itertools import pairwise

import numpy as np
import pytest
from disc_splats import discs, plain
from opacityfield_reference import OpacityField, field_depth_reference
from scipy.spatial.transform import Rotation

from splat2mesh.base.errors import InputError
from splat2mesh.render import footprints
from splat2mesh.render.levelsearch import SPREAD_FROM, SPREAD_TO
from splat2mesh.render.opacityfield import ENOUGH, FIELD_LEVEL, field_depth
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.splats.splats import Splats

# The search ends when the opacity is within 1e-3 of its target; the exponential is good to 3e-6 a Gaussian. At
# sqrt(12) standard deviations a Gaussian begins with a step of exp(-6) = 0.0025, on which a search may end.
OPACITY_ERROR = 1.1e-3
STEP = 0.0025

# float32 sums with an exponential good to 3e-6; a pixel's weights add up to at most 1.
TOLERANCE = 1e-5

NAMES = ("depth", "normal", "spread", "color", "alpha")


def scattered(n, seed=0, size=0.15, opacity=1.0):
    """n splats of every shape in the unit ball."""
    rng = np.random.default_rng(seed)
    scales = size * np.exp(rng.normal(0, 0.7, (n, 3)))
    means, quats, sh = rng.normal(size=(n, 3)) * 0.5, rng.normal(size=(n, 4)), rng.normal(0, 0.5, (n, 4, 3))
    return Splats(means, scales, quats, opacity * rng.random(n), sh)


def front_view(width=48, height=40, focal=50.0):
    """A camera at the origin that looks along +z."""
    return View(width, height, focal, focal, width / 2, height / 2, np.eye(4))


def around(width=70, height=45):
    return View.look_at((1, 2, 5), (0, 0, 0), (0, 1, 0), 50, width, height)


def bytes_of(surface):
    return [getattr(surface, name).tobytes() for name in NAMES]


def found(surface):
    return np.isfinite(surface.depth)


@pytest.mark.parametrize(
    ("splats", "view"),
    [
        (scattered(300, 1), around()),
        (scattered(1500, 2, size=0.05), around(50, 35)),
        (scattered(600, 3, size=0.3, opacity=0.06), around(40, 30)),
        (scattered(300, 4), View(53, 37, 60.0, 44.0, 12.0, 25.0, around().camera_from_world)),
    ],
    ids=("large", "small", "more than a list holds", "off-axis"),
)
def test_agrees_with_the_plain_twin(splats, view):
    fast, slow = field_depth(splats, view), field_depth_reference(splats, view)
    field = OpacityField(splats, view)
    both = found(fast) & found(slow)
    assert both.sum() > 100
    # Rounding may move a splat over a cutoff (1/255, a list's least weight, a finished pixel): one pixel in 200.
    stray = 0.005
    assert np.mean(found(fast) != found(slow)) <= stray
    for name in ("color", "alpha"):
        assert np.mean(np.abs(getattr(fast, name) - getattr(slow, name)) > TOLERANCE) <= stray
    np.testing.assert_allclose(fast.alpha, slow.alpha, atol=float(ENOUGH))
    assert np.mean(np.abs(fast.normal - slow.normal)[both] > TOLERANCE) <= stray
    opacity = field.opacity(np.where(both, fast.depth, 0).astype(float))[both]
    error = np.abs(opacity - FIELD_LEVEL)
    assert np.mean(error > OPACITY_ERROR) <= stray and error.max() < OPACITY_ERROR + STEP
    for name in ("depth", "spread"):
        # An opacity error of 1e-3 moves a depth by 1e-3 / 0.4 of the spread, which covers 0.4 of the opacity.
        error = np.abs(getattr(fast, name) - getattr(slow, name))[both] / slow.spread[both]
        assert np.median(error) < 1e-3 / 0.4 and np.mean(error > 0.05) < 4 * stray


def test_one_gaussian_in_closed_form():
    z, sigma, opacity, view = 4.0, 0.5, 0.95, front_view()
    surface = field_depth(plain([[0, 0, z]], sigma, opacity), view)
    rays = view.ray_directions()
    squared = (rays**2).sum(axis=-1)
    pixels = (rays[..., :2] ** 2).sum(axis=-1) * view.fx**2
    alpha = opacity * np.exp(-pixels / (2 * ((view.fx * sigma / z) ** 2 + 0.3)))  # Zwicker et al. 2002, on the axis
    np.testing.assert_array_equal(found(surface), alpha >= FIELD_LEVEL)
    hit = alpha > 1.05 * FIELD_LEVEL
    # Along t r the Gaussian peaks at t = z / |r|^2 and has the standard deviation sigma / |r|.
    peak, width = z / squared, sigma / np.sqrt(squared)

    def reach(level):
        return peak - width * np.sqrt(2 * np.log(np.maximum(alpha / level, 1)))

    slope = FIELD_LEVEL * np.sqrt(2 * np.log(alpha[hit] / FIELD_LEVEL)) / width[hit]
    assert np.all(np.abs(surface.depth - reach(FIELD_LEVEL))[hit] < OPACITY_ERROR / slope + 1e-6 * z)
    # Where the opacity stays below 0.6 the spread ends at the peak.
    expected = reach(float(SPREAD_TO)) - reach(float(SPREAD_FROM))
    crossed = hit & (np.abs(alpha / float(SPREAD_TO) - 1) > 0.05)
    np.testing.assert_allclose(surface.spread[crossed], expected[crossed], rtol=0.03)
    expected = -rays / np.sqrt(squared)[..., None]
    np.testing.assert_allclose(surface.normal[hit], expected[hit], atol=1e-6)


def test_a_tilted_plane_of_discs():
    # Plane z = 3 + 0.5 x + 0.25 y.
    spacing, thickness, view = 0.03, 1e-3, front_view(64, 64, 80.0)
    x, y = np.meshgrid(np.arange(-3, 3, spacing), np.arange(-3, 3, spacing))
    normal = np.array([0.5, 0.25, -1]) / np.linalg.norm([0.5, 0.25, -1])
    points = np.stack([x, y, 3 + 0.5 * x + 0.25 * y], axis=-1).reshape(-1, 3)
    surface = field_depth(discs(points, np.tile(normal, (len(points), 1)), spacing, thickness), view)
    rays = view.ray_directions()
    truth, steepness = 3 / (1 - 0.5 * rays[..., 0] - 0.25 * rays[..., 1]), np.abs(rays @ normal)
    # The envelope lies before the plane, by no more than a Gaussian reaches: sqrt(12) standard deviations.
    before = (truth - surface.depth) * steepness / thickness
    assert before.min() > -1e-2 and before.max() < np.sqrt(12)
    assert (surface.spread * steepness / thickness).max() < 2
    # The gradient at a disc's peak leans by (thickness / radius)^2 times the tangent of the angle of incidence.
    slant = np.sqrt((rays**2).sum(axis=-1).max() / steepness.min() ** 2 - 1)
    lean = (thickness / spacing) ** 2 * slant
    np.testing.assert_allclose(surface.normal, np.broadcast_to(normal, rays.shape), atol=1.01 * lean)
    np.testing.assert_allclose(surface.color, 0.5, atol=TOLERANCE)
    assert surface.alpha.min() >= 1 - ENOUGH


def test_a_ball_of_discs():
    k = np.arange(6000) + 0.5
    z, azimuth = 1 - 2 * k / 6000, k * np.pi * (3 - np.sqrt(5))
    normals = np.stack([np.sqrt(1 - z * z) * np.cos(azimuth), np.sqrt(1 - z * z) * np.sin(azimuth), z], axis=1)
    spacing, view = np.sqrt(4 * np.pi / 6000), View.look_at((1, 2, 3), (0, 0, 0), (0, 1, 0), 40, 96)
    surface = field_depth(discs(normals, normals, 0.7 * spacing, 1e-3), view)
    rays, eye = view.ray_directions(), view.center
    a, b, c = (rays**2).sum(axis=-1), rays @ eye, eye @ eye - 1
    frontal = b * b - a * c > 0.25 * a  # closer than 60 degrees to the normal
    with np.errstate(invalid="ignore"):
        truth = ((-b - np.sqrt(b * b - a * c)) / a)[frontal]
    normal = eye + rays[frontal] * truth[:, None]
    # A flat disc stands out from the ball: by radius^2 / 2 at a radius, by four times that at two.
    sagitta = (0.7 * spacing) ** 2 / 2
    assert np.abs((surface.depth[frontal] - truth) * (rays[frontal] * normal).sum(axis=-1)).max() < 4 * sagitta + 4e-3
    cosine = (surface.normal[frontal] * normal).sum(axis=-1)
    # The normal is a mean over discs whose centres lie within two radii, each one's normal that much off.
    assert np.arccos(cosine.clip(-1, 1)).max() < 2 * 0.7 * spacing


def test_depth_rises_with_the_level_and_the_spread_lies_between_two():
    # From this near some searches have a plateau to cross, where Newton's method alone jumps to and fro for ever.
    splats, view = scattered(400, 6), View.look_at((0.5, 1, 2.5), (0, 0, 0), (0, 1, 0), 50, 70, 45)
    surfaces = [
        field_depth(splats, view, level=level) for level in (float(SPREAD_FROM), FIELD_LEVEL, float(SPREAD_TO), 0.9)
    ]
    for lower, upper in pairwise(surfaces):
        assert np.all(found(lower) | ~found(upper))
        both = found(upper)
        assert both.sum() > 100 and np.all(upper.depth[both] >= lower.depth[both])
    low, middle, high, _ = surfaces
    both = found(high)
    apart = high.depth - low.depth
    error = np.abs(apart - middle.spread)[both] / apart[both]
    # Two searches for the same two opacities, each good to 1e-3 of the 0.4 between them; more only on a plateau.
    assert np.median(error) < 5e-3 and np.mean(error > 0.05) < 0.01


def test_normals_are_unit_and_face_the_camera():
    view = around()
    surface = field_depth(scattered(400, 7), view)
    hit = found(surface)
    assert 100 < hit.sum() < hit.size
    np.testing.assert_allclose(np.linalg.norm(surface.normal[hit], axis=-1), 1, atol=1e-6)
    assert ((surface.normal * view.ray_directions()).sum(axis=-1)[hit] < 0).all()
    assert not surface.normal[~hit].any() and np.isnan(surface.spread[~hit]).all()


def test_spread_separates_a_sheet_from_a_cloud():
    rng, view = np.random.default_rng(8), front_view()
    x, y = np.meshgrid(np.arange(-2, 2, 0.05), np.arange(-2, 2, 0.05))
    sheet = np.stack([x, y, np.full_like(x, 3)], axis=-1).reshape(-1, 3)
    cloud = sheet + rng.normal(0, 0.3, sheet.shape)
    thin = field_depth(plain(sheet, [0.05, 0.05, 1e-3]), view)
    fuzzy = field_depth(plain(cloud, 0.05, opacity=0.2), view)
    assert found(fuzzy).mean() > 0.9
    assert np.nanmax(thin.spread) < 2e-3 and np.nanmedian(fuzzy.spread) > 0.1


def test_colour_and_opacity_are_the_rasterisers():
    splats, view = scattered(500, 9), around()
    surface, rendering = field_depth(splats, view), rasterize(splats, view)
    # Pixels are finished at a transmittance of 0.02 instead of 1e-4.
    assert np.abs(surface.alpha - rendering.alpha).max() < ENOUGH + TOLERANCE
    unfinished = surface.alpha < 1 - ENOUGH
    premultiplied = surface.color * surface.alpha[..., None]
    np.testing.assert_allclose(premultiplied[unfinished], rendering.color[unfinished], atol=2 * TOLERANCE)


def test_moving_everything_moves_only_the_normals():
    splats, view = scattered(400, 10), around()
    turn, shift, scale = Rotation.random(random_state=0).as_matrix(), np.array([3.0, -2.0, 5.0]), 7.0
    x, y, z, w = (Rotation.from_matrix(turn) * Rotation.from_quat(splats.quats_wxyz[:, [1, 2, 3, 0]])).as_quat().T
    moved = Splats(
        scale * splats.means @ turn.T + shift,
        scale * splats.scales,
        np.stack([w, x, y, z], axis=1),
        splats.opacities,
        splats.sh,
    )
    pose = np.eye(4)
    pose[:3, :3] = view.camera_from_world[:3, :3] @ turn.T
    pose[:3, 3] = -pose[:3, :3] @ (scale * turn @ view.center + shift)
    other = View(view.width, view.height, view.fx, view.fy, view.cx, view.cy, pose)
    before, after = field_depth(splats, view), field_depth(moved, other)
    assert np.mean(found(before) != found(after)) < 0.002
    both = found(before) & found(after)
    # float32 means and scales: 1e-6 of a depth near 20, and cutoffs that rounding moves.
    assert np.mean(np.abs(after.depth / scale - before.depth)[both] > 1e-4) < 0.02
    assert np.mean(np.abs(after.normal - before.normal @ turn.T)[both] > 1e-4) < 0.02


def test_order_threads_and_batches_do_not_matter(monkeypatch):
    splats, view = scattered(3000, 11, size=0.05), around(100, 90)
    shuffled = splats.take(np.random.default_rng(0).permutation(3000))
    results = []
    for splats_now, threads, batch in ((splats, 1, 32768), (splats, 2, 32768), (splats, 2, 100), (shuffled, 1, 999)):
        monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda threads=threads: threads)
        monkeypatch.setattr(footprints, "BATCH", batch)
        results.append(bytes_of(field_depth(splats_now, view)))
    assert found(field_depth(splats, view)).sum() > 1000
    assert results[1:] == results[:1] * 3


def test_near_plane_and_level_are_checked():
    splats = plain([[0, 0, 1.0], [0, 0, 2.0]], 0.3)
    hidden = field_depth(splats, front_view(), near=1.5)
    assert bytes_of(hidden) == bytes_of(field_depth(splats.take([1]), front_view(), near=1.5))
    for near in (0.0, -1.0, np.nan):
        with pytest.raises(InputError, match="near > 0"):
            field_depth(splats, front_view(), near=near)
    for level in (0.0, 1.0, -0.5, np.nan):
        with pytest.raises(InputError, match="between 0 and 1"):
            field_depth(splats, front_view(), level=level)


def test_a_surface_before_the_near_plane_is_no_surface():
    # The centre lies behind the near plane, the level is reached before it.
    surface = field_depth(plain([[0, 0, 2.0]], 0.5, 0.95), front_view(), near=1.9)
    assert surface.alpha.max() > 0.9 and not found(surface).any() and not surface.normal.any()


@pytest.mark.parametrize(
    "splats",
    [
        plain([[0, 0, -2.0]], 1.0),
        plain([[0, 0, 0.0]], 1.0),
        plain([[0, 0, 2.0]], 1.0, opacity=0.0039),
        plain([[1e6, 0, 2.0]], 1.0),
        plain([[0, 0, np.inf]], 1.0),
        plain([[np.nan, 0, 2.0]], 1.0),
        plain([[0, 0, 2.0]], np.nan),
        plain([[0, 0, 2.0]], np.inf),
        Splats([[0, 0, 2]], [[1, 1, 1]], [[np.nan, 0, 0, 1]], [1], [[[1, 1, 1]]]),
    ],
    ids="behind at-camera faint beside-far infinite nan nan-scale inf-scale nan-quat".split(),
)
def test_what_cannot_be_seen_changes_nothing(splats):
    scene = plain([[0, 0, 3.0], [0.3, 0, 4.0]], 0.2, 0.7)
    parts = [
        np.concatenate([getattr(scene, name), getattr(splats, name)])
        for name in ("means", "scales", "quats_wxyz", "opacities", "sh")
    ]
    assert bytes_of(field_depth(Splats(*parts), front_view())) == bytes_of(field_depth(scene, front_view()))


@pytest.mark.parametrize(
    "splats",
    [
        plain([[0, 0, 2.0]], 1e4),
        plain([[0.5, 0.2, 0.011]], 1e3),
        plain([[1e6, 2e5, 4e6]], 1e5),
        plain([[0.1, 0.2, 5.0]], 1e-7),
        plain([[0, 0, 2.0]], 0.0),
        plain([[0, 0, 2.0]], [1.0, 1.0, 0.0]),
        plain([[0, 0, 5.0]], [100.0, 1e-3, 1e-3]),
        plain([[0.01, 0.02, 5.0]], [1e-3, 1e-3, 1e12]),
        plain([[0, 0, 3.0]], [1e37, 1e-30, 1e-30]),
        Splats([[0.1, 0.2, 3]], [[1e3, 1e-3, 1e-3]], [[0.9, 0.1, 0.2, 0.4]], [1], [[[1, 1, 1]]]),
        plain([[0, 0, 3.0]], 0.3, opacity=1.0),
    ],
    ids="huge huge-at-camera far-and-huge sub-pixel point sheet needle along-z endless slanted opaque".split(),
)
@pytest.mark.parametrize("with_others", [False, True])
def test_extreme_shapes_leave_numbers(splats, with_others):
    if with_others:
        scene = plain([[0, 0, 3.0], [0.3, 0, 4.0]], 0.2, 0.7)
        names = ("means", "scales", "quats_wxyz", "opacities", "sh")
        splats = Splats(*(np.concatenate([getattr(scene, n), getattr(splats, n)]) for n in names))
    view = front_view(50, 33)
    surface = field_depth(splats, view)
    hit = found(surface)
    assert surface.alpha.max() > 0.05
    assert not np.isinf(surface.depth).any() and (surface.depth[hit] > footprints.NEAR).all()
    assert np.isfinite(surface.spread[hit]).all() and (surface.spread[hit] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(surface.normal[hit], axis=-1), 1, atol=1e-5)
    assert np.isfinite(surface.color).all() and np.isfinite(surface.normal).all()
    assert (surface.alpha >= 0).all() and (surface.alpha <= 1).all()


@pytest.mark.parametrize("size", [(1, 1), (17, 33)])
def test_nothing_to_see(size):
    surface = field_depth(scattered(0), front_view(*size))
    assert surface.depth.shape == size[::-1] and surface.normal.shape == (*size[::-1], 3)
    assert all(getattr(surface, name).dtype == np.float32 for name in NAMES)
    assert np.isnan(surface.depth).all() and np.isnan(surface.spread).all()
    assert not surface.alpha.any() and not surface.color.any() and not surface.normal.any()
