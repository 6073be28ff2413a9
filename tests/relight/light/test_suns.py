"""Suns: what is taken out of the harmonics, exactly, and what rays then make of it."""

import numpy as np
import open3d as o3d
import pytest
from scipy.special import sph_harm_y

from relight import Environment
from relight.light import sun_split
from relight.light.environment import Suns
from relight.light.projections import row_solid_angles, texel_directions
from relight.light.sun_split import split
from relight.transfer import sunlight as sunlight_module
from relight.transfer.occluder import Occluder
from relight.transfer.reference import reference
from relight.transfer.sunlight import sunlight
from scenes.plain_rays import raytraced
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.base.sphere import fibonacci_sphere

EVERY = slice(None)
HEIGHT, WIDTH = 128, 256


def scipy_basis(directions, bands):
    """The basis of relight.sh by another route: SciPy's complex harmonics, made real and all-positive."""
    x, y, z = directions.T
    theta, phi = np.arccos(np.clip(z, -1, 1)), np.arctan2(y, x)
    columns = []
    for degree in range(bands):
        for m in range(-degree, degree + 1):
            value = sph_harm_y(degree, abs(m), theta, phi) * (-1) ** m
            columns.append(value.real if m == 0 else np.sqrt(2) * (value.imag if m < 0 else value.real))
    return np.stack(columns, axis=1)


def sky(rows=HEIGHT, columns=WIDTH):
    """A smooth coloured sky, between 0.5 and 1.5."""
    x, y, _ = np.moveaxis(texel_directions(rows, columns), -1, 0)
    return (1 + 0.5 * y[..., None] * [0.8, 0.9, 1.0] - 0.2 * x[..., None] * [0.2, 0.1, 0.0]).astype(np.float32)


def windows(seed=0):
    """Bright rectangles of many sizes in a dim room, one of them across the seam, and a lamp."""
    rng = np.random.default_rng(seed)
    image = 0.3 * sky()
    for _ in range(6):
        row, column = rng.integers(20, 90), rng.integers(0, WIDTH - 20)
        high, wide = rng.integers(4, 16, 2)
        image[row : row + high, column : column + wide] = rng.uniform(5, 15) * rng.uniform(0.7, 1.0, 3)
    image[40:52, [-6, -5, -4, -3, -2, -1, 0, 1, 2, 3]] = 9.0
    image[30:32, 70:72] = 300.0
    return Environment(image)


def energy(image):
    return (image.astype(np.float64) * row_solid_angles(*image.shape[:2])[..., None]).sum(axis=(0, 1))


def mesh_arrays(mesh):
    mesh.compute_vertex_normals()
    return np.asarray(mesh.vertices, np.float32), np.asarray(mesh.vertex_normals), np.asarray(mesh.triangles)


@pytest.fixture(scope="module")
def torus():
    """A torus with a knob in its hole: an Occluder of every degree of shadow."""
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, 24, 16)
    mesh += o3d.geometry.TriangleMesh.create_sphere(0.3, 8)
    return Occluder(*mesh_arrays(mesh))


def unit(seed, count):
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def some_suns(count, seed=5):
    return Suns(unit(seed, count), np.random.default_rng(seed).random((count, 3)) * 3)


# -- what the split conserves


@pytest.mark.parametrize("angle_deg", [0.0, 77.3])
def test_rest_and_suns_have_the_coefficients_of_the_whole_in_any_bands(angle_deg):
    whole = windows().rotated(angle_deg)
    rest, taken = split(whole, bands=5)
    assert len(taken) > 3
    for bands in (1, 3, 5, 10):
        both = rest.sh(bands) + scipy_basis(taken.directions, bands).T @ taken.weights
        expected = whole.sh(bands)
        # Rounding of 50 sums and of SciPy's harmonics of degree 9.
        np.testing.assert_allclose(both, expected, atol=1e-12 * np.abs(expected).max())


