"""Albedo and captured light: exact recovery, invariances, inseparable light, hard cases."""

from functools import cache

import numpy as np
import open3d as o3d
import pytest
from captured_scenes import BANDS, TOP_LEFT, given, lamp_light, objects, patchy, photographed

from relight import Environment
from relight.albedo import DARKEST, LIGHTEST, Prior, albedo_of, estimate, samples, with_known_light
from relight.albedo.fitted import FITTED
from relight.light.environment import Suns
from relight.light.projections import texel_directions
from relight.transfer.bounces import with_bounces
from relight.transfer.occluder import Occluder
from relight.transfer.sunlight import sunlight
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.color import luminance

pytestmark = pytest.mark.usefixtures("fewer_samples")


def flat(count=40):
    u, v = np.meshgrid(*2 * [np.linspace(-1, 1, count, dtype=np.float32)], indexing="ij")
    vertices = np.stack([u.ravel(), np.zeros(count**2, np.float32), -v.ravel()], axis=1)
    first = (np.arange(count - 1)[:, None] * count + np.arange(count - 1)).reshape(-1, 1)
    faces = (first + np.array([0, count, count + 1, 0, count + 1, 1])).reshape(-1, 3)
    return vertices, np.tile(np.float32([0, 1, 0]), (len(vertices), 1)), faces


@cache
def photo():
    """Albedo and captured colours of `objects` under the lamp, read-only."""
    albedo = patchy(objects()[0])
    captured = photographed(objects(), albedo, lamp_light())
    captured.setflags(write=False)
    return albedo, captured


@cache
def estimated(seed=0):
    """The Estimate of `photo`."""
    return estimate(objects()[0], photo()[1], seed, **given(objects()))


def error(found, true, rows=slice(None)):
    """Relative L2 error after one gain for each colour."""
    found, true = found[rows].astype(float), true[rows].astype(float)
    gain = (found * true).sum(axis=0) / (found * found).sum(axis=0)
    return np.linalg.norm(found * gain - true) / np.linalg.norm(true)


def angle_deg(a, b):
    return np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1, 1)))


# The division


def test_the_division_minimises_its_cost():
    rng = np.random.default_rng(0)
    captured, irradiance = rng.gamma(1, 1, (2, 500, 3)).astype(np.float32)
    prior = Prior(np.float32([0.3, 0.4, 0.5]), np.float32([0.1, 0.2, 0.4]))
    found = albedo_of(captured, irradiance, prior).astype(float)
    captured, irradiance = captured.astype(float), irradiance.astype(float)

    def cost(albedo):
        return (captured - albedo * irradiance) ** 2 + (prior.irradiance * (albedo - prior.albedo)) ** 2

    inside = (found > np.float32(DARKEST)) & (found < np.float32(LIGHTEST))
    assert inside.mean() > 0.4
    for step in (-1e-3, 1e-3):
        assert (cost(found + step) > cost(found))[inside].all()


def test_in_full_light_the_division_is_c_over_s_and_in_none_the_prior():
    prior = Prior(np.float32([0.3, 0.4, 0.5]), np.full(3, 1e-6, np.float32))
    irradiance = np.random.default_rng(1).uniform(0.5, 2, (100, 3)).astype(np.float32)
    albedo = np.random.default_rng(2).uniform(0.1, 0.9, (100, 3)).astype(np.float32)
    np.testing.assert_allclose(albedo_of(albedo * irradiance, irradiance, prior), albedo, rtol=1e-6)  # float32
    np.testing.assert_array_equal(albedo_of(np.zeros((1, 3)), np.zeros((1, 3)), prior)[0], prior.albedo)


@pytest.mark.parametrize("unit", [1e-30, 1e-6, 1.0, 1e6, 1e30])
def test_the_division_knows_no_unit(unit):
    rng = np.random.default_rng(3)
    captured, irradiance = rng.gamma(1, 1, (2, 50, 3)).astype(np.float32)
    expected = albedo_of(captured, irradiance)
    found = albedo_of(captured * np.float32(unit), irradiance * np.float32(unit))
    np.testing.assert_allclose(found, expected, rtol=1e-5)  # float32 of the scaled input


