"""Hard cases of light transport: odd normals, sizes and places, broken meshes, closed and thin bodies."""

import numpy as np
import open3d as o3d
import pytest
from hard_scenes import (
    EPS32,
    EVERY,
    EVERYTHING,
    arrays,
    error,
    joined,
    knobbed_torus,
    rough_light,
    scene,
    sheet,
    ten_bands,
)
from motors import motor, taken_apart, up_to
from scipy.spatial.transform import Rotation
from scipy.special import sph_harm_y

from relight.light.environment import Suns
from relight.sh import cga, harmonics
from relight.transfer.analytic import analytic
from relight.transfer.bounces import Interreflection
from relight.transfer.occluder import Occluder
from relight.transfer.sunlight import sunlight
from relight.transfer.visibility import raytraced_scene
from scenes.plain_rays import raytraced
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.mesh import vertex_normals

WHITE = np.sqrt(0.25 / np.pi)  # first coefficient of the transfer of a vertex that sees all its sky


def seen(vertices, normals, faces, rays=64):
    """Visible fraction of every vertex, (V,)."""
    return raytraced(Occluder(np.float32(vertices), normals, faces), EVERY, 1, rays)[:, 0] / np.float32(WHITE)


# -- normals


def test_nothing_jumps_about_straight_down():
    # The lowest corner of an octahedron, again and again, with normals that lean ever less.
    turn = np.tile(2 * np.pi * np.arange(8) / 8, 4)
    lean = np.repeat([1e-2, 1e-4, 1e-8, 0.0], 8)
    normals = np.stack([np.sin(lean) * np.cos(turn), -np.cos(lean), np.sin(lean) * np.sin(turn)], axis=1)
    vertices, _, faces = arrays(o3d.geometry.TriangleMesh.create_octahedron())
    lowest = vertices[vertices[:, 2].argmin()][[0, 2, 1]]
    vertices = vertices[:, [0, 2, 1]]
    all_vertices = np.concatenate([vertices, np.tile(lowest, (32, 1))])
    occluder = Occluder(np.float32(all_vertices), np.concatenate([vertices, normals]), faces)
    rows = slice(len(vertices), None)

    transfer = raytraced_scene(occluder, 10, 32)[rows]
    np.testing.assert_array_equal(transfer, analytic(occluder.normals[rows], 10))
    # Along any great circle sum_m Y_lm'^2 = l (l + 1) (2 l + 1) / 8 pi, each degree times its lobe; and rounding.
    lobe = np.array([1, 2 / 3, 1 / 4, 0, -1 / 24, 0, 1 / 64, 0, -1 / 128, 0])
    degree = np.arange(10)
    slope = np.sqrt((lobe**2 * degree * (degree + 1) * (2 * degree + 1)).sum() / (8 * np.pi))
    assert (np.linalg.norm(transfer - transfer[-1], axis=1) <= slope * lean + 50 * EPS32).all()

    suns = Suns(np.array([[0.6, -0.8, 0.0], [0.0, -1.0, 0.0]]), np.ones((2, 3)))
    lit = sunlight(occluder, rows, suns)[:, 0]
    np.testing.assert_allclose(lit, (normals @ suns.directions.T).sum(axis=1) / np.pi, rtol=8 * EPS32)

    motors = cga.vertex_motors(np.tile(lowest, (32, 1)), normals)
    assert (
        np.isfinite(motors).all()
        and (np.abs(taken_apart(motors)[0].apply([0.0, 1.0, 0.0]) - normals) < 4 * EPS32).all()
    )
    towards_z = np.isclose(turn, np.pi / 2)  # the side on which straight down is the limit
    assert (np.abs(motors - motors[-1]).max(axis=1) <= 0.51 * lean + 2 * EPS32)[towards_z].all()


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float64, 1e-14), (np.float32, 2e-6)])
def test_harmonics_are_exact_at_the_poles(dtype, tolerance):
    """Tolerances: the recurrence rounds once a degree, the values are up to 1.3."""
    poles = np.concatenate([np.eye(3), -np.eye(3)]).astype(dtype)
    values = harmonics.evaluate(poles, 10)
    assert values.dtype == dtype
    degree, order = harmonics.degrees_and_orders(10)
    for row, sign in ((2, 1.0), (5, -1.0)):  # along z all but m = 0 vanish, exactly
        expected = np.where(order == 0, np.sqrt((2 * degree + 1) / (4 * np.pi)) * sign**degree, 0.0)
        assert not values[row][order != 0].any()
        np.testing.assert_allclose(values[row], expected, atol=tolerance)
    theta, phi = np.arccos(poles[:, 2]), np.arctan2(poles[:, 1], poles[:, 0])
    for index, (ell, m) in enumerate(zip(degree, order, strict=True)):
        value = sph_harm_y(ell, abs(m), theta, phi) * (-1.0) ** m * (np.sqrt(2) if m else 1)
        np.testing.assert_allclose(values[:, index], value.imag if m < 0 else value.real, atol=tolerance)