def test_the_images_energy_is_shared_out_to_float32():
    whole = windows()
    rest, taken = split(whole)
    kept = energy(rest.radiance) + taken.weights.sum(axis=0)
    np.testing.assert_allclose(kept, energy(whole.radiance), rtol=1e-6)
    assert (taken.weights >= 0).all() and (rest.radiance >= 0).all() and (rest.radiance <= whole.radiance).all()


@pytest.mark.parametrize("name", ["constant", "black", "overcast"])
def test_light_that_the_bands_hold_comes_back_itself(name):
    levels = {"constant": 1.0, "black": 0.0}
    light = Environment(np.full((16, 32, 3), levels[name])) if name in levels else Environment.load(name)
    rest, taken = split(light)
    assert rest is light and len(taken) == 0


@pytest.mark.parametrize(("row", "column"), [(30, 70), (0, 9), (127, 200), (64, 0), (64, 255)])
@pytest.mark.parametrize("angle_deg", [0.0, -33.3])
def test_one_lit_texel_is_one_sun_of_all_its_energy(row, column, angle_deg):
    """Inside, in both polar rows and on both sides of the seam."""
    image = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    image[row, column] = [1e9, 5e8, 2.5e8]
    rest, taken = split(Environment(image).rotated(angle_deg))
    angle = np.radians(angle_deg)
    x, y, z = texel_directions(HEIGHT, WIDTH)[row, column]
    turned = [np.cos(angle) * x + np.sin(angle) * z, y, np.cos(angle) * z - np.sin(angle) * x]
    np.testing.assert_allclose(taken.directions, [turned], atol=1e-12)
    np.testing.assert_allclose(taken.weights, [energy(image)], rtol=1e-6)  # but 1e-9 that the fall leaves
    assert energy(rest.radiance).max() < 1e-6 * energy(image).max()


