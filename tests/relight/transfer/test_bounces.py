"""Interreflection: form factors, closed rooms, a dense solution, a path tracer, what it may not depend on."""

import os

import numpy as np
import open3d as o3d
import pytest

from relight.transfer import sampling
from relight.transfer.bounce_places import batch_of
from relight.transfer.bounce_rows import FINENESS
from relight.transfer.bounces import (
    DEFAULT_MAX_BOUNCES,
    Interreflection,
    transfer_with_bounces,
    visible_fraction,
    with_bounces,
)
from relight.transfer.occluder import Occluder
from scenes.plain_rays import raytraced
from splat2mesh.base.errors import InputError

EVERY = slice(None)
ROUNDING = 16 * np.finfo(np.float32).eps
"""Of sums of up to 3 x 256 float32 weights in a row, which err on both sides."""


def grid(corner, edge_u, edge_v, count):
    """A square of count x count cells with its own vertices: vertices, normals, faces; normal along u x v."""
    u, v = np.meshgrid(*2 * [np.linspace(0, 1, count + 1)], indexing="ij")
    corner, edge_u, edge_v = (np.asarray(a, float) for a in (corner, edge_u, edge_v))
    vertices = corner + u.reshape(-1, 1) * edge_u + v.reshape(-1, 1) * edge_v
    normal = np.cross(edge_u, edge_v)
    first = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).reshape(-1, 1)
    faces = (first + np.array([0, count + 1, count + 2, 0, count + 2, 1])).reshape(-1, 3)
    return vertices.astype(np.float32), np.tile(normal / np.linalg.norm(normal), (len(vertices), 1)), faces


def joined(*parts):
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _ in parts[:-1]])
    vertices, normals, faces = zip(*parts, strict=True)
    faces = [part + offset for part, offset in zip(faces, offsets, strict=True)]
    return np.concatenate(vertices), np.concatenate(normals), np.concatenate(faces)


def box(count, sides=6):
    """The inside of a unit cube, or of one without its last sides: the sixth is its lid."""
    x, y, z = np.eye(3)
    squares = [((0, 0, 0), z, x), ((0, 0, 0), x, y), (z, y, x), ((0, 0, 0), y, z), (x, z, y), (y, x, z)]
    return joined(*(grid(*square, count) for square in squares[:sides]))


def ball(radius, center, resolution, outward=1.0):
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    vertices = np.asarray(mesh.vertices)
    return (vertices + center).astype(np.float32), outward * vertices / radius, np.asarray(mesh.triangles)


def area_weights(count):
    """Of the vertices of a grid, by the trapezoidal rule."""
    line = np.r_[0.5, np.ones(count - 1), 0.5] / count
    return np.outer(line, line).ravel()