NO_NORMALS = [[0, 0, 0], [1e-40, 0, 0], [0, -1e-45, 0], [np.nan, 0, 1], [np.inf, 0, 0], [-np.inf, np.nan, 0]]


@pytest.mark.parametrize("method", ["auto", "raytraced", "analytic"])
def test_missing_normals_are_those_of_the_faces_around(method):
    vertices, normals, faces = knobbed_torus()
    known, broken = normals.copy(), normals.copy()
    known[10:16], broken[10:16] = vertex_normals(np.float32(vertices), faces)[10:16], NO_NORMALS
    albedo = np.full(vertices.shape, 0.7)
    expected = ten_bands(scene(vertices, known, faces), method, rays=16).shade(rough_light(), albedo)
    with pytest.warns(DataWarning, match="^6 vertices of 498 had no normal") as caught:
        found = ten_bands(scene(vertices, broken, faces), method, rays=16).shade(rough_light(), albedo)
    assert len(caught) == 1
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("method", ["auto", "raytraced", "analytic"])
def test_vertices_without_normal_and_faces_are_counted_once_and_lit_as_if_they_faced_up(method):
    vertices, normals, faces = knobbed_torus()
    vertices = np.concatenate([vertices, vertices[:6] * 1.2])
    up, broken = (np.concatenate([normals, each]) for each in (np.tile([0.0, 1.0, 0.0], (6, 1)), NO_NORMALS))
    albedo = np.full(vertices.shape, 0.7)
    expected = ten_bands(scene(vertices, up, faces), method, rays=16).shade(rough_light(), albedo)
    with pytest.warns(DataWarning, match="^6 of 504 vertices have no normal") as caught:
        found = ten_bands(scene(vertices, broken, faces), method, rays=16).shade(rough_light(), albedo)
    assert len(caught) == 1
    np.testing.assert_array_equal(found, expected)


# -- size and place


def test_sizes_by_powers_of_two_change_no_bit_of_anything():
    vertices, normals, faces = knobbed_torus()
    albedo = np.full(vertices.shape, 0.7)
    expected = ten_bands(scene(vertices, normals, faces), rays=16).shade(rough_light(), albedo)
    for power in (-20, -140, 20, 100):  # 2^-140 is denormal, but for rounding of its own
        moved = np.float32(vertices) * 2.0**power
        found = ten_bands(scene(moved, normals, faces), rays=16).shade(rough_light(), albedo)
        if power > -126:
            np.testing.assert_array_equal(found, expected)
        else:
            assert error(found, expected) < 0.1  # positions of 10 bits


@pytest.mark.parametrize("scale", [1e-6, 1e-4, 1e6])
def test_any_size_is_lit_as_well(scale):
    """Positions round differently, and with them the seeds: not more than another seed does."""
    vertices, normals, faces = knobbed_torus()
    expected, other = (ten_bands(scene(vertices, normals, faces), rays=128, seed=s).transfer for s in (0, 1))
    found = ten_bands(scene(vertices * scale, normals, faces), rays=128).transfer
    assert error(found, expected) < 1.3 * error(other, expected)


