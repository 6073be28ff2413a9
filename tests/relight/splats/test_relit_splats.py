import numpy as np
import pytest
from coloured_ball import TILT, ball_splats, irradiances, sphere_scene
from scipy.spatial import cKDTree

from relight.splats import Binding
from relight.splats.attachment import Surface
from relight.splats.light_ratio import BURNING, CURVE_POWER, Usual, log_gain, without_clipping
from relight.transfer.store import Cache
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats


def views_around(count=14, pixels=128):
    """Views of the ball from all sides, in the splat's frame."""
    index = np.arange(count) + 0.5
    z, turn = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    center = np.array([-0.5, 0.25, -2.0])
    eyes = center + 5 * np.stack([radius * np.cos(turn), z, radius * np.sin(turn)], axis=1)
    return [View.look_at(eye, center, [0.1, -1, 0], 30, pixels) for eye in eyes]


@pytest.fixture(scope="module")
def ball():
    scene, splats = sphere_scene(), ball_splats()
    return scene, splats, Binding(splats, scene, views_around())


def test_equal_light_changes_no_bit(ball):
    scene, splats, binding = ball
    before, _ = irradiances(scene)
    np.testing.assert_array_equal(binding.relit(before, before).sh, splats.sh)


@pytest.mark.parametrize("degree", range(4))
@pytest.mark.parametrize("factor", [0.5, 1.3])
def test_light_k_times_as_strong_makes_every_linear_colour_k_times_as_bright(degree, factor):
    scene, splats = sphere_scene(), ball_splats(degree)
    before, _ = irradiances(scene)
    result = Binding(splats, scene, ()).relit(before, factor * before)
    for eye in (None, np.array([0.0, -9.0, 4.0]), np.array([5.0, 5.0, 5.0])):
        old, new = ((s.colors_diffuse if eye is None else s.colors_toward(eye)) for s in (splats, result))
        # Where the sRGB curve is a power, before and after, the map is exact but for float32.
        above_toe = linear_from_srgb(old) * factor > 0.0032
        assert above_toe.mean() > 0.99
        np.testing.assert_allclose(
            linear_from_srgb(new)[above_toe], (factor * linear_from_srgb(old))[above_toe], rtol=2e-5, atol=2e-6
        )


def test_the_fit_leaves_a_constant_factor_as_it_is(ball):
    scene, splats, binding = ball
    before, _ = irradiances(scene)
    expected = 0.5 * linear_from_srgb(splats.colors_diffuse)
    # A product of 32 views' float32 sums: errors of single sums are 1e-6.
    found = linear_from_srgb(binding.relit(before, 0.5 * before).colors_diffuse)
    np.testing.assert_allclose(found, expected, atol=2e-5)


def test_a_dark_scene_is_lit_by_exposure_as_by_stronger_light(ball):
    scene, _, binding = ball
    before, after = irradiances(scene)
    doubled, exposed = binding.relit(before, 2 * after, rounds=0), binding.relit(before, after, exposure=2.0, rounds=0)
    np.testing.assert_array_equal(doubled.sh, exposed.sh)


def test_every_splat_takes_the_change_of_its_place(ball):
    scene, splats, _ = ball
    before, after = irradiances(scene)
    result = Binding(splats, scene, ()).relit(before, after)
    centers = splats.means @ TILT[:3, :3].T + TILT[:3, 3]
    nearest = cKDTree(scene.vertices).query(centers)[1]
    expected = linear_from_srgb(splats.colors_diffuse) * (after / before)[nearest]
    # The ratio changes by up to 0.9 per unit, vertices are 0.13 apart, and the softening by SOFTNESS^2 = 1% more.
    np.testing.assert_allclose(linear_from_srgb(result.colors_diffuse), expected, rtol=0.12, atol=2e-3)
    error = np.abs(linear_from_srgb(result.colors_diffuse) - expected).mean() / expected.mean()
    assert error < 0.02