def test_the_division_is_bounded_whatever_comes():
    bad = np.float32([0, 1e-38, 1e38, 3e38, np.inf, -np.inf, np.nan, -1, 1])
    captured, irradiance = (a.reshape(-1, 1).repeat(3, 1) for a in np.meshgrid(bad, bad))
    for prior in (None, Prior(np.full(3, 0.4), np.full(3, 1e-20)), Prior(np.full(3, 0.4), np.full(3, 1e20))):
        found = albedo_of(captured, irradiance, prior)
        assert ((found >= np.float32(DARKEST)) & (found <= np.float32(LIGHTEST))).all()


@pytest.mark.parametrize("shape", [(3,), (4, 2), (5, 3)])
def test_the_division_refuses_what_does_not_fit(shape):
    with pytest.raises(InputError, match=r"shape"):
        albedo_of(np.zeros(shape), np.zeros((4, 3)))
    with pytest.raises(InputError, match="above 0"):
        albedo_of(np.zeros((4, 3)), np.zeros((4, 3)), Prior(np.full(3, 0.4), np.zeros(3)))


# The estimate


def test_light_and_albedo_come_apart():
    (albedo, captured), found, seen = photo(), estimated(), objects()[3] > 0.15
    assert found.separable and found.reason == "" and found.evidence > 0.8
    # Exact colours and transfer; what is left is the light's form. Captured colours are 0.40 off.
    assert error(found.albedo, albedo, seen) < 0.12 < 0.35 < error(captured, albedo, seen)
    assert angle_deg(found.direction, TOP_LEFT) < 5
    assert found.color[0] > 1.05 * found.color[2]  # half of the lamp's tint goes to the albedo: hue is the prior's
    assert ((found.albedo >= np.float32(DARKEST)) & (found.albedo <= np.float32(LIGHTEST))).all()
    assert (found.environment.radiance >= 0).all() and (found.irradiance >= 0).all()


def test_a_known_light_gives_the_albedo_and_its_exposure():
    scene = objects()
    albedo, light = patchy(scene[0]), lamp_light()
    captured = 0.2 * photographed(scene, albedo, light)
    found = with_known_light(scene[0], captured, light, **given(scene))
    seen = scene[3] > 0.15
    scale = np.median(luminance(albedo[seen])) / np.median(luminance(found.albedo[seen]))
    # Its median is 0.6, not the usual one: the light is taken as too bright, and what surfaces exchange counts less.
    assert error(scale * found.albedo, albedo, seen) < 0.1
    assert angle_deg(found.direction, TOP_LEFT) < 1
    gains = found.environment.radiance / light.radiance
    assert np.abs(gains / gains[0, 0] - 1).max() < 1e-5  # a gain and nothing else
    assert np.median(luminance(found.albedo[seen])) == pytest.approx(FITTED.albedo, rel=0.1)  # the usual one


def test_relighting_by_the_estimate_gives_back_the_captured_colours():
    captured, found = photo()[1], estimated()
    clear = ((found.albedo > DARKEST) & (found.albedo < LIGHTEST)).all(axis=1) & (
        found.irradiance > 4 * found.prior.irradiance
    ).all(axis=1)
    assert clear.mean() > 0.5
    # The prior weighs at most 1 / 17 there.
    np.testing.assert_allclose((found.albedo * found.irradiance)[clear], captured[clear], rtol=1 / 8)
    median = np.median(np.abs((found.albedo * found.irradiance)[clear] / captured[clear] - 1))
    assert median < 0.01


def test_another_unit_changes_the_light_alone():
    scene = objects()
    one, other = estimated(), estimate(scene[0], photo()[1] * np.float32(0.25), **given(scene))
    # Dark and clipped colours are recognised in display units, so some places may differ.
    assert error(one.albedo, other.albedo) < 0.05
    assert other.brightness / one.brightness == pytest.approx(0.25, rel=0.1)