@pytest.mark.parametrize("size", [1e3, 1e5])
def test_a_million_from_the_origin_only_float32_itself_bends_the_mesh(size):
    vertices, normals, faces = knobbed_torus()
    far = np.float32(vertices * size + 1e6)
    back = far.astype(np.float64) - 1e6  # exact: the same bent mesh about the origin
    assert (np.abs(back - vertices * size) <= np.spacing(np.float32(1e6 + 1.5 * size)) / 2).all()
    expected, other = (ten_bands(scene(back, normals, faces), rays=128, seed=s).transfer for s in (0, 1))
    found = ten_bands(scene(far, normals, faces), rays=128).transfer
    assert error(found, expected) < 1.3 * error(other, expected)
    straight = ten_bands(scene(vertices, normals, faces), rays=128).transfer
    # Each vertex is off by sqrt 3 / 2 roundings at most, 5e-5 of the least edge or less: under the noise too.
    assert error(found, straight) < 1.4 * error(other, expected)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_float32_motors_are_those_of_float64(scale):
    points, normals, _ = knobbed_torus()
    points = np.float32(points * scale).astype(np.float64)
    expected = motor(up_to(normals.astype(np.float64)), points)
    found = cga.vertex_motors(points, normals).astype(np.float64)
    # The normals are made unit length and rounded again on the way.
    assert (np.abs(found - expected) <= 4 * EPS32 * np.abs(expected).max(axis=1, keepdims=True)).all()


TURN = Rotation.from_euler("xyz", [0.3, 1.1, -0.7]).as_matrix()
PLACES = [(1, 0), (1e-6, 0), (1e6, 0), (1e30, 0), (1e-30, 0), (1, 100), (1, 1e4), (1e-6, 1e-2), (1e3, 1e6), (1, -1e6)]


@pytest.mark.parametrize("kind", ["box", "turned box", "icosahedron", "sphere"])
def test_convex_bodies_of_any_size_anywhere_cast_no_shadow_on_themselves(kind):
    # A million away the sphere is a lump of 32 steps across: its dents are of rounding and must not show.
    make = o3d.geometry.TriangleMesh
    shape = {"icosahedron": make.create_icosahedron, "sphere": lambda: make.create_sphere(1.0, 20)}
    vertices, normals, faces = arrays(shape.get(kind, make.create_box)())
    normals = vertices.astype(np.float32) if kind == "sphere" else normals
    if kind == "turned box":
        vertices, normals = vertices @ TURN.T, normals @ TURN.T
    for scale, offset in PLACES:
        np.testing.assert_array_equal(seen(vertices * scale + offset, normals, faces), 1.0)


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("cells", [2, 30])
def test_sheets_three_ten_thousandths_apart_hide_the_sky(scale, cells):
    lines = np.linspace(-0.5, 0.5, cells + 1)
    gap = 3e-4 * np.sqrt(2)
    vertices, normals, faces = joined(sheet(lines), sheet(lines, gap))
    lower = np.arange(len(vertices)) < len(vertices) // 2
    fraction = seen(vertices * scale, normals, faces)
    inner = (np.abs(vertices[:, [0, 2]]) < 0.45).all(axis=1)  # rays out of the gap: 1 in 10^5
    corner = (np.abs(vertices[:, [0, 2]]) == 0.5).all(axis=1)
    assert not fraction[lower & inner].any() and (fraction[~lower] == 1).all()
    # The corner sees the three quarters that stand free. 64 rays meet an edge to a row or two of the set.
    np.testing.assert_allclose(fraction[lower & corner], 0.75, atol=0.06)
    suns = Suns(np.array([[0.0, 1.0, 0.0]]), np.ones((1, 3)))
    lit = sunlight(Occluder(np.float32(vertices * scale), normals, faces), EVERY, suns)[:, 0]
    np.testing.assert_allclose(lit[~lower], 1 / np.pi, rtol=EPS32)
    assert not lit[lower & inner].any()


# -- meshes that are not as they should be