def test_what_is_seen_of_the_relit_splats_is_the_change_of_what_is_seen():
    """Round Gaussians, up to 4% before and behind the surface, which the rays of a view that is not the fit's meet."""
    scene, splats = sphere_scene(), ball_splats(0, 6000)
    rng = np.random.default_rng(5)
    center = np.array([-0.5, 0.25, -2.0])
    means = center + (splats.means - center) * (1 + rng.uniform(-0.04, 0.04, (6000, 1)))
    splats = Splats(means, np.full((6000, 3), 0.06), splats.quats_wxyz, splats.opacities, splats.sh)
    before, after = irradiances(scene)
    view = View.look_at([-2.5, 0.6, -8.0], [-0.5, 0.25, -2.0], [0, -1, 0], 25, 160)  # none of the fit's
    old = rasterize(splats, view)
    solid = old.alpha > 0.99
    assert solid.mean() > 0.2
    # Where the ray meets the ball, by the quadratic formula, not the depth of Gaussians.
    ray, eye = view.ray_directions()[solid], view.center - center
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    root = (ray @ eye) ** 2 - (eye @ eye - 1)
    met = root > 0.05
    points = view.center + ray * (-(ray @ eye) - np.sqrt(np.maximum(root, 0)))[:, None]
    nearest = cKDTree(scene.vertices).query(points @ TILT[:3, :3].T + TILT[:3, 3], 4)[1]
    expected = (linear_from_srgb(old.color[solid]) * (after / before)[nearest].mean(axis=1))[met]
    errors = []
    for result in (
        splats,
        Binding(splats, scene, ()).relit(before, after),
        Binding(splats, scene, views_around()).relit(before, after),
    ):
        shown = linear_from_srgb(rasterize(result, view).color[solid])[met]
        errors.append(np.linalg.norm(shown - expected) / np.linalg.norm(expected))
    assert errors[1] < errors[0] / 4
    # A pixel shows Gaussians up to 0.1 apart, over which the ratio changes by up to 9%.
    assert max(errors[1:]) < 0.045


def test_the_fit_brings_what_is_seen_nearer_to_the_change_behind_each_pixel():
    """A shadow's edge, narrower than the Gaussians: the light at their centres blurs it, the fit sharpens it."""
    scene, splats = sphere_scene(), ball_splats(0, 3000)
    splats = Splats(splats.means, np.full((3000, 3), 0.07), splats.quats_wxyz, splats.opacities, splats.sh)
    before, _ = irradiances(scene)
    after = before * np.where(scene.vertices[:, 1:2] > 0.13, np.float32(1.0), np.float32(0.2))
    views, center = views_around(), np.array([-0.5, 0.25, -2.0])
    binding = Binding(splats, scene, views)
    errors = []
    for rounds in (0, 2, 6):
        result, total = binding.relit(before, after, rounds=rounds), 0.0
        for view in views:
            old, new = rasterize(splats, view), rasterize(result, view)
            ray, eye = view.ray_directions(), view.center - center  # rays meet the ball where a quadratic says
            a, b, c = (ray * ray).sum(axis=2), ray @ eye, eye @ eye - 1
            solid = (old.alpha > 0.99) & (b * b - a * c > 0.3 * a)  # not at the rim
            depth = (-b - np.sqrt(np.maximum(b * b - a * c, 0))) / a
            y = ((view.center + ray * depth[..., None]) @ TILT[1, :3] + TILT[1, 3])[solid]
            lit = np.where(y > 0.13, 1.0, 0.2)[:, None]
            expected = srgb_from_linear(linear_from_srgb(old.color[solid]) * lit)
            total += np.square(new.color[solid] - expected).sum()
        errors.append(np.sqrt(total))
    assert errors[1] < 0.95 * errors[0]  # measured 0.90, and 0.87 after six rounds
    assert errors[2] < errors[1]


def test_contact_a_flat_splat_belongs_to_the_surface_that_it_lies_in():
    """A wall that stands on a floor: splats beside the edge, as near to either, take the light of their own plane."""
    grid = np.stack(np.meshgrid(np.linspace(0, 1, 21), np.linspace(0, 1, 21), indexing="ij"), axis=-1).reshape(-1, 2)
    zero = np.zeros(len(grid))
    floor, wall = np.stack([grid[:, 0], zero, grid[:, 1]], axis=1), np.stack([zero, grid[:, 0], grid[:, 1]], axis=1)
    i, j = np.meshgrid(np.arange(20), np.arange(20), indexing="ij")
    corner = (i * 21 + j).ravel()
    faces = np.concatenate(
        [np.stack([corner, corner + 1, corner + 22], 1), np.stack([corner, corner + 22, corner + 21], 1)]
    )
    normals = np.repeat([[0, 1, 0], [1, 0, 0]], len(grid), axis=0).astype(np.float32)
    faces = np.concatenate([faces, faces[:, ::-1] + len(grid)]).astype(np.int32)
    colors = np.full((2 * len(grid), 3), 128, np.uint8)
    scene = Scene([Mesh(np.concatenate([floor, wall]).astype(np.float32), normals, faces, colors)])
    z = np.linspace(0.1, 0.9, 30)
    near = np.full(30, 0.02)
    means = np.concatenate([np.stack([near, near, z], 1), np.stack([near, near, z], 1)])
    scales = np.repeat([[0.03, 0.001, 0.03], [0.001, 0.03, 0.03]], 30, axis=0)
    splats = Splats(means, scales, np.tile([1, 0, 0, 0], (60, 1)), np.full(60, 0.9), np.zeros((60, 1, 3)))
    before = np.ones((2 * len(grid), 3), np.float32)
    after = np.repeat([[0.2] * 3, [1.0] * 3], len(grid), axis=0)
    result = linear_from_srgb(Binding(splats, scene, ()).relit(before, after).colors_diffuse) / linear_from_srgb(0.5)
    assert (result[:30] < 0.25).all()
    assert (result[30:] > 0.85).all()


