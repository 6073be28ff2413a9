"""Radiance transfer: closed forms, quadrature with SciPy's harmonics, what ray tracing may not depend on."""

import numpy as np
import open3d as o3d
import pytest
from scipy.special import sph_harm_y
from shadow_meshes import knobbed_torus, mesh_arrays

from relight.sh.normals import unit_normals
from relight.transfer import lobes, sampling
from relight.transfer.analytic import analytic
from relight.transfer.occluder import Occluder
from relight.transfer.visibility import raytraced_scene
from scenes.plain_rays import raytraced
from splat2mesh.base.errors import DataWarning, InputError

EVERY = slice(None)
Y0 = np.sqrt(0.25 / np.pi)
ROUNDING = 4 * np.finfo(np.float32).eps


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


def directions_about(normal, count):
    """Cosine-weighted directions, count^2 of them: a product rule in sin^2 and azimuth."""
    square, turn = np.meshgrid((np.arange(count) + 0.5) / count, 2 * np.pi * (np.arange(count) + 0.5) / count)
    local = np.stack([np.sqrt(square) * np.cos(turn), np.sqrt(square) * np.sin(turn), np.sqrt(1 - square)], axis=-1)
    tangent = np.linalg.svd(normal[None])[2][1:]
    return local.reshape(-1, 3) @ np.stack([*tangent, normal])


def random_normals(count, seed=0):
    normals = np.random.default_rng(seed).normal(size=(count, 3))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


@pytest.fixture(scope="module")
def torus():
    """A torus with a knob in its hole: (vertices, normals, faces) with every degree of occlusion."""
    return knobbed_torus(24, 16, 0.3, 8)


@pytest.fixture(scope="module")
def converged(torus):
    return raytraced(Occluder(*torus), EVERY, 5, 2**14, seed=99)


def error(transfer, reference):
    return np.linalg.norm(transfer - reference) / np.linalg.norm(reference)


def square(corner, edge_u, edge_v):
    """Two triangles, with their own four vertices: vertices, normals, faces."""
    corner, u, v = (np.asarray(a, np.float32) for a in (corner, edge_u, edge_v))
    normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
    vertices = np.stack([corner, corner + u, corner + u + v, corner + v])
    return vertices, np.tile(normal, (4, 1)), np.array([[0, 1, 2], [0, 2, 3]])


def joined(*parts):
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts[:-1]])
    vertices, normals, faces = zip(*parts, strict=True)
    faces = [part + offset for part, offset in zip(faces, offsets, strict=True)]
    return np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces)


def room(inward=1.0):
    """A unit cube of six squares with hard edges, normals pointing inwards: 24 vertices."""
    sides = []
    for axis in range(3):
        u, v, w = np.roll(np.eye(3), axis, axis=0)
        sides += [square(np.zeros(3), u, v), square(w, v, u)]
    vertices, normals, faces = joined(*sides)
    return vertices, inward * normals, faces


# -- analytic


def test_constant_sky_on_a_white_vertex_gives_one():
    transfer = analytic(random_normals(500), 10)
    assert transfer.dtype == np.float32
    np.testing.assert_allclose(transfer[:, 0] / Y0, 1.0, rtol=ROUNDING)


@pytest.mark.parametrize("bands", [1, 3, 10])
def test_analytic_is_the_clamped_cosine_integral(bands):
    # The rule integrates polynomials in sin^2 at O(1 / count^2) and odd powers of cos at O(count^-1.5).
    for normal in random_normals(2, seed=1):
        expected = scipy_basis(directions_about(normal, 160), bands).mean(axis=0)
        np.testing.assert_allclose(analytic(normal[None], bands)[0], expected, atol=2e-4)


def test_degenerate_normals_face_up_and_are_counted():
    normals = np.array([[0, 0, 0], [np.nan, 0, 1], [0, 0, 5], [np.inf, 0, 0]])
    with pytest.warns(DataWarning, match="3 of 4 vertices have no normal"):
        unit = unit_normals(normals)
    np.testing.assert_array_equal(unit, [[0, 1, 0], [0, 1, 0], [0, 0, 1], [0, 1, 0]])


@pytest.mark.parametrize("bands", [0, 11, 2.5])
def test_bands_out_of_range_are_refused(bands, torus):
    with pytest.raises(InputError, match="from 1 to 10"):
        analytic(random_normals(1), bands)
    with pytest.raises(InputError, match="from 1 to 10"):
        raytraced(Occluder(*torus), EVERY, bands, 4)


# -- the compiled loops