def test_lost_vertices_and_faces_without_area_change_no_bit():
    vertices, normals, faces = knobbed_torus()
    expected = raytraced(Occluder(np.float32(vertices), normals, faces), EVERY, 4, 32)
    lost = np.array([[0.1, 0, 0], [1e6, 0, 0], [0, -1e12, 3], vertices[5], vertices[9]])
    flat = [[0, 0, 1], [2, 2, 2], [5, len(vertices) + 3, len(vertices) + 4]]
    more = np.float32(np.concatenate([vertices, lost])), np.concatenate([normals, normals[[0, 1, 2, 5, 9]]])
    found = raytraced(Occluder(more[0], more[1], np.concatenate([faces, faces[:9], flat[:2]])), EVERY, 4, 32)
    np.testing.assert_array_equal(found[: len(vertices)], expected)
    assert np.isfinite(found).all()
    whole = ten_bands(scene(*more, np.concatenate([faces, flat])), rays=32, effects=EVERYTHING)
    radiance = whole.shade(rough_light(), np.full(more[0].shape, 0.7))
    straight = ten_bands(scene(vertices, normals, faces), rays=32, effects=EVERYTHING)
    # Ranks shift, and the noise with them.
    assert error(radiance[: len(vertices)], straight.shade(rough_light(), np.full(vertices.shape, 0.7))) < 0.05


def test_slivers_neither_leak_nor_shade_themselves():
    lines = np.sort(np.concatenate([np.linspace(-0.5, 0.5, 9), np.linspace(-0.4, 0.4, 9) + 1e-6]))  # aspect 1e5 to 1e6
    alone = sheet(lines)
    np.testing.assert_array_equal(seen(*alone), 1.0)
    vertices, normals, faces = joined(alone, sheet(lines, 1e-3))
    inner = (np.abs(vertices[:, [0, 2]]) < 0.3).all(axis=1) & (vertices[:, 1] == 0)
    fraction = seen(vertices, normals, faces, 256)
    # Past the edges, 0.2 or more away, 2.5e-5 of the lobe is left: a ray of 256 at most.
    assert fraction[inner].max() < 0.02 and np.median(fraction[inner]) == 0
    suns = Suns(Rotation.from_euler("x", [[0.0], [0.4]]).as_matrix()[:, 1], np.ones((2, 3)))
    assert not sunlight(Occluder(np.float32(vertices), normals, faces), inner, suns).any()


def test_single_triangles_and_bow_ties_see_all_their_sky():
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]) @ TURN.T
    normal = np.tile(TURN[:, 2], (5, 1))
    light, albedo = rough_light(), np.full((5, 3), 0.7)
    for count, faces in ((3, [[0, 1, 2]]), (5, [[0, 1, 2], [0, 4, 3]])):  # the second is wound the other way
        lit = ten_bands(scene(corners[:count], normal[:count], faces), rays=16)
        np.testing.assert_array_equal(lit.transfer, analytic(normal[:count], 10))
        shading = lit.shading(light, albedo[:count])
        assert shading.sun_count > 0 and shading.bounces == [0.0]
        np.testing.assert_allclose(shading.radiance, shading.radiance[:1].repeat(count, axis=0), rtol=1e-5)


def test_three_faces_on_an_edge_hide_what_they_should():
    # Fins 120 degrees apart, 1 high and 40 long, seen from 0.02 beside the edge.
    fins, probes = [], []
    for turn in np.radians([0, 120, 240]):
        out, across = np.array([np.cos(turn), np.sin(turn), 0]), np.array([-np.sin(turn), np.cos(turn), 0])
        ends = [[0, 0, -20], [0, 0, 20], [*out[:2], 20], [*out[:2], -20]]
        fins.append((np.array(ends, float), np.tile(across, (4, 1)), np.array([[0, 1, 2], [2, 3, 0]])))
        probes.append((0.02 * out[None], across[None], np.zeros((0, 3), int)))
    fraction = seen(*joined(*fins, *probes), 4096)[12:]
    # What the next one leaves is a wedge of sky, (1 - cos of its angle at the fin's top) / 2 of the lobe.
    x, y = np.cos(np.radians(120)) - 0.02, np.sin(np.radians(120))
    np.testing.assert_allclose(fraction, 0.5 - 0.5 * x / np.hypot(x, y), atol=0.005)