def test_chunks_change_no_bit(ball):
    _, splats, binding = ball
    whole, cut = sphere_scene(), sphere_scene(300)
    assert len(whole.chunks) == 1
    assert len(cut.chunks) > 3
    other = Binding(splats, cut, views_around())
    results = [b.relit(*irradiances(s)).sh for b, s in ((binding, whole), (other, cut))]
    np.testing.assert_array_equal(*results)


def test_far_splats_take_a_smooth_mean():
    scene = sphere_scene()
    before, after = irradiances(scene)
    line = np.linspace(2.0, 60.0, 400)
    means = np.stack(
        [-0.5 + line, np.full(400, 0.25), np.full(400, -2.0)], axis=1
    )  # away along x, from the ball's centre
    splats = Splats(
        means, np.full((400, 3), 0.1), np.tile([1, 0, 0, 0], (400, 1)), np.full(400, 0.9), np.zeros((400, 1, 3))
    )
    logs = np.log(
        linear_from_srgb(Binding(splats, scene, ()).relit(before, after).colors_diffuse) / linear_from_srgb(0.5)
    )
    assert np.abs(np.diff(logs, axis=0)).max() < 0.04  # of 0.5 in all: no jump between neighbours 0.15 apart
    corner_mean = np.log(after / before).mean(axis=0)  # of vertices, which are not quite areas
    np.testing.assert_allclose(logs[-1], corner_mean, atol=0.05)
    assert np.abs(logs[0] - logs[-1]).max() > 0.1  # nearer the ball it is the side that it looks at


def test_damaged_splats_keep_their_bits_and_harm_no_other():
    scene, splats = sphere_scene(), ball_splats()
    before, after = irradiances(scene)
    bad = [3, 5, 8, 13, 21]
    arrays = [
        splats.means.copy(),
        splats.scales.copy(),
        splats.quats_wxyz.copy(),
        splats.opacities.copy(),
        splats.sh.copy(),
    ]
    arrays[0][3], arrays[1][5], arrays[2][8], arrays[4][13, 2, 1], arrays[0][21] = np.nan, np.inf, 0, np.nan, 1e30
    broken = Splats(*arrays)
    with pytest.warns(DataWarning, match="5 of 3000 splats are damaged"):
        binding = Binding(broken, scene, views_around())
    result = binding.relit(before, after)
    others = np.setdiff1d(np.arange(3000), bad)
    np.testing.assert_array_equal(result.sh[bad], broken.sh[bad])
    alone = Binding(splats.take(others), scene, views_around()).relit(before, after)
    np.testing.assert_array_equal(result.sh[others], alone.sh)


def test_the_order_of_splats_is_kept(ball):
    scene, splats, _ = ball
    before, after = irradiances(scene)
    mixed = np.random.default_rng(1).permutation(len(splats))
    plain, shuffled = (Binding(s, scene, ()).relit(before, after) for s in (splats, splats.take(mixed)))
    np.testing.assert_array_equal(plain.sh[mixed], shuffled.sh)


@pytest.mark.parametrize("count", [0, 1, 5])
def test_few_splats(count):
    scene, splats = sphere_scene(), ball_splats().take(slice(0, count))
    result = Binding(splats, scene).relit(*irradiances(scene))
    assert result.sh.shape == (count, 4, 3)
    assert np.isfinite(result.sh).all()