def test_the_same_to_the_bit_with_the_seed_and_nearly_with_another():
    scene, one, other = objects(), estimated(), estimated(2)
    again = estimate(scene[0], photo()[1], **given(scene))
    assert one.albedo.tobytes() == again.albedo.tobytes() and one.irradiance.tobytes() == again.irradiance.tobytes()
    assert not np.array_equal(one.albedo, other.albedo)
    assert error(one.albedo, other.albedo) < 0.05  # other places, other noise


def test_vertex_order_and_chunks_do_not_matter():
    vertices, normals, faces = (np.asarray(a) for a in solid_arrays())
    rng = np.random.default_rng(6)
    colors = rng.uniform(0.1, 0.6, (len(vertices), 3)).astype(np.float32)
    order = rng.permutation(len(vertices))
    rank = np.argsort(order)
    plain = estimate(Occluder(vertices, normals, faces), colors)
    mixed = estimate(Occluder(vertices[order], normals[order], rank[faces]), colors[order])
    assert np.abs(mixed.albedo[rank] - plain.albedo).max() < 1e-4
    half = faces.mean(axis=1) < len(vertices) / 2  # two chunks, the seam's vertices twice
    first, second = np.unique(faces[half]), np.unique(faces[~half])
    both = np.concatenate([first, second])
    new = np.zeros(len(vertices), int)
    new[first] = np.arange(len(first))
    cut = [new[faces[half]]]
    new[second] = len(first) + np.arange(len(second))
    cut = np.concatenate([*cut, new[faces[~half]]])
    chunked = estimate(Occluder(vertices[both], normals[both], cut), colors[both])
    assert len(both) > len(vertices)
    assert np.abs(chunked.albedo - plain.albedo[both]).max() < 1e-4


def solid_arrays():
    mesh = o3d.geometry.TriangleMesh.create_torus(1.0, 0.4, 40, 24)
    mesh.compute_vertex_normals()
    return (
        np.asarray(mesh.vertices, np.float32),
        np.asarray(mesh.vertex_normals, np.float32),
        np.asarray(mesh.triangles),
    )


def test_places_share_the_area_evenly():
    vertices, normals, faces = flat(60)
    vertices = vertices * np.float32([1, 1, 0.2])
    occluder = Occluder(vertices, normals, faces)
    areas = samples.vertex_areas(occluder)
    size = 2.0 * 0.4 / (2.0**2 + 0.4**2)  # in squared diagonals
    assert areas.sum() == pytest.approx(size, rel=1e-4)  # ray origins at the border stand 2e-6 inside it
    chosen = samples.places(occluder, areas, np.ones(len(vertices), bool), 400, 0)
    left = (occluder.origins[chosen, 0] < 0).mean()
    assert left == pytest.approx(0.5, abs=0.02) and len(chosen) == 400


def test_inside_a_body_there_are_no_places():
    ball = o3d.geometry.TriangleMesh.create_sphere(1.0, 20)
    inner = o3d.geometry.TriangleMesh.create_sphere(0.3, 20)
    mesh = ball + inner
    mesh.compute_vertex_normals()
    occluder = Occluder(*(np.asarray(a) for a in (mesh.vertices, mesh.vertex_normals, mesh.triangles)))
    count = len(ball.vertices)
    taken = samples.take(occluder, samples.vertex_areas(occluder), np.ones(len(mesh.vertices), bool), 0)
    assert len(taken.vertices) > 300 and (taken.vertices < count).all()
    visible = taken.sky.sum(axis=1)
    np.testing.assert_allclose(visible, 1.0, atol=0.02)  # 1024 directions of the cosine lobe
    assert taken.weights.sum() == pytest.approx(1) and (taken.pairs[:, 0] < taken.pairs[:, 1]).all()