@pytest.mark.parametrize("height", [16, 640])
def test_coarse_and_fine_images_split_too(height):
    image = sky(height, 2 * height)
    size = max(1, height // 256)
    row, column = height // 3, height // 2
    image[row : row + size, column : column + size] = 3e5 / size**2
    rest, taken = split(Environment(image))
    toward = texel_directions(height, 2 * height)[row, column]
    # Within the texel of the coarse image, which is a patch of 11 degrees, or the few of the fine one.
    assert (taken.directions @ toward > np.cos(np.pi / height * max(1.0, 1.5 * size))).all()
    sunny = Environment(image).radiance.astype(np.float64) - rest.radiance
    np.testing.assert_allclose(taken.weights.sum(axis=0), energy(sunny), rtol=1e-6)


@pytest.mark.parametrize("place", ["seam", "pole"])
def test_a_disc_on_the_seam_and_over_the_pole_is_taken_whole(place):
    center = np.array([0.0, 1.0, 0.0] if place == "pole" else [0.0, 0.0, -1.0])
    inside = texel_directions(HEIGHT, WIDTH) @ center > np.cos(np.radians(3.0))
    image = sky()
    image[inside] = 2000.0
    rest, taken = split(Environment(image))
    assert (taken.directions @ center > np.cos(np.radians(4.0))).all()  # texels of 1.4 degrees straddle the rim
    moment = taken.weights.sum(axis=1) @ taken.directions
    # The disc is even about its centre but for the texels of its rim.
    assert moment @ center / np.linalg.norm(moment) > np.cos(np.radians(0.1))
    assert rest.radiance[inside].max() < 100.0  # the level: some multiple of the mean, 2.5


def test_what_surrounds_a_sun_stays_where_it_stood():
    image = sky()
    around = image[50:52, 80:82].copy()
    image[50:52, 80:82] *= 3e4
    rest, taken = split(Environment(image))
    assert len(taken) >= 1
    # The sky changes by less within 2 degrees.
    np.testing.assert_allclose(rest.radiance[50:52, 80:82], around, rtol=0.1)
    untouched = np.ones((HEIGHT, WIDTH), bool)
    untouched[50:52, 80:82] = False
    np.testing.assert_array_equal(rest.radiance[untouched], image[untouched])


def test_repaired_pixels_are_split_as_repaired():
    image = sky()
    image[50, 80] = np.inf
    image[51, 81] = np.nan
    image[10, 10] = -1e9
    image[60:62, 20:22] = 3e4
    with pytest.warns(DataWarning):
        light = Environment(image)
    rest, taken = split(light)
    assert np.isfinite(taken.weights).all() and np.isfinite(rest.sh(10)).all()
    assert rest.repaired == light.repaired


def test_split_is_found_once_for_all_rotations(monkeypatch):
    calls = []
    once = sun_split._split
    monkeypatch.setattr(sun_split, "_split", lambda *arguments: calls.append(0) or once(*arguments))
    light = windows()
    first_rest, first = split(light.rotated(20.0))
    rest, taken = split(light.rotated(50.0))
    assert len(calls) == 1
    np.testing.assert_allclose(first.rotated(30.0).directions, taken.directions, atol=1e-15 * 4)
    np.testing.assert_array_equal(first.weights, taken.weights)
    np.testing.assert_allclose(first_rest.rotated(30.0).sh(4), rest.sh(4), atol=1e-12)
    np.testing.assert_array_equal(rest.rotated(360.0).sh(4), rest.sh(4))


def test_limit_and_tolerance_are_kept():
    light = windows()
    counts = [len(split(light, tolerance=tolerance)[1]) for tolerance in (0.05, 0.02, 0.01)]
    assert counts == sorted(counts) and counts[0] < counts[-1]
    assert len(split(light, tolerance=1e-4, limit=7)[1]) <= 7


@pytest.mark.parametrize(
    ("options", "message"),
    [({"tolerance": 0.0}, "above 0"), ({"limit": 0}, "above 0"), ({"limit": 2.5}, "whole"), ({"bands": 11}, "1 to 10")],
)
def test_options_that_make_no_sense_are_refused(options, message):
    with pytest.raises(InputError, match=message):
        split(windows(), **options)


# -- what it is good for


@pytest.mark.parametrize(("name", "gain"), [("noon", 8.0), ("windows", 2.0)])
def test_errors_stay_below_one_percent(torus, name, gain):
    light = windows() if name == "windows" else Environment.load(name)
    expected = reference(torus, EVERY, light, 8192)
    transfer = raytraced(torus, EVERY, 10, 1024)
    rest, taken = split(light)

    def error(radiance):
        return np.linalg.norm(radiance - expected) / np.linalg.norm(expected)

    with_suns = error(transfer @ rest.sh(10) + sunlight(torus, EVERY, taken))
    assert with_suns < 0.01
    assert with_suns < error(np.maximum(transfer @ light.sh(10), 0)) / gain


def test_error_at_an_edge_is_the_documented_integral():
    """A round normal spot shining as a point, over random normals and walls: the constant by Monte Carlo."""
    rng = np.random.default_rng(3)
    spread, samples = 0.05, 40_000
    toward = rng.normal(size=(400, 3)) * spread + [0, 0, 1]
    toward = toward[:, :2] - toward[:, :2].mean(axis=0)
    normals = unit(4, samples)
    # Only walls near the spot matter: those within 6 spreads, and what share of all walls they are.
    distance = rng.uniform(-6 * spread, 6 * spread, samples)
    turn = rng.uniform(0, 2 * np.pi, samples)
    across = toward @ np.stack([np.cos(turn), np.sin(turn)])
    wrong = (across > distance).mean(axis=0) - (distance < 0)
    cosine = np.maximum(normals[:, 2], 0)
    share = 6 * spread  # density 1/2 over a width of 12 spreads
    measured = (wrong**2).mean() * share * (cosine**2).mean() / np.pi**2
    # 40,000 walls of which a sixth matter: 2%; 400 points of the spot: 3%.
    assert sun_split._EDGE_ERROR * spread == pytest.approx(measured, rel=0.1)


# -- rays to the suns


def hits(origin, direction, corners):
    """Whether a ray meets any triangle (F, 3, 3), by Moeller and Trumbore."""
    first, edge_u, edge_v = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(direction, edge_v)
    determinant = (edge_u * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        offset = origin - first
        u = (offset * across).sum(axis=1) / determinant
        around = np.cross(offset, edge_u)
        v, t = (around @ direction) / determinant, (edge_v * around).sum(axis=1) / determinant
        return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).any())