def test_highlights_fade_with_the_light_and_grow_only_with_the_whole_scene(ball):
    scene, splats, _ = ball
    before, _ = irradiances(scene)
    side = scene.vertices[:, :1] > 0
    after = np.where(side, 4.0, 0.05) * before  # brighter on one side, mean about 2
    result = Binding(splats, scene, ()).relit(before, after)
    x = (splats.means @ TILT[:3, :3].T + TILT[:3, 3])[:, 0]
    growth = np.linalg.norm(result.sh[:, 1:], axis=(1, 2)) / np.linalg.norm(splats.sh[:, 1:], axis=(1, 2))
    assert growth[x < -0.3].max() < 0.38  # 0.05^(1/2.4) = 0.29, softened
    # The mean of b over the two sides: what the whole scene grows by, were it even.
    mean = np.exp(np.log([4.0, 0.05]).mean() / CURVE_POWER)
    assert growth[x > 0.3].max() < max(mean, 1) + 0.05


def test_the_change_is_bounded_in_any_light():
    captured = np.array([[0.5, 0.5, 0.5], [0.0, 0.9, 1.0], [0.02, 0.3, 0.0]])
    before = np.array([[1.0, 0.0, 1e-9], [0.0, 0.0, 0.0], [2.0, 0.1, 1.0]])
    for after in (np.zeros((3, 3)), np.full((3, 3), 1e30), before[::-1]):
        logs, mean = log_gain(captured, before, after)
        assert np.isfinite(logs).all()
        assert np.isfinite(mean).all()
        shown = captured * np.exp(CURVE_POWER * logs.astype(np.float64))
        assert (shown <= 1.0 + 1e-3).all()  # the shoulder's room for what was captured white


def test_no_colour_clips_that_did_not_in_the_capture():
    rng = np.random.default_rng(4)
    captured, relit = ((rng.uniform(-0.2, 1.6, (2000, 3)) - 0.5).astype(np.float32) / np.float32(SH_C0) for _ in "ab")
    np.testing.assert_array_equal(without_clipping(captured, captured), captured)
    found = without_clipping(relit, captured)
    darker = relit <= captured
    np.testing.assert_array_equal(found[darker], relit[darker])
    before, wanted, shown = (0.5 + SH_C0 * each for each in (captured, relit, found))
    kept = wanted <= srgb_from_linear(np.float32(BURNING))
    np.testing.assert_array_equal(found[kept], relit[kept])
    assert (shown <= wanted + 1e-6).all()  # rounding of float32
    assert (shown[before < 0.99] < 1.0).all()
    # What was captured beyond white has a thousandth left to grow by.
    assert (shown <= np.maximum(before + 1e-3, 1.0)).all()


def test_colours_run_into_white_without_a_step_and_in_their_order():
    shown = np.linspace(0.9, 3.0, 5001)
    relit = np.repeat(((shown - 0.5) / SH_C0).astype(np.float32)[:, None], 3, axis=1)
    found = 0.5 + SH_C0 * without_clipping(relit, np.zeros_like(relit))[:, 0].astype(np.float64)
    steps = np.diff(found)
    assert (steps >= -1e-7).all() and steps.max() < 1.01 * (shown[1] - shown[0])  # rounding of float32
    # By hand: a linear 1 exceeds 0.926 by as much as is left to white, so half of that remains.
    at_one = 0.5 + SH_C0 * without_clipping(np.full((1, 3), 0.5 / SH_C0, np.float32), np.zeros((1, 3), np.float32))
    np.testing.assert_allclose(at_one, srgb_from_linear(np.float64((1.0 + BURNING) / 2)), atol=1e-6)


def test_a_part_of_a_scene_changes_as_it_does_in_the_whole(ball):
    rng = np.random.default_rng(3)
    captured, before, after = rng.uniform(0.01, 1.0, (3, 60, 3))
    whole, mean = log_gain(captured, before, after)
    usual = Usual.of(before, after, np.ones(60))._replace(gain=mean)
    rows = np.flatnonzero(before[:, 0] < 0.3)  # dim: their change depends on what is usual
    part, same = log_gain(captured[rows], before[rows], after[rows], usual=usual)
    np.testing.assert_array_equal(part, whole[rows])
    np.testing.assert_array_equal(same, mean)
    alone, _ = log_gain(captured[rows], before[rows], after[rows])
    assert np.abs(alone - whole[rows]).max() > 0.01
    scene, splats, _ = ball
    diagonal = 3.0 * Binding(splats, scene, views=()).surface.diagonal
    farther = Binding(splats, scene, views=(), diagonal=diagonal)
    assert farther.surface.diagonal == diagonal
    assert (farther.places.far <= Binding(splats, scene, views=()).places.far).all()