def test_rays_are_unit_cosine_distributed_and_start_at_their_origin():
    normals = np.concatenate([random_normals(200), np.eye(3), -np.eye(3)]).astype(np.float32)
    origins = np.random.default_rng(2).normal(size=normals.shape).astype(np.float32)
    rays = np.zeros((len(normals), 256, 6), np.float32)
    sampling.shoot(origins, normals, sampling.fibonacci_azimuths(256), 0, rays)
    np.testing.assert_array_equal(rays[:, :, :3], np.broadcast_to(origins[:, None], rays[:, :, :3].shape))
    np.testing.assert_allclose(np.linalg.norm(rays[:, :, 3:], axis=-1), 1.0, atol=ROUNDING)
    cosine = np.einsum("vrk,vk->vr", rays[:, :, 3:], normals)
    assert cosine.min() > -ROUNDING
    # Moments of the cosine lobe: E[cos] = 2/3, E[cos^2] = 1/2; the strata leave an error of the order 1 / R.
    np.testing.assert_allclose(cosine.mean(axis=1), 2 / 3, atol=2 / 256)
    np.testing.assert_allclose((cosine**2).mean(axis=1), 1 / 2, atol=2 / 256)
    # Directions average to 2/3 n: nothing leans sideways.
    np.testing.assert_allclose(rays[:, :, 3:].mean(axis=1), 2 / 3 * normals, atol=0.01)


@pytest.mark.parametrize("bands", range(1, 11))
def test_gather_is_a_ridge_fit_and_what_it_leaves(bands):
    rng = np.random.default_rng(3)
    normals = random_normals(20).astype(np.float32)
    rays = np.zeros((20, 64, 6), np.float32)
    sampling.shoot(normals, normals, sampling.fibonacci_azimuths(64), 0, rays)
    occluded = rng.random((20, 64)) < rng.random((20, 1))
    model, rest = np.zeros((20, 4), np.float32), np.zeros((20, bands**2), np.float32)
    sampling.gather(rays, occluded, normals, model, rest)

    for v in range(20):
        directions, visible = rays[v, :, 3:].astype(np.float64), ~occluded[v]
        n = normals[v].astype(np.float64)
        # Moments of the cosine lobe: mean d = 2/3 n, mean d d' = (1 + n n') / 4; those of the set replaced by them.
        moment = ((visible - visible.mean())[:, None] * directions).mean(axis=0) + visible.mean() * 2 / 3 * n
        along = np.outer(n, n)
        ridge = float(sampling.RIDGE_NORMAL) * along + float(sampling.RIDGE_TANGENT) * (np.eye(3) - along)
        gram = np.block([[np.ones((1, 1)), 2 / 3 * n[None]], [2 / 3 * n[:, None], (np.eye(3) + along) / 4 + ridge]])
        fit = np.linalg.solve(gram, np.append(visible.mean(), moment))
        np.testing.assert_allclose(model[v], fit, atol=2e-5)  # 1 / 0.066 times the rounding of a sum of 64
        left = visible - fit[0] - directions @ fit[1:]
        np.testing.assert_allclose(rest[v], left @ scipy_basis(directions, bands) / 64, atol=1e-5)


def test_gather_of_rays_that_agree_is_exact():
    normals = random_normals(30).astype(np.float32)
    rays = np.zeros((30, 13, 6), np.float32)
    sampling.shoot(normals, normals, sampling.fibonacci_azimuths(13), 0, rays)
    for occluded, fraction in ((False, 1.0), (True, 0.0)):
        model, rest = np.full((30, 4), 7, np.float32), np.full((30, 9), 7, np.float32)
        sampling.gather(rays, np.full((30, 13), occluded), normals, model, rest)
        np.testing.assert_array_equal(model, np.tile([fraction, 0, 0, 0], (30, 1)))
        assert not rest.any()


@pytest.mark.parametrize("bands", range(1, 11))
def test_transfer_of_a_linear_visibility_is_its_cosine_integral(bands):
    rng = np.random.default_rng(8)
    normals = np.concatenate([random_normals(4, seed=9), np.eye(3), -np.eye(3)]).astype(np.float32)
    model = rng.normal(size=(len(normals), 4)).astype(np.float32)
    rest = rng.normal(size=(len(normals), bands**2)).astype(np.float32)
    transfer = analytic(normals, bands)
    lobes.add_model(normals, model, rest, transfer)
    nodes, weights = np.polynomial.legendre.leggauss(16)
    for row, normal, (a, *b), extra in zip(transfer, normals.astype(np.float64), model, rest, strict=True):
        # Exact rule: Gauss in u = cos over 0..1 with weight 2 u, 24 azimuths; degree 9 + 1, times u.
        u, turn = np.meshgrid((nodes + 1) / 2, 2 * np.pi * np.arange(24) / 24)
        flat = np.sqrt(1 - u * u)
        local = np.stack([flat * np.cos(turn), flat * np.sin(turn), u], axis=-1).reshape(-1, 3)
        tangents = np.linalg.svd(normal[None])[2][1:]
        directions = local @ np.stack([*tangents, normal])
        weight = (np.tile(weights, 24) * u.ravel() / 24) * (a + directions @ np.array(b, np.float64))
        expected = weight @ scipy_basis(directions / np.linalg.norm(directions, axis=1, keepdims=True), bands) + extra
        np.testing.assert_allclose(row, expected, atol=3e-6 * bands)  # float32 recurrences, values up to 3