def test_sunlight_is_the_sum_over_visible_suns():
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, 12, 8)
    vertices, normals, faces = mesh_arrays(mesh)
    occluder = Occluder(vertices, normals, faces)
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    corners = ((vertices - (low + high) / 2) / np.linalg.norm(high - low))[faces]
    lights = some_suns(6)
    shadowed = 0
    found = sunlight(occluder, EVERY, lights)
    for v, (origin, normal) in enumerate(zip(occluder.origins.astype(float), occluder.normals, strict=True)):
        expected = np.zeros(3)
        for direction, weight in zip(lights.directions, lights.weights, strict=True):
            facing = normal @ direction
            if facing > 0:
                hidden = hits(origin, direction, corners)
                shadowed += hidden
                expected += (not hidden) * facing * weight / np.pi
        np.testing.assert_allclose(found[v], expected, atol=1e-6)  # float32 of values up to 3
    assert shadowed > 20


def test_suns_all_around_are_a_constant_sky():
    vertices, _, faces = mesh_arrays(o3d.geometry.TriangleMesh.create_sphere(2.0, 12))
    count = 4000
    even = Suns(fibonacci_sphere(count), np.full((count, 3), 4 * np.pi / count))
    # The clamped cosine has a kink: the Fibonacci sum is good to count^-1.
    np.testing.assert_allclose(sunlight(Occluder(vertices, vertices, faces), EVERY, even), 1.0, atol=1e-3)


def test_order_and_slices_of_vertices_and_batches_change_no_bit(torus, monkeypatch):
    lights = some_suns(40)
    whole = sunlight(torus, EVERY, lights)
    order = np.random.default_rng(1).permutation(len(whole))
    np.testing.assert_array_equal(sunlight(torus, order, lights), whole[order])
    parts = [sunlight(torus, part, lights) for part in np.array_split(np.arange(len(whole)), 7)]
    np.testing.assert_array_equal(np.concatenate(parts), whole)
    monkeypatch.setattr(sunlight_module, "BATCH_RAYS", 1000)
    done = []
    np.testing.assert_array_equal(sunlight(torus, EVERY, lights, done.append), whole)
    assert sum(done) == len(whole) and len(done) > 1
    monkeypatch.setattr("splat2mesh.base.threads.all_cores", lambda: 1)
    np.testing.assert_array_equal(sunlight(torus, EVERY, lights), whole)


def test_sunlight_adds_up_and_no_suns_are_dark(torus):
    lights = some_suns(9)
    each = [sunlight(torus, EVERY, Suns(lights.directions[i : i + 1], lights.weights[i : i + 1])) for i in range(9)]
    # Nine float32 terms of up to 1 against one float64 sum.
    np.testing.assert_allclose(sunlight(torus, EVERY, lights), np.sum(each, axis=0), atol=2e-6)
    dark = sunlight(torus, EVERY, Suns(np.zeros((0, 3)), np.zeros((0, 3))))
    assert dark.shape == (len(torus.origins), 3) and not dark.any()


def test_sun_directions_must_be_unit_vectors(torus):
    with pytest.raises(InputError, match=r"length 2\.0"):
        sunlight(torus, EVERY, Suns(np.array([[0.0, 2.0, 0.0]]), np.ones((1, 3))))
