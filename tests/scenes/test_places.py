"""Generated places: furnaces and closed forms for their light, cameras and pictures for their splats."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from relight import Environment
from scenes import capture_views, shapes
from scenes.__main__ import main
from scenes.cameras import FLIP, write_inria_cameras
from scenes.capture import LEAF, SKY, SOLID, capture, seen_distance
from scenes.photograph import photograph
from scenes.places import PLACES, Place, build_place
from scenes.radiosity import light
from scenes.sky import capture_sky, cloudy
from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.render.raycaster import RayCaster
from splat2mesh.scene.color import luminance, srgb_from_linear
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.splats.formats import read_splats
from splat2mesh.views.cameras import read_colmap

ROOT = Path(__file__).parents[2]
VERTICES = 6000
WHITE = Environment(np.ones((16, 32, 3), np.float32), "white")


def place_of(*solids, albedo=0.5, emitted=0.0, openings=None):
    """A Place without leaves from (vertices, faces) and their albedos and emissions."""
    counts = [len(points) for points, _ in solids]
    starts = np.cumsum([0, *counts[:-1]])
    points = np.concatenate([points for points, _ in solids])
    faces = np.concatenate([faces + start for (_, faces), start in zip(solids, starts, strict=True)])
    part = np.repeat(np.arange(len(solids)), counts).astype(np.uint8)
    normals = shapes.vertex_normals(points, faces).astype(np.float32)
    colors, glow = (np.repeat(np.broadcast_to(a, len(solids)), counts).astype(np.float32) for a in (albedo, emitted))
    colors, glow = (np.repeat(a[:, None], 3, axis=1) for a in (colors, glow))
    volume, paints = np.zeros(len(points), bool), (None,) * len(solids)
    mesh = points.astype(np.float32), normals, faces.astype(np.int32)
    return Place("test", 0, *mesh, colors, part, glow, volume, len(points), 0.0, openings, paints, None)


def caster_of(place):
    return RayCaster(place.vertices, place.faces)


def inside_out(solid):
    return solid[0], solid[1][:, ::-1]


@pytest.fixture(scope="module", params=PLACES)
def place(request):
    return build_place(request.param, 3, VERTICES)


@pytest.fixture(scope="module")
def garden():
    return build_place("garden", 3, 12_000)


@pytest.fixture(scope="module")
def garden_light(garden):
    return light(garden, cloudy())


@pytest.fixture(scope="module")
def garden_capture(garden, garden_light):
    return capture(garden, garden_light, capture_views(garden, 24), 6000, 1, degree=1)


def test_places_are_sound(place):
    if place.kind not in (
        "garden",
        "lounge",
        "courtyard",
        "street",
    ):  # furniture needs its corners, however few are wished
        assert abs(len(place.vertices) / VERTICES - 1) < 0.2
    np.testing.assert_allclose(np.linalg.norm(place.normals, axis=1), 1, atol=1e-5)
    assert np.unique(place.faces).size == len(place.vertices)
    assert 0.01 < place.albedo_linear.min() and place.albedo_linear.max() <= 0.86
    assert place.volume[place.leaf_start :].all()
    assert len(place.paints) == place.part.max() + 1


def test_same_seed_same_place_and_other_seed_other_place():
    first, again, other = (build_place("garden", seed, VERTICES) for seed in (5, 5, 6))
    for name in ("vertices", "normals", "faces", "albedo_linear", "part"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert not np.array_equal(first.vertices[:2000], other.vertices[:2000])


def test_paints_say_what_the_vertices_have(garden):
    rows = np.arange(0, garden.leaf_start, 7)
    again = garden.albedo(garden.vertices[rows], garden.normals[rows], garden.part[rows], garden.albedo_linear[rows])
    # Paints see float32 places instead of float64: a few vertices lie on a joint.
    assert (np.abs(again - garden.albedo_linear[rows]).max(axis=1) < 0.01).mean() > 0.97


@pytest.mark.parametrize("kind", ["courtyard", "street"])
def test_another_seed_furnishes_a_place_of_houses_anew(kind):
    first, again, other = (build_place(kind, seed, VERTICES) for seed in (5, 5, 6))
    for name in ("vertices", "normals", "faces", "albedo_linear", "part"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert np.abs(np.ptp(first.vertices, axis=0) - np.ptp(other.vertices, axis=0)).max() > 0.1


@pytest.mark.parametrize("kind", ["courtyard", "street"])
def test_a_walk_stays_between_the_houses_and_meets_fronts(kind):
    """No eye stands inside a thing: the nearest surface on every ray shows its front."""
    for seed in range(3):
        place = build_place(kind, seed, VERTICES)
        wrong = 0
        for view in capture_views(place, 12, 24):
            toward = (view.ray_directions() * FLIP).reshape(-1, 3)
            hits = caster_of(place).first_hits(np.hstack([np.broadcast_to(view.center * FLIP, toward.shape), toward]))
            corners = place.vertices[place.faces[hits.faces]]
            out = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
            wrong += ((np.einsum("nk,nk->n", out, toward) > 0) & (hits.faces >= 0)).sum()
        assert wrong < 0.002 * 12 * 24 * 24  # seams


@pytest.mark.parametrize(("kind", "vertices"), [("barn", VERTICES), ("garden", 10)])
def test_impossible_places_are_refused(kind, vertices):
    with pytest.raises(InputError, match="expected"):
        build_place(kind, 0, vertices)


@pytest.mark.parametrize("kind", ["garden", "courtyard", "nook", "forest", "white-sky"])
def test_furnace(kind):
    """Where every surface gives off what it does not reflect, and the sky is 1, all radiance is 1."""
    found = build_place(kind, 2, VERTICES)
    place = replace(found, emitted=1 - found.albedo_linear)
    views = capture_views(place, 12)
    seen = np.unique(place.faces[np.isfinite(seen_distance(place, caster_of(place), views))])
    radiance = light(replace(place, emitted=np.zeros_like(place.emitted)), WHITE).radiance()
    assert radiance[seen].max() < 1.0  # nothing comes from nowhere
    whole, backs = furnace(place)
    assert np.median(whole[seen]) == pytest.approx(1, abs=0.01)
    # What stands in another solid, as frames in walls and legs in the ground, sees its back from within: unlit.
    free = seen[backs[seen] == 0]
    assert len(free) > 0.4 * len(seen)
    assert np.abs(whole[free] - 1).mean() < 0.02  # 96 rays a point, 192 directions of the sky
    assert (whole[seen].mean(axis=1) < 1.05).mean() > 0.95  # backs take light, never give any


def furnace(place):
    """Radiance (V, 3) and the share of backs in what each vertex sees (V,).

    Emission is gathered like reflected light: here all of the place is one lamp.
    """
    from scenes import radiosity

    dark = replace(place, emitted=np.zeros_like(place.emitted))
    caster = caster_of(dark)
    (points, normals), of_vertex = radiosity._shading_points(dark)
    matrix = radiosity._gathering(caster, dark, of_vertex, points, normals, 96)
    turned = replace(dark, normals=-dark.normals)
    backs = radiosity._gathering(caster, turned, of_vertex, points, normals, 96).sum(axis=1)
    glow, albedo = np.zeros_like(points), np.zeros_like(points)
    glow[of_vertex], albedo[of_vertex] = place.emitted, place.albedo_linear
    sky = radiosity._crossed(dark, radiosity._from_sky(caster, WHITE, points, normals), len(points))
    radiance = glow + albedo * sky
    for _ in range(40):
        radiance = glow + albedo * (sky + radiosity._crossed(dark, matrix @ radiance, len(points)))
    return radiance[of_vertex], np.asarray(backs).ravel()[of_vertex]


def test_a_glowing_ball_in_a_white_box_is_energy_kept():
    """All that a lamp gives off is absorbed: sum of (1 - albedo) x irradiance x area is pi x radiance x its area."""
    box = inside_out(shapes.rounded_box((2.0, 2.0, 2.0), 0.05, 0.1))
    ball = shapes.blob(0.2, 0.0, np.random.default_rng(0), 0.04)
    place = place_of(box, ball, albedo=(0.6, 0.0), emitted=(0.0, 3.0), openings=np.zeros((0, 3, 3)))
    lighting = light(place, WHITE)
    corners = place.vertices[place.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    each = np.bincount(place.faces.ravel(), np.repeat(area / 3, 3), len(place.vertices))
    taken = ((1 - place.albedo_linear) * lighting.ambient * np.pi)[:, 0] * each
    given = np.pi * 3.0 * each[place.part == 1].sum()
    assert taken.sum() == pytest.approx(given, rel=0.03)  # 32 points on the lamp, 144 rays a vertex


def test_a_far_ball_lights_by_the_inverse_square():
    ball = shapes.blob(0.1, 0.0, np.random.default_rng(0), 0.02)
    floor = shapes.rounded_box((0.2, 0.02, 0.2), 0.004, 0.05)
    place = place_of(
        (ball[0] + [0, 2.0, 0], ball[1]), floor, albedo=0.3, emitted=(5.0, 0.0), openings=np.zeros((0, 3, 3))
    )
    up = (place.part == 1) & (place.normals[:, 1] > 0.99)
    # A sphere of radiance L and radius r brings E = pi L (r / d)^2, and d is 1.99 from the middle of the plate.
    np.testing.assert_allclose(light(place, WHITE).ambient[up], 5.0 * (0.1 / 1.99) ** 2, rtol=0.04)


def test_no_light_enters_a_closed_box():
    place = build_place("closed-box", 1, VERTICES)
    for environment in (WHITE, Environment.load("noon")):
        lighting = light(place, environment, lamps=0.0)
        views = capture_views(place, 12)
        seen = np.unique(place.faces[np.isfinite(seen_distance(place, lighting.caster, views))])
        assert lighting.radiance()[seen].max() < 1e-5  # a sun of 6e4 finds a seam in a million rays
        with pytest.raises(InputError, match="no light"):
            capture(place, lighting, views, 500)
    assert light(place, WHITE).radiance()[seen].min() > 0


def test_windows_bring_what_the_sky_brings():
    """Drawn on the window or in the sky: two ways to the same irradiance."""
    place = build_place("one-window", 1, VERTICES)
    sky = Environment.load("overcast")
    by_window = light(place, sky)
    from scenes import radiosity

    (points, normals), _ = radiosity._shading_points(place)
    inside = radiosity._inside(place, points)
    radiosity_directions = radiosity._from_sky(by_window.caster, sky, points[inside], normals[inside], 4096)
    window = radiosity._from_windows(by_window.caster, sky, place.openings, points[inside], normals[inside])
    views = capture_views(place, 12)
    seen = np.unique(place.faces[np.isfinite(seen_distance(place, by_window.caster, views))])
    rows = np.isin(np.flatnonzero(inside), seen)
    assert window[rows].sum() == pytest.approx(radiosity_directions[rows].sum(), rel=0.05)


@pytest.mark.slow
def test_lamps_add_up_and_scale(monkeypatch):
    monkeypatch.setattr("scenes.radiosity.CLOSED_GATHER", 48)  # the same rays for all three
    place, sky = build_place("lounge", 1, VERTICES), Environment.load("overcast")
    none, one, three = (light(place, sky, lamps).radiance().astype(float) for lamps in (0, 1, 3))
    np.testing.assert_allclose(three - none, 3 * (one - none), atol=0.02 * one.max(), rtol=0.02)
    assert (one - none)[place.emitted.any(axis=1)].mean() > 2
    with pytest.raises(InputError, match="at least 0"):
        light(place, sky, -1.0)


@pytest.mark.slow
def test_every_camera_sees_a_solid_place(place):
    views = capture_views(place, 16, 64)
    lighting = light(place, WHITE)
    splats = capture(place, lighting, views, 3000, 2).splats
    assert len(splats) == 3000
    for view in views:
        solid = photograph(lighting, view)[1]
        assert solid.mean() > 0.2
        alpha = rasterize(splats, view).alpha
        assert np.mean(alpha[solid] > 0.5) > 0.75  # coarse: thin things and rims are lost at 3000


def test_captures_are_the_same_for_the_same_seed(garden, garden_light, garden_capture):
    again = capture(garden, garden_light, capture_views(garden, 24), 6000, 1, degree=1)
    for name in ("means", "scales", "quats_wxyz", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(again.splats, name), getattr(garden_capture.splats, name))
    relit = light(build_place("garden", 3, 12_000), cloudy())
    np.testing.assert_array_equal(relit.radiance(), garden_light.radiance())


def test_lit_by_its_own_light_a_capture_is_itself(garden_light, garden_capture):
    np.testing.assert_array_equal(garden_capture.lit(garden_light).sh, garden_capture.splats.sh)


def test_colours_are_the_light_on_the_albedo(garden, garden_light, garden_capture):
    solid = garden_capture.region == SOLID
    albedo = garden_capture.albedo(garden)
    assert np.isfinite(albedo[solid | (garden_capture.region == LEAF)]).all()
    assert np.isnan(albedo[garden_capture.region == SKY]).all()
    faces, weights = garden_capture.faces[solid], garden_capture.weights[solid]
    white = replace(garden, albedo_linear=np.ones_like(garden.albedo_linear), paints=(None,) * len(garden.paints))
    irradiance = replace(garden_light, place=white).at(faces, weights)
    np.testing.assert_allclose(garden_light.at(faces, weights), albedo[solid] * irradiance, rtol=1e-3, atol=1e-5)


def test_the_sky_is_captured_where_it_is(garden_light, garden_capture):
    sky = garden_capture.region == SKY
    assert 0.05 < sky.mean() < 0.2
    np.testing.assert_allclose(np.linalg.norm(garden_capture.toward[sky], axis=1), 1, atol=1e-6)
    means = garden_capture.splats.means[sky] * FLIP
    assert np.linalg.norm(means, axis=1).min() > 25
    shown = 0.5 + 0.28209479 * garden_capture.splats.sh[sky, 0]
    true = garden_capture.exposure * cloudy().lookup(garden_capture.toward[sky])
    np.testing.assert_allclose(shown, np.clip(srgb_from_linear(np.clip(true, 0, 1)), 0, 1), atol=0.08)
    assert 0.02 < (shown.min(axis=1) > 0.97).mean() < 0.9  # clipped in part, like a photograph


def test_a_white_sky_is_clipped_wholly():
    place = build_place("white-sky", 1, VERTICES)
    made = capture(place, light(place, Environment.load("overcast")), capture_views(place, 16), 2000)
    above = (made.region == SKY) & (made.toward[:, 1] > 0.05)
    assert above.sum() > 50
    assert (0.5 + 0.28209479 * made.splats.sh[above, 0]).min() > 0.93


def test_splats_grow_with_the_distance_to_the_cameras(garden_capture):
    solid = garden_capture.region == SOLID
    away = np.linalg.norm(garden_capture.splats.means[solid] * [1, 0, 1], axis=1)
    size = garden_capture.splats.scales[solid].max(axis=1)
    assert np.median(size[away > 12]) > 3 * np.median(size[away < 3])


def test_splats_look_like_the_photograph(garden, garden_light):
    views = capture_views(garden, 24, 96)
    made = capture(garden, garden_light, views, 40_000, 1)
    for view in views[::8]:
        picture, _ = photograph(garden_light, view, 2)
        true = np.clip(srgb_from_linear(np.clip(made.exposure * picture, 0, 1)), 0, 1)
        error = rasterize(made.splats, view).color.clip(0, 1) - true
        assert -10 * np.log10((error**2).mean()) > 16  # dB; 16.7 measured: leaves and slats are soft in so few splats
        assert np.abs(error.mean(axis=(0, 1))).max() < 0.04


def test_the_cloudy_sky_has_a_sun_and_mean_one():
    sky = cloudy()
    assert sky.mean_luminance == pytest.approx(1, abs=1e-3)
    peak = np.unravel_index(luminance(sky.radiance).argmax(), sky.radiance.shape[:2])
    assert 90 * (1 - 2 * (peak[0] + 0.5) / 256) == pytest.approx(44, abs=1)
    assert capture_sky("noon").name == "noon"


def test_inria_cameras_read_back(tmp_path):
    views = capture_views(build_place("nook", 0, VERTICES), 9)
    write_inria_cameras(tmp_path / "cameras.json", views)
    for view, entry in zip(views, json.loads((tmp_path / "cameras.json").read_text()), strict=True):
        np.testing.assert_allclose(entry["position"], view.center, atol=1e-12)
        np.testing.assert_allclose(np.array(entry["rotation"]).T, view.camera_from_world[:3, :3], atol=1e-12)
        assert (entry["width"], entry["height"], entry["fx"]) == (view.width, view.height, view.fx)


def generate(*arguments):
    command = [sys.executable, "-m", "scenes", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_command_writes_a_place_with_its_truth(tmp_path):
    out = tmp_path / "lounge"
    options = ("--splats", 1500, "--vertices", 5000, "--views", 12, "--env", "overcast", "--degree", 1)
    done = generate(out, "--kind", "lounge", *options, "--relit", "noon", "--lamps", 0, "--json")
    assert done.returncode == 0, done.stderr
    facts = json.loads((out / "truth.json").read_text())
    assert facts == json.loads(done.stdout)
    splats = read_splats(out / "point_cloud" / "iteration_30000" / "point_cloud.ply")
    assert (len(splats), splats.degree) == (1500, 1)
    assert len(read_colmap(out / "sparse" / "0")) == len(json.loads((out / "cameras.json").read_text())) == 12
    place, mesh = build_place("lounge", 0, 5000), read_mesh(out / "truth.ply")
    np.testing.assert_array_equal(mesh.vertices, place.vertices)
    sky = Environment.load(out / "environment.exr")
    np.testing.assert_array_equal(sky.radiance, Environment.load("overcast").radiance)
    scene, truth = np.load(out / "truth_scene.npz"), np.load(out / "truth_noon.npz")
    np.testing.assert_array_equal(scene["emitted"], place.emitted)
    assert scene["splat_albedo"].shape == (1500, 3)
    dark = light(place, Environment.load("noon"), lamps=0.0).radiance() * facts["exposure"]
    np.testing.assert_allclose(truth["vertex_radiance"], dark, rtol=2e-3, atol=1e-4)
    assert truth["splat_sh"].shape == splats.sh.shape
    assert truth["pictures"].shape[1:] == (256, 256, 3)


@pytest.mark.parametrize(
    "arguments", [("--kind", "tabletop", "--relit", "noon"), ("--kind", "garden", "--relit", "no")]
)
def test_command_refuses_what_it_cannot_do(tmp_path, capsys, arguments):
    assert main([str(tmp_path / "scene"), *arguments]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