def test_bodies_that_run_into_each_other_are_dark_where_they_are_inside():
    one, other = (arrays(o3d.geometry.TriangleMesh.create_sphere(1.0, 16)) for _ in range(2))
    vertices, normals, faces = joined(one, (other[0] + [0.9, 0.05, 0.02], *other[1:]))
    faces[::3] = faces[::3, ::-1]  # whatever the winding
    half = len(vertices) // 2
    inside = np.concatenate(
        [np.linalg.norm(vertices[:half] - [0.9, 0.05, 0.02], axis=1), np.linalg.norm(vertices[half:], axis=1)]
    )
    inner = inside < 0.97  # facets are within 2%
    assert inner.sum() > 100
    assert not raytraced(Occluder(np.float32(vertices), normals, faces), inner, 10, 64).any()
    shading = ten_bands(scene(vertices, normals, faces), rays=64).shading(rough_light(), np.full(vertices.shape, 0.9))
    assert shading.sun_count and shading.bounces
    assert not shading.radiance[inside < 0.6].any()
    # Averaging over neighbours lets a little of the light outside in, two rings deep.
    assert shading.radiance[inner].max() < 1e-3 * shading.radiance.mean()
    assert (shading.radiance[inside > 1.0] > 0).all()


@pytest.mark.parametrize(("scale", "offset"), [(1, 0), (1e-6, 0), (1e6, 0), (1, 1e3)])
def test_closed_bodies_are_black_inside_with_every_effect(scale, offset):
    make = o3d.geometry.TriangleMesh
    for shape in (make.create_sphere(1.0, 16), make.create_box(), make.create_torus(1.0, 0.3, 20, 12)):
        vertices, normals, faces = arrays(shape)
        inward = scene(vertices @ TURN.T * scale + offset, -normals @ TURN.T, faces)
        shading = ten_bands(inward, rays=64, effects=EVERYTHING).shading(rough_light(), np.ones_like(vertices))
        assert shading.sun_count and not shading.radiance.any()


def test_walls_that_end_on_a_floor_without_a_vertex_there_are_lit_down_to_it():
    """Their lowest vertices lie in the floor's plane, where rays would be taken to start behind it."""
    lines = np.linspace(-0.5, 0.5, 6)
    floor = sheet(1.7 * lines)  # none of its lines is one of the wall's
    turn = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    wall, normals, faces = sheet(lines)
    wall, normals = wall @ turn + [0.05, 0.5, 0.0], normals @ turn
    vertices, both, faces = joined(floor, (wall, normals, faces))
    foot = np.abs(vertices[:, 1]) < 1e-6
    foot[: len(floor[0])] = False
    assert foot.sum() == len(lines)
    for order in (faces, faces[:, ::-1]):
        fraction = seen(np.float32(vertices), both, order, 256)[foot]
        np.testing.assert_allclose(fraction, 0.5, atol=0.02)  # the half of its sky that is above the floor


def test_the_two_sides_of_a_sheet_are_lit_each_from_its_own():
    lines = np.linspace(-0.5, 0.5, 6)
    vertices, normals, faces = joined(sheet(lines), sheet(lines, 0.0, -1.0))
    occluder = Occluder(np.float32(vertices), normals, faces)
    np.testing.assert_array_equal(raytraced_scene(occluder, 5, 32), analytic(normals, 5))
    above = normals[:, 1] > 0
    suns = Suns(np.array([[0.6, 0.8, 0.0]]), np.ones((1, 3)))
    lit = sunlight(occluder, EVERY, suns)
    np.testing.assert_allclose(lit[above], 0.8 / np.pi, rtol=4 * EPS32)
    assert not lit[~above].any()
    assert not Interreflection(occluder, 16).bounce(np.ones(len(vertices))).any()


def test_faces_hide_light_from_behind_and_whatever_their_winding():
    vertices, normals, faces = knobbed_torus()
    expected = ten_bands(scene(vertices, normals, faces), rays=32, effects=["shadows", "sun"]).shade(rough_light())
    mixed = faces.copy()
    mixed[::2] = mixed[::2, ::-1]
    for other in (faces[:, ::-1], mixed, faces[:, [1, 2, 0]]):
        found = ten_bands(scene(vertices, normals, other), rays=32, effects=["shadows", "sun"]).shade(rough_light())
        np.testing.assert_array_equal(found, expected)