def test_hashed_offsets_are_uniform_and_independent():
    normals = random_normals(4096).astype(np.float32)
    offsets = sampling.hashed_offsets(np.roll(normals, 1, axis=1), normals, 5)
    counts = np.histogram2d(*offsets.T, bins=8, range=[[0, 1], [0, 1]])[0]
    assert offsets.min() >= 0 and offsets.max() < 1 and counts.sum() == 4096
    chi_square = ((counts - 64) ** 2 / 64).sum()
    assert 30 < chi_square < 110  # 63 degrees of freedom: 63 +- 11


def test_ranked_offsets_fill_the_square_evenly_in_every_run():
    offsets = sampling.ranked_offsets(10**6 + np.arange(4096), seed=5)
    assert offsets.dtype == np.float32 and offsets.min() >= 0 and offsets.max() < 1
    np.testing.assert_array_equal(sampling.ranked_offsets(10**6 + np.arange(100, 164), seed=5), offsets[100:164])
    for start in range(0, 4096, 256):
        counts = np.histogram2d(*offsets[start : start + 256].T, bins=8, range=[[0, 1], [0, 1]])[0]
        assert counts.min() >= 2 and counts.max() <= 7  # 4 expected; independent ones: 0 and 11
    assert (sampling.ranked_offsets(np.arange(64), seed=6) != sampling.ranked_offsets(np.arange(64), seed=7)).all()


# -- closed forms of visibility


def test_convex_body_is_analytic_to_the_bit():
    mesh = o3d.geometry.TriangleMesh.create_sphere(2.0, 12)
    vertices, _, faces = mesh_arrays(mesh)
    occluder = Occluder(vertices, vertices, faces)
    np.testing.assert_array_equal(raytraced(occluder, EVERY, 4, 64), analytic(occluder.normals, 4))


def test_box_is_dark_inside_and_bright_outside():
    assert not raytraced(Occluder(*room()), EVERY, 3, 256).any()
    outside = raytraced(Occluder(*room(-1.0)), EVERY, 3, 256)
    np.testing.assert_array_equal(outside, analytic(room(-1.0)[1], 3))
    vertices = o3d.geometry.TriangleMesh.create_box()
    vertices, _, faces = mesh_arrays(vertices)
    assert not raytraced(Occluder(vertices, 0.5 - vertices, faces), EVERY, 3, 256).any()


@pytest.mark.parametrize("wall_faces_floor", [True, False])
def test_wall_against_its_form_factor(wall_faces_floor):
    # A wall of height 1, endless along z, hides (1 - cos(elevation of its top)) / 2 of the floor's lobe.
    distance = np.array([0.0, 0.3, 1.0, 3.0])
    parts = [square((-x, 0, 0), (-0.1, 0, 0), (0, 0, 0.1)) for x in distance]
    sides = ((0, 0, 40), (0, 1, 0)) if wall_faces_floor else ((0, 1, 0), (0, 0, 40))
    walls = [square((0, 0, z), *sides) for z in (-40, 0)]
    occluder = Occluder(*joined(*parts, *walls))
    transfer = raytraced(occluder, np.arange(0, 16, 4), 5, 4096)
    hidden = 0.5 * (1 - distance / np.sqrt(distance**2 + 1))
    # 4096 rays hit a straight edge to a few rows of the set, 2 / sqrt(4096) / pi; the offset adds 0.1 * 0.05.
    np.testing.assert_allclose(transfer[1:, 0] / Y0, 1 - hidden[1:], atol=0.01)
    for row, x in zip(transfer[1:], distance[1:], strict=True):
        directions = directions_about(np.array([0.0, 1.0, 0.0]), 300)
        free = (directions[:, 0] <= 0) | (directions[:, 1] * x > directions[:, 0])
        np.testing.assert_allclose(row, (scipy_basis(directions, 5) * free[:, None]).mean(axis=0), atol=0.01)
    if wall_faces_floor:  # in the very corner, where floor and wall share a position
        assert transfer[0, 0] / Y0 == pytest.approx(0.5, abs=0.01)