def error(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@pytest.fixture(scope="module")
def still_life():
    """A ball in the corner of three walls: vertices, normals, faces, with all of contact, shadow and open sky."""
    return joined(box(10, 3), ball(0.25, (0.4, 0.25, 0.45), 8))


@pytest.fixture(scope="module")
def lit(still_life):
    """Its occluder, its transfer in 4 bands, and an albedo."""
    occluder = Occluder(*still_life)
    albedo = np.random.default_rng(0).uniform(0.1, 0.95, (len(still_life[0]), 3)).astype(np.float32)
    return occluder, raytraced(occluder, EVERY, 4, 256), albedo


# -- closed forms


def test_form_factor_of_squares_that_share_an_edge():
    # Howell, "A Catalog of Radiation Heat Transfer Configuration Factors", C-14, for unit squares: 0.20004.
    root = np.sqrt(2)
    expected = (np.pi / 2 - root * np.arctan(1 / root) + 0.25 * np.log(4 / 3 * (3 / 4) ** 2)) / np.pi
    count = 20
    floor, wall = grid((0, 0, 0), (0, 0, 1), (1, 0, 0), count), grid((0, 0, 0), (0, 1, 0), (0, 0, 1), count)
    matrix = Interreflection(Occluder(*joined(floor, wall)), 1024)
    on_wall = np.repeat([0.0, 1.0], len(floor[0]))
    for radiance in (on_wall, 1.0 - on_wall):  # both ways
        received = (matrix.bounce(radiance) * (1.0 - radiance)).reshape(2, -1).sum(axis=0)
        # The trapezoidal rule errs by curvature / (12 count^2) < 5e-4, the rays by less.
        assert received @ area_weights(count) == pytest.approx(expected, abs=1e-3)
        assert not (matrix.bounce(radiance) * radiance).any()  # a flat square does not see itself


def test_form_factor_of_facing_squares():
    # The same, C-11, at distance 1: 0.19982.
    root = np.sqrt(2)
    expected = 2 / np.pi * (np.log(2 / np.sqrt(3)) + 2 * root * np.arctan(1 / root) - np.pi / 2)
    below, above = grid((0, 0, 0), (0, 0, 1), (1, 0, 0), 20), grid((0, 1, 0), (1, 0, 0), (0, 0, 1), 20)
    matrix = Interreflection(Occluder(*joined(below, above)), 1024)
    received = matrix.bounce(np.repeat([0.0, 1.0], len(below[0])))[: len(below[0])]
    assert received @ area_weights(20) == pytest.approx(expected, abs=1e-3)


def test_infinite_bounces_inside_a_sphere():
    occluder = Occluder(*ball(1.0, (0, 0, 0), 10, outward=-1.0))
    albedo = np.tile(np.float32([0.9, 0.5, 0.2]), (len(occluder.origins), 1))
    direct = np.full(albedo.shape, 3.0)
    radiance, given = with_bounces(direct, albedo, Interreflection(occluder), 1e-4, 1000)
    np.testing.assert_allclose(radiance, albedo * direct / (1 - albedo), rtol=2e-4)  # not the 9e-4 of the last bounce
    assert given[0] == pytest.approx(np.sqrt((0.81**2 + 0.25**2 + 0.04**2) / (1.71**2 + 0.75**2 + 0.24**2)), rel=1e-5)
    _, given = with_bounces(direct, np.ones_like(albedo), Interreflection(occluder))
    assert len(given) == DEFAULT_MAX_BOUNCES  # light that nothing swallows does not fade


@pytest.mark.parametrize("scene", [box(6, 5), box(8, 3)], ids=["open box", "corner"])
def test_white_furnace_conserves_light(scene):
    # In a constant sky of 1 a white scene is 1 all over, less what is still on its way: X_n + B^(n+1) 1 = 1.
    occluder = Occluder(*scene)
    seen = visible_fraction(raytraced(occluder, EVERY, 1, 256)).clip(0, 1)
    sky = np.repeat(seen[:, None], 3, axis=1)
    matrix = Interreflection(occluder, 128, visible=seen)
    white = np.ones_like(sky)
    on_its_way = matrix.bounce(white)
    for bounces in (0, 1, 5, 60):
        radiance, _ = with_bounces(sky, white, matrix, 0.0, bounces)
        assert radiance.max() <= 1 + ROUNDING
        rest = on_its_way
        for _ in range(bounces):
            rest = matrix.bounce(rest)
        np.testing.assert_allclose(radiance + rest, 1.0, atol=2 * ROUNDING)
    assert radiance.min() > 0.9999


def test_rows_without_direct_light_sum_to_what_their_rays_hit(lit):
    matrix = Interreflection(lit[0], 64)
    whole = matrix.bounce(np.ones(len(lit[2])))
    np.testing.assert_allclose(whole, matrix.hits / 64, atol=ROUNDING)
    assert whole.max() > 0.5 and whole.min() < 0.2


# -- other ways to the same numbers


def test_rows_are_what_the_rays_meet(lit):
    # The same rays, one by one, in NumPy: front faces by their own plane, weights by solving for the hit point.
    occluder, _, _ = lit
    count = len(occluder.origins)
    rays = np.zeros((count, 48, 6), np.float32)
    sampling.shoot(occluder.origins, occluder.normals, sampling.fibonacci_azimuths(48), 5, rays)
    _, faces, uv, normals = occluder.first_hits(rays)
    vertex, ray = np.nonzero(faces >= 0)
    corners = occluder.faces[faces[vertex, ray]]
    exact = np.clip(np.stack([1 - uv[vertex, ray].sum(axis=-1), *uv[vertex, ray].T], axis=1), 0.0, 1.0) * FINENESS
    left = FINENESS - np.floor(exact).sum(axis=1, keepdims=True)  # of whole parts, for the largest rests
    shares = (np.floor(exact) + (np.argsort(np.argsort(np.floor(exact) - exact, axis=1), axis=1) < left)) / FINENESS
    assert ((normals[vertex, ray] * rays[vertex, ray, 3:]).sum(axis=1) < 0).all()  # nothing here shows its back
    expected = np.zeros((count, count))
    np.add.at(expected, (vertex[:, None], corners), shares / 48)

    matrix = Interreflection(occluder, 48, seed=5)
    np.testing.assert_allclose(matrix.bounce(np.eye(count)), expected, atol=ROUNDING)
    assert matrix.entries == len(vertex)
    assert matrix.back_hits == 0


def test_first_hits_are_on_the_rays(still_life):
    occluder = Occluder(*still_life)
    low, high = still_life[0].min(axis=0), still_life[0].max(axis=0)
    placed = (still_life[0] - (low + high) / 2) / np.linalg.norm(high - low)
    rays = np.zeros((len(placed), 16, 6), np.float32)
    sampling.shoot(occluder.origins, occluder.normals, sampling.fibonacci_azimuths(16), 0, rays)
    _, faces, uv, normals = occluder.first_hits(rays)
    np.testing.assert_array_equal(faces >= 0, occluder.occluded(rays))
    hit = faces >= 0
    a, b, c = placed[still_life[2][faces[hit]]].transpose(1, 0, 2)
    u, v = uv[hit].T[:, :, None]
    toward = (1 - u - v) * a + u * b + v * c - rays[hit][:, :3]
    np.testing.assert_allclose(np.cross(toward, rays[hit][:, 3:]), 0.0, atol=1e-6)  # a few roundings of Embree
    assert ((toward * rays[hit][:, 3:]).sum(axis=1) > 0).all()
    np.testing.assert_allclose(
        np.abs((normals[hit] * np.cross(b - a, c - a)).sum(axis=1)), 2 * area(a, b, c), rtol=1e-4
    )


def area(a, b, c):
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def test_bounces_solve_the_linear_system(lit):
    occluder, transfer, albedo = lit
    matrix = Interreflection(occluder, 64, visible=visible_fraction(transfer))
    direct = np.random.default_rng(1).uniform(0, 5, albedo.shape).astype(np.float32)
    dense = matrix.bounce(np.eye(len(albedo))).astype(np.float64)
    exact = [
        np.linalg.solve(np.eye(len(a)) - a[:, None] * dense, a * d) for a, d in zip(albedo.T, direct.T, strict=True)
    ]
    for tolerance in (3e-2, 1e-3, 1e-5):
        radiance, given = with_bounces(direct, albedo, matrix, tolerance, 100)
        assert error(radiance, np.transpose(exact)) < 1.5 * tolerance  # the series left out is not quite geometric
        assert error(radiance, np.transpose(exact)) > tolerance / 50  # ... and no work is done for nothing
    assert given == sorted(given, reverse=True)


def test_transfer_with_bounces_gives_what_light_with_bounces_gives(lit):
    occluder, transfer, albedo = lit
    matrix = Interreflection(occluder, 32, visible=visible_fraction(transfer))
    light = np.random.default_rng(2).normal(size=(16, 3)).astype(np.float32)
    bounced, given = transfer_with_bounces(transfer, albedo, matrix, 0.0, 4)
    radiance, _ = with_bounces(transfer @ light, albedo, matrix, 0.0, 4)
    assert bounced.shape == (*transfer.shape, 3) and bounced.dtype == np.float32 and len(given) == 4
    np.testing.assert_allclose(np.einsum("vkc,kc->vc", bounced, light), radiance, atol=2e-5)
    # Unlit rounds: the number that a constant sky needs is enough for every light.
    few, given = transfer_with_bounces(transfer, albedo, matrix, 1e-3)
    exact, _ = transfer_with_bounces(transfer, albedo, matrix, 0.0, 60)
    assert 1 < len(given) < 15 and error(few, exact) < 2e-3


def test_path_tracer_agrees(tmp_path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    scene = vertices, normals, faces = joined(box(16, 3), ball(0.2, (0.45, 0.4, 0.45), 12))
    height = vertices[:, 1:2]
    albedo = np.hstack([0.9 - 0.5 * height, np.full_like(height, 0.85), 0.3 + 0.5 * height])
    occluder = Occluder(*scene)

    shape = mi.Mesh("scene", len(vertices), len(faces), has_vertex_normals=True)
    shape.add_attribute("vertex_color", 3, albedo.ravel())
    arrays = mi.traverse(shape)
    arrays["vertex_positions"], arrays["vertex_normals"] = vertices.ravel(), normals.astype(np.float32).ravel()
    arrays["faces"] = faces.astype(np.uint32).ravel()
    arrays.update()
    shape.write_ply(str(tmp_path / "mesh.ply"))
    solid = {"type": "ply", "filename": str(tmp_path / "mesh.ply")}
    solid["bsdf"] = {"type": "diffuse", "reflectance": {"type": "mesh_attribute", "name": "vertex_color"}}
    scene = mi.load_dict({"type": "scene", "solid": solid, "sky": {"type": "constant"}})
    paths = mi.load_dict({"type": "path", "max_depth": 16, "rr_depth": 1000, "hide_emitters": True})
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(7)

    probes = np.random.default_rng(8).choice(len(vertices), 40, replace=False)
    rays = np.zeros((len(probes), 400, 6), np.float32)
    sampling.shoot(occluder.origins[probes], occluder.normals[probes], sampling.fibonacci_azimuths(400), 3, rays)
    low, high = vertices.min(axis=0).astype(float), vertices.max(axis=0).astype(float)
    starts = occluder.origins[probes] * np.linalg.norm(high - low) + (low + high) / 2
    bounced = np.zeros((len(probes), 3))
    for i in range(len(probes)):
        for direction in rays[i, :, 3:]:
            ray = mi.RayDifferential3f(mi.Ray3f(starts[i], direction))
            bounced[i] += np.array(paths.sample(scene, sampler, ray)[0]) / 400
    bounced *= albedo[probes]

    sky = np.repeat(visible_fraction(raytraced(occluder, EVERY, 1, 1024))[:, None], 3, axis=1)
    matrix = Interreflection(occluder, 512, visible=sky[:, 0])
    whole, _ = with_bounces(sky, albedo, matrix)
    once, _ = with_bounces(sky, albedo, matrix, 0.0, 1)
    # 400 paths a vertex leave 2% noise, and 0.3% in their sum over the vertices; faces of 1/16 take the rest.
    found = (whole - albedo * sky)[probes]
    assert error(found, bounced) < 0.04
    assert found.sum() == pytest.approx(bounced.sum(), rel=0.015)
    assert error((once - albedo * sky)[probes], bounced) > 0.3  # what the first bounce alone would leave


# -- sides


def test_light_from_a_back_face_is_none():
    floor = grid((0, 0, 0), (0, 0, 1), (1, 0, 0), 4)
    facing, averted = grid((0, 0.5, 0), (1, 0, 0), (0, 0, 1), 4), grid((0, 0.5, 0), (0, 0, 1), (1, 0, 0), 4)
    lamp = np.repeat([0.0, 1.0], len(floor[0]))
    front, back = (Interreflection(Occluder(*joined(floor, plate)), 64) for plate in (facing, averted))
    assert (front.bounce(lamp)[:25] > 0.2).all() and front.back_hits == 0
    assert not back.bounce(lamp)[:25].any() and back.back_hits == 1
    np.testing.assert_array_equal(back.hits[:25], front.hits[:25])


def test_winding_does_not_matter(still_life):
    vertices, normals, faces = still_life
    mixed = faces.copy()
    mixed[::2] = mixed[::2, ::-1]
    radiance = np.random.default_rng(3).random((len(vertices), 3))
    expected = Interreflection(Occluder(vertices, normals, faces), 32).bounce(radiance)
    found = Interreflection(Occluder(vertices, normals, mixed), 32).bounce(radiance)
    np.testing.assert_allclose(found, expected, atol=1e-5)  # weights of corners in another order


def test_closed_body_is_dark_inside():
    occluder = Occluder(*joined(ball(1.0, (0, 0, 0), 8), ball(0.2, (0, 0, 0), 6)))  # a ball buried in another
    matrix = Interreflection(occluder, 32)
    assert not matrix.bounce(np.ones(len(occluder.origins))).any()
    assert matrix.hits.max() == 32 and matrix.back_hits == 1


def test_light_takes_the_colour_of_what_it_met():
    occluder = Occluder(*box(4, 3))
    side = np.repeat([0, 1, 2], 25)
    albedo = np.array([[1, 1, 1], [1, 0, 0], [0, 0, 0]])[side]  # white floor, red wall, black wall
    direct = np.repeat((side == 1).astype(float)[:, None], 3, axis=1)  # only the red one is lit
    radiance, given = with_bounces(direct, albedo, Interreflection(occluder), 0.0, 1)
    assert (radiance[side == 0, 0] > 0.02).all() and not radiance[side == 0, 1:].any()
    assert not radiance[side == 2].any() and len(given) == 1


# -- accuracy


def test_error_falls_with_rays_and_more_where_rows_complement_the_direct_light(lit):
    occluder, transfer, albedo = lit
    sky = np.repeat(visible_fraction(transfer)[:, None], 3, axis=1)
    converged = Interreflection(occluder, 4096, seed=9).bounce(albedo * sky)

    def off(rays, visible=None):
        return error(Interreflection(occluder, rays, visible=visible).bounce(albedo * sky), converged)

    assert off(512) < off(32) * 16**-0.6  # independent random rays: 16^-0.5
    assert off(32, sky[:, 0]) < 0.85 * off(32)


# -- what the result may not depend on


def test_threads_and_batches_change_no_bit(lit, monkeypatch):
    occluder, transfer, albedo = lit
    expected = Interreflection(occluder, 32, visible=visible_fraction(transfer)).bounce(albedo)
    for cores in (1, 5):
        monkeypatch.setattr(os, "cpu_count", lambda cores=cores: cores)
        monkeypatch.setattr("relight.transfer.bounce_places.BATCH_RAYS", 32 * 100)
        found = Interreflection(occluder, 32, visible=visible_fraction(transfer))
        assert len(found._rows) > 4 * batch_of(32)
        np.testing.assert_array_equal(found.bounce(albedo), expected)


def test_vertex_order_changes_no_bit(still_life):
    vertices, normals, faces = still_life
    order = np.random.default_rng(4).permutation(len(vertices))
    radiance = np.random.default_rng(5).random((len(vertices), 3))
    expected = Interreflection(Occluder(*still_life), 32).bounce(radiance)
    renamed = np.argsort(order)[faces]
    found = Interreflection(Occluder(vertices[order], normals[order], renamed), 32).bounce(radiance[order])
    np.testing.assert_array_equal(found, expected[order])


def test_columns_are_independent(lit):
    matrix = Interreflection(lit[0], 32)
    radiance = np.random.default_rng(6).random((len(lit[2]), 7)).astype(np.float32)
    whole = matrix.bounce(radiance)
    np.testing.assert_allclose(matrix.bounce(radiance[:, 2:5]), whole[:, 2:5], rtol=ROUNDING)  # a kernel of its own
    np.testing.assert_array_equal(matrix.bounce(radiance[:, 6]), whole[:, 6])
    assert matrix.bounce(radiance[:, :0]).shape == (len(radiance), 0)


def test_black_scenes_and_dark_lights_need_one_look(lit):
    occluder, _, albedo = lit
    matrix = Interreflection(occluder, 16)
    for direct, color in ((np.ones(albedo.shape), 0 * albedo), (np.zeros(albedo.shape), albedo)):
        radiance, given = with_bounces(direct, color, matrix)
        assert not radiance.any() and given == [0.0]


# -- input


@pytest.mark.parametrize(
    ("work", "message"),
    [
        (lambda o, m, a: Interreflection(o, 0), "from 1 to 65536"),
        (lambda o, m, a: Interreflection(o, 8, visible=a), r"visible fractions must be \(\d+,\) in \[0, 1\]"),
        (lambda o, m, a: Interreflection(o, 8, visible=a[:, 0] * 2 + 1), "values 1"),
        (lambda o, m, a: Interreflection(o, 8, visible=a[:, 0] * np.nan), "visible fractions"),
        (lambda o, m, a: m.bounce(a[1:]), "the radiance must have shape"),
        (lambda o, m, a: with_bounces(a[1:], a, m), "the direct light must have shape"),
        (lambda o, m, a: with_bounces(a, a[:, :1], m), "the albedo must have shape"),
        (lambda o, m, a: with_bounces(a, a + 1, m), r"albedo must be in \[0, 1\]"),
        (lambda o, m, a: with_bounces(a, a * np.nan, m), r"albedo must be in \[0, 1\]"),
        (lambda o, m, a: transfer_with_bounces(a[1:], a, m), "shape"),
    ],
)
def test_what_does_not_fit_is_refused(lit, work, message):
    occluder, _, albedo = lit
    with pytest.raises(InputError, match=message):
        work(occluder, Interreflection(occluder, 4), albedo)


def test_progress_counts_every_vertex(lit):
    done = []
    Interreflection(lit[0], 2**12, advance=done.append)
    assert sum(done) == len(lit[2]) and len(done) > 1