def test_captured_light_that_is_brighter_than_what_arrived_changes_as_the_scene_does():
    captured, before = np.full((100, 3), 0.3), np.full((100, 3), 1.0)
    captured[0], before[0] = 0.8, 0.001  # a lamp, or an error: eight hundred times what it received
    after = np.full((100, 3), 0.5)
    logs, _ = log_gain(captured, before, after)
    # Ratio of the lights there: 500, even when softened 12. Not one of a surface that was that bright before.
    assert np.exp(CURVE_POWER * logs[0]).max() < 0.6


@pytest.mark.parametrize(
    "change, message",
    [
        (lambda b, a: (b[:-1], a), "irradiance must be"),
        (lambda b, a: (b, a[:-1]), "must agree in shape"),
        (lambda b, a: (-b, a), "not negative"),
        (lambda b, a: (b, a * np.nan), "finite"),
    ],
)
def test_irradiances_that_do_not_fit_are_refused(ball, change, message):
    scene, _, binding = ball
    with pytest.raises(InputError, match=message):
        binding.relit(*change(*irradiances(scene)))


@pytest.mark.parametrize("exposure", [0.0, -1.0, np.nan, np.inf])
def test_exposures_that_are_none_are_refused(ball, exposure):
    scene, _, binding = ball
    with pytest.raises(InputError, match="exposure"):
        binding.relit(*irradiances(scene), exposure=exposure)


def test_dark_colours_stay_dark():
    """The affine map would lift black by 0.055 (g - 1); light of a tenth leaves nothing to show but black."""
    assert srgb_from_linear(0.1 * linear_from_srgb(0.04)) < 0.005
    scene, splats = sphere_scene(), ball_splats(0)
    black = Splats(
        *(getattr(splats, n) for n in ("means", "scales", "quats_wxyz", "opacities")), splats.sh * 0 - 0.46 / SH_C0
    )
    before, _ = irradiances(scene)
    assert Binding(black, scene, ()).relit(before, 0.1 * before).colors_diffuse.max() < 0.005


@pytest.mark.slow
def test_a_kept_binding_relights_to_the_same_bits(ball, tmp_path):
    scene, splats, _ = ball
    before, after = irradiances(scene)
    results, looked, counts = [], [], []
    for each in (splats, splats, splats.take(slice(0, 2900))):
        cache = Cache(tmp_path / "cache", "geometry")
        binding = Binding(each, scene, advance=looked.append, cache=cache)
        results.append(binding.relit(before, after).sh)
        counts.append(len(looked))
    np.testing.assert_array_equal(results[0], results[1])
    assert 0 < counts[0] == counts[1] < counts[2]  # the second time uses the cache; other splats are bound anew


def test_a_kept_surface_is_the_welded_one_and_another_is_welded_anew(ball, tmp_path):
    scene, cache, welded = ball[0], Cache(tmp_path / "cache", "geometry"), Surface(ball[0])
    Surface.kept_in(cache, scene)
    (path,) = (tmp_path / "cache").glob("surface-*")
    names = "points", "normals", "node", "faces", "areas", "used"
    with np.load(path) as file:
        arrays = dict(file)
    for broken in ({}, {"faces": arrays["faces"] + 1}, {"node": arrays["node"][1:]}, {"areas": arrays["normals"]}):
        with open(path, "wb") as file:
            np.savez(file, **arrays | broken)
        found = Surface.kept_in(cache, scene)
        assert found.diagonal == welded.diagonal
        for name in names:
            np.testing.assert_array_equal(getattr(found, name), getattr(welded, name))
            assert getattr(found, name).dtype == getattr(welded, name).dtype


def test_shading_once_more_is_relighting_in_the_product_of_both(ball):
    scene, _, binding = ball
    before, after = irradiances(scene)
    after = 0.6 * after  # nothing runs into 1
    base = binding.relit(before, after, rounds=0)
    np.testing.assert_array_equal(binding.shaded(base, np.ones_like(after)).sh, base.sh)
    ratio = np.where(scene.vertices[:, :1] > 0.3, np.float32([0.5, 0.6, 0.7]), np.float32(1.0))
    found, known = binding.shaded(base, ratio), binding.relit(before, ratio * after, rounds=0)
    changed = known.sh[:, 0] - base.sh[:, 0]
    # The softness of a light ratio, .01 of it, is not multiplied, and the mean gain caps what depends on the view.
    np.testing.assert_allclose(found.sh[:, 0], known.sh[:, 0], atol=0.03 * np.abs(changed).max())
    same = (found.sh == base.sh).all(axis=(1, 2))
    assert 0.2 < same.mean() < 0.9