def test_a_sun_is_found_where_it_stands():
    """Hard shadows of a small sun, traced here ray by ray, over a soft sky."""
    scene, width = objects(), 64
    toward = texel_directions(width // 2, width)[6, 40]
    captured = with_bounces(
        np.maximum(scene[1] @ np.float32(Environment(np.full((4, 8, 3), 0.3)).sh(BANDS)), 0)
        + sunlight(scene[0], slice(None), Suns(toward[None], np.array([[3.0, 2.7, 2.1]]))),
        photo()[0],
        scene[2],
    )[0]
    found = estimate(scene[0], captured, **given(scene))
    bright = found.environment.radiance.max(axis=2)
    peak = texel_directions(*bright.shape)[np.unravel_index(bright.argmax(), bright.shape)]
    assert angle_deg(peak, toward) < 6  # directions of the places stand 6 degrees apart
    assert found.lights[0].sun is not None and found.lights[0].share > 0.99
    assert error(found.albedo, photo()[0], scene[3] > 0.15) < 0.2


# Inseparable light


def as_captured(found, captured):
    """Whether the fallback is what it says: captured colours as albedo, irradiance constant."""
    assert not found.separable and found.reason
    assert (found.irradiance == found.irradiance[0]).all() and (found.environment.radiance == found.irradiance[0]).all()
    scale = found.irradiance[0, 0]
    np.testing.assert_allclose(found.albedo, np.clip(captured / scale, DARKEST, LIGHTEST), atol=0.02)


def test_the_light_of_a_plane_cannot_be_separated():
    vertices, normals, faces = flat()
    occluder = Occluder(vertices, normals, faces)
    captured = 0.7 * patchy(occluder)
    found = estimate(occluder, captured)
    as_captured(found, captured)
    assert found.evidence < 0.1


@pytest.mark.parametrize("value", [0.0, 1.0, np.nan, np.inf, -1.0])
@pytest.mark.filterwarnings("ignore::splat2mesh.base.errors.DataWarning")
def test_black_clipped_and_broken_colours_fall_back(value):
    scene = objects()
    captured = np.full((len(scene[3]), 3), value, np.float32)
    found = estimate(scene[0], captured, **given(scene))
    as_captured(found, np.nan_to_num(captured, nan=0, posinf=0))
    for array in (found.albedo, found.irradiance, found.environment.radiance, found.direction):
        assert np.isfinite(array).all()
    known = with_known_light(scene[0], captured, lamp_light(), **given(scene))
    assert not known.separable and np.isfinite(known.albedo).all()


def test_some_broken_colours_are_counted_and_do_no_harm():
    scene = objects()
    albedo, captured = photo()[0], photo()[1].copy()
    captured[:50] = np.nan
    with pytest.warns(DataWarning, match=f"50 of {len(captured)} captured colours"):
        found = estimate(scene[0], captured, **given(scene))
    assert found.separable and np.isfinite(found.albedo).all()
    assert error(found.albedo[50:], albedo[50:], scene[3][50:] > 0.15) < 0.12


def test_a_single_triangle_and_a_black_light():
    corner = np.eye(3, dtype=np.float32)
    occluder = Occluder(corner, np.tile(np.float32([1, 1, 1]), (3, 1)), np.array([[0, 1, 2]]))
    found = estimate(occluder, np.full((3, 3), 0.3))
    as_captured(found, np.full((3, 3), 0.3))
    scene = objects()
    captured = photo()[1]
    dark = with_known_light(scene[0], captured, Environment(np.zeros((8, 16, 3)), "night"), **given(scene))
    assert not dark.separable and "night" in dark.reason


def test_a_closed_room_falls_back():
    room = o3d.geometry.TriangleMesh.create_box(2, 2, 2).subdivide_midpoint(4)
    room.compute_vertex_normals()
    occluder = Occluder(np.asarray(room.vertices), -np.asarray(room.vertex_normals), np.asarray(room.triangles))
    captured = np.random.default_rng(7).uniform(0.2, 0.6, (len(room.vertices), 3))
    found = estimate(occluder, captured)
    as_captured(found, captured)
    assert np.isfinite(found.albedo).all()


def test_captured_colours_must_fit():
    scene = objects()
    for shape in ((3,), (len(scene[3]) - 1, 3), (len(scene[3]), 4)):
        with pytest.raises(InputError, match="captured colours"):
            estimate(scene[0], np.zeros(shape), **given(scene))