# -- what the result may not depend on


def test_error_falls_faster_than_at_random(torus, converged):
    occluder = Occluder(*torus)
    few, many = (error(raytraced(occluder, EVERY, 5, rays), converged) for rays in (64, 1024))
    assert few < 0.06
    assert many < few * 16**-0.6  # independent random rays: 16^-0.5


def test_vertex_order_and_slices_change_no_bit(torus):
    vertices, normals, faces = torus
    whole = raytraced(Occluder(*torus), EVERY, 5, 48)
    order = np.random.default_rng(4).permutation(len(vertices))
    place = np.argsort(order)
    shuffled = Occluder(vertices[order], normals[order], place[faces][::-1])
    np.testing.assert_array_equal(raytraced(shuffled, EVERY, 5, 48), whole[order])
    for count in (2, 7):
        cuts = np.array_split(np.arange(len(vertices)), count)
        parts = [raytraced(Occluder(*torus), part, 5, 48) for part in cuts]
        np.testing.assert_array_equal(np.concatenate(parts), whole)


def test_vertices_of_both_signs_of_zero_are_the_same():
    vertices, normals, faces = mesh_arrays(o3d.geometry.TriangleMesh.create_torus(1.0, 0.5, 12, 8))
    signed = [np.where(a == 0, -0.0, a).astype(np.float32) for a in (vertices, normals)]
    expected = raytraced(Occluder(vertices, normals, faces), EVERY, 3, 16)
    np.testing.assert_array_equal(raytraced(Occluder(*signed, faces), EVERY, 3, 16), expected)


@pytest.mark.parametrize("scale", [2.0**-13, 2.0**20])
def test_scale_by_powers_of_two_changes_no_bit(torus, scale):
    vertices, normals, faces = torus
    scaled = raytraced(Occluder(vertices * np.float32(scale), normals, faces), EVERY, 5, 48)
    np.testing.assert_array_equal(scaled, raytraced(Occluder(*torus), EVERY, 5, 48))


@pytest.mark.parametrize(
    ("scale", "shift"),
    [(1e-4, 0.0), (1e6, 0.0), (1.0, 1e4), (1e-3, 10.0)],
    ids=["1e-4", "1e6", "far", "far and small"],
)
def test_any_size_and_place_is_as_accurate(torus, converged, scale, shift):
    vertices, normals, faces = torus
    moved = (vertices.astype(np.float64) * scale + shift).astype(np.float32)
    here = error(raytraced(Occluder(*torus), EVERY, 5, 256), converged)
    there = error(raytraced(Occluder(moved, normals, faces), EVERY, 5, 256), converged)
    assert there < 1.3 * here + 0.01 * (shift > 0)  # far away float32 itself bends the mesh


def test_seed_changes_the_noise_only(torus, converged):
    occluder = Occluder(*torus)
    first, again, other = (raytraced(occluder, EVERY, 5, 64, seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any(axis=1).mean() > 0.3  # of the vertices in partial shadow
    both = error((first + other) / 2, converged)
    assert both < 0.85 * error(first, converged)  # independent noise: 1 / sqrt(2)


def test_neighbours_have_independent_noise(torus, converged):
    noise = raytraced(Occluder(*torus), EVERY, 3, 64) - converged[:, :9]
    first, second = noise[torus[2][:, 0]], noise[torus[2][:, 1]]
    correlation = (first * second).sum() / np.sqrt((first**2).sum() * (second**2).sum())
    assert abs(correlation) < 0.2  # one direction set for all vertices: 0.9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v, n, f: (v, n, f[:0]), "F > 0"),
        (lambda v, n, f: (v, n[:-1], f), "shape"),
        (lambda v, n, f: (v, n, f + len(v)), "faces name vertices"),
        (lambda v, n, f: (v * np.float32(np.nan), n, f), "not finite"),
        (lambda v, n, f: (v * np.float32(0), n, f), "spans 0.0 units"),
    ],
)
def test_meshes_that_cannot_be_lit_are_refused(torus, change, message):
    with pytest.raises(InputError, match=message):
        Occluder(*change(*torus))


@pytest.mark.parametrize("rays", [0, -1, 1.5, 10**9])
def test_ray_counts_out_of_range_are_refused(torus, rays):
    with pytest.raises(InputError, match="from 1 to 65536"):
        raytraced(Occluder(*torus), EVERY, 3, rays)


def test_progress_counts_every_vertex(torus):
    done = []
    raytraced_scene(Occluder(*torus), 1, 2**12, advance=done.append)
    assert sum(done) == len(torus[0]) and len(done) > 1
