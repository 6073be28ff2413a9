"""Procedural scenes: closed forms for the solids, physics for the light, a renderer for the splats."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from scipy.ndimage import binary_erosion
from scipy.spatial.transform import Rotation

from relight import Environment
from relight.transfer.occluder import Occluder
from scenes import KINDS, SceneTruth, bake, build, capture_views, exposure, seen_faces, shapes, splats_from
from scenes.__main__ import main
from scenes.cameras import FLIP, SCENE_FROM_SPLAT, write_colmap
from scenes.figure import grown
from scenes.plain_rays import raytraced
from scenes.splat import _from_z_to, _then_about_axis
from splat2mesh.base.errors import InputError
from splat2mesh.render.rasterize import rasterize
from splat2mesh.scene.color import luminance, srgb_from_linear
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.splats.formats import read_splats
from splat2mesh.views.colmap import read_colmap
from splat2mesh.views.upright import scene_from_splat

ROOT = Path(__file__).parents[2]
VERTICES = 12_000


@pytest.fixture(scope="module", params=KINDS)
def truth(request):
    return build(request.param, seed=3, vertices=VERTICES)


@pytest.fixture(scope="module")
def tabletop():
    return build("tabletop", seed=3, vertices=VERTICES)


@pytest.fixture(scope="module")
def blob():
    return build("object", seed=3, vertices=VERTICES)


@pytest.fixture(scope="module")
def blob_radiance(blob):
    radiance = bake(blob, Environment.load("studio"))
    return radiance * exposure(radiance)


def volume(vertices, faces):
    """Volume by the divergence theorem, positive when faces are counter-clockwise seen from outside."""
    a, b, c = (vertices[faces[:, corner]].astype(np.float64) for corner in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def as_truth(solid):
    vertices, faces = solid
    normals = shapes.vertex_normals(vertices, faces).astype(np.float32)
    white = np.ones_like(normals)
    return SceneTruth("object", 0, vertices.astype(np.float32), normals, faces.astype(np.int32), white, None)


def tracer_of(truth, flip=1):
    tracer = o3d.t.geometry.RaycastingScene()
    tracer.add_triangles((truth.vertices * flip).astype(np.float32), truth.faces.astype(np.uint32))
    return tracer


def test_every_solid_is_a_closed_surface_seen_from_outside(truth):
    edges = np.concatenate([truth.faces[:, [0, 1]], truth.faces[:, [1, 2]], truth.faces[:, [2, 0]]])
    forward, backward = (set(map(tuple, direction.tolist())) for direction in (edges, edges[:, ::-1]))
    assert len(forward) == len(edges)
    assert forward == backward
    part = truth.part[truth.faces]
    assert (part == part[:, :1]).all()
    assert all(volume(truth.vertices, truth.faces[part[:, 0] == one]) > 0 for one in np.unique(truth.part))
    assert np.unique(truth.faces).size == len(truth.vertices)


def test_vertex_count_follows_the_wish(truth):
    assert abs(len(truth.vertices) / VERTICES - 1) < 0.1


def test_normals_are_unit_and_agree_with_the_faces(truth):
    np.testing.assert_allclose(np.linalg.norm(truth.normals, axis=1), 1, atol=1e-6)
    a, b, c = (truth.vertices[truth.faces[:, corner]].astype(np.float64) for corner in range(3))
    face_normals = np.cross(b - a, c - a)
    assert (np.einsum("ij,ikj->ik", face_normals, truth.normals[truth.faces]) > 0).all()


def test_albedo_is_physical_and_varies(truth):
    assert truth.albedo_linear.min() > 0.02
    assert truth.albedo_linear.max() <= 0.9
    assert len(np.unique(truth.albedo_linear.round(2), axis=0)) > 10


def test_same_seed_same_scene_and_other_seed_other_scene(truth):
    again, other = (build(truth.kind, seed, VERTICES) for seed in (3, 4))
    for name in ("vertices", "normals", "faces", "albedo_linear", "part"):
        np.testing.assert_array_equal(getattr(again, name), getattr(truth, name))
    assert other.part.max() == truth.part.max()
    assert not np.array_equal(other.albedo_linear[:100], truth.albedo_linear[:100])


@pytest.mark.parametrize("kind", ["figure", "machine", "still-life"])
def test_seeds_are_dark_and_light_even_and_patchy(kind):
    tones = [np.log(luminance(build(kind, seed, 2000).albedo_linear)) for seed in range(16)]
    medians, spreads = (np.array([measure(tone) for tone in tones]) for measure in (np.median, np.std))
    assert np.exp(medians.min()) < 0.15 and np.exp(medians.max()) > 0.5
    assert spreads.min() < 0.15 and spreads.max() > 0.5


def test_a_grown_solid_is_its_ellipsoid():
    axes = np.array([0.3, 0.5, 0.2])
    points, faces = grown(np.array([1.0, 2.0, 3.0]), [((1.0, 2.0, 3.0), axes)], 0.03, lambda at: 0 * at[:, 0])
    np.testing.assert_allclose(np.linalg.norm((points - [1, 2, 3]) / axes, axis=1), 1.0, atol=1e-5)
    assert volume(points, faces) == pytest.approx(4 / 3 * np.pi * axes.prod(), rel=0.02)  # inscribed facets


def test_tessellation_leaves_the_shape_alone(truth):
    fine = build(truth.kind, 3, 4 * VERTICES)
    # Chords of a curve with radius r and edges h cut off h^2 / 8r: about 1e-3 of the volumes at these counts.
    assert volume(fine.vertices, fine.faces) == pytest.approx(volume(truth.vertices, truth.faces), rel=0.02)
    np.testing.assert_allclose(fine.vertices.max(axis=0), truth.vertices.max(axis=0), atol=0.02)


@pytest.mark.parametrize(("kind", "vertices"), [("kitchen", VERTICES), ("room", 10)])
def test_impossible_scenes_are_refused(kind, vertices):
    with pytest.raises(InputError, match="expected"):
        build(kind, 0, vertices)


def test_volumes_meet_their_closed_forms():
    # Inscribed facets lose volume in proportion to edge^2; 0.02 against radii of 0.1 to 0.5 costs below 1%.
    ring, tube = 0.5, 0.1
    assert volume(*shapes.torus(ring, tube, 0.02)) == pytest.approx(2 * np.pi**2 * ring * tube**2, rel=0.01)
    ball = shapes.blob(0.5, 0.0, np.random.default_rng(0), 0.02)
    assert volume(*ball) == pytest.approx(np.pi / 6, rel=0.01)
    bevel, core = 0.1, np.array([0.8, 0.4, 0.2])  # Steiner's formula for a box grown by `bevel`
    steiner = core.prod() + 2 * bevel * (core[0] * core[1] + core[1] * core[2] + core[2] * core[0])
    steiner += np.pi * bevel**2 * core.sum() + 4 / 3 * np.pi * bevel**3
    assert volume(*shapes.rounded_box(core + 2 * bevel, bevel, 0.02)) == pytest.approx(steiner, rel=0.01)


def test_normals_of_a_ball_point_away_from_its_centre():
    points, faces = shapes.blob(0.5, 0.0, np.random.default_rng(0), 0.02)
    # Half an edge over the radius: where three faces of the lattice meet, the weights are lopsided.
    np.testing.assert_allclose(shapes.vertex_normals(points, faces), points / 0.5, atol=0.02)


def test_the_bowl_is_hollow(tabletop):
    bowl = tabletop.part == 6
    middle = (tabletop.vertices[bowl].min(axis=0) + tabletop.vertices[bowl].max(axis=0)) / 2
    down = np.float32([[middle[0], 2, middle[2], 0, -1, 0]])
    floor = 2 - tracer_of(tabletop).cast_rays(o3d.core.Tensor(down))["t_hit"].numpy()[0]
    assert 0.02 < floor < 0.3 * tabletop.vertices[bowl, 1].max()


def test_one_lit_texel_lights_by_the_cosine_and_casts_its_shadow(tabletop):
    radiance = np.zeros((64, 128, 3), np.float32)
    radiance[3, 40] = 5.0, 3.0, 1.0
    latitude, longitude = np.pi * (0.5 - 3.5 / 64), np.pi * (1 - 2 * 40.5 / 128)
    toward = np.array([np.sin(longitude), 0, np.cos(longitude)]) * np.cos(latitude) + [0, np.sin(latitude), 0]
    solid_angle = np.cos(latitude) * 2 * np.pi**2 / (64 * 128)
    baked = bake(tabletop, Environment(radiance))
    cosine = np.maximum(tabletop.normals @ toward, 0)
    unshadowed = tabletop.albedo_linear / np.pi * solid_angle * radiance[3, 40] * cosine[:, None]
    start = tabletop.vertices + 5e-4 * tabletop.normals
    rays = np.hstack([start, np.broadcast_to(toward, start.shape)]).astype(np.float32)
    hidden = tracer_of(tabletop).test_occlusions(o3d.core.Tensor(rays)).numpy() | (cosine == 0)
    lit = ~hidden & (cosine > 0.2)
    np.testing.assert_allclose(baked[lit], unshadowed[lit], rtol=1e-4)  # float32 directions
    assert hidden[cosine > 0.2].mean() > 0.05
    # Origins differ by a few 1e-4 of the scene, which moves few vertices across a shadow's edge.
    assert (baked[hidden] == 0).all(axis=1).mean() > 0.99


def test_a_constant_sky_gives_an_unshadowed_white_ball_exactly_its_radiance():
    ball = as_truth(shapes.blob(0.5, 0.0, np.random.default_rng(0), 0.05))
    baked = bake(ball, Environment(np.ones((32, 64, 3), np.float32)))
    # 512 low-discrepancy directions integrate a cosine lobe to about 1 / 512^(3/4) = 0.9%.
    np.testing.assert_allclose(baked, 1, atol=0.02)


def test_light_agrees_with_ray_traced_transfer(tabletop):
    sky = Environment.load("overcast")
    occluder = Occluder(tabletop.vertices, tabletop.normals, tabletop.faces)
    transfer = raytraced(occluder, slice(None), bands=6, rays=256)
    expected = tabletop.albedo_linear * (transfer @ sky.sh(6))
    error = np.linalg.norm(bake(tabletop, sky) - expected) / np.linalg.norm(expected)
    assert error < 0.03  # 1% of ray noise on either side, and what bands beyond the sixth hold


def test_a_black_environment_is_refused(blob):
    with pytest.raises(InputError, match="black"):
        bake(blob, Environment(np.zeros((8, 16, 3), np.float32)))


def test_exposure_leaves_little_to_clip(blob, blob_radiance):
    assert 0.005 < (blob_radiance.max(axis=1) > 0.9).mean() < 0.03


def test_cameras_are_level_upright_and_see_the_scene(truth):
    views = capture_views(truth, 24)
    assert max(abs(view.camera_from_world[0, 1]) for view in views) < 1e-12
    assert max(view.camera_from_world[1, 1] for view in views) > 0
    np.testing.assert_allclose(scene_from_splat("auto", views), SCENE_FROM_SPLAT, atol=1e-9)
    seen = sum(view.project(truth.vertices * FLIP)[1] > 0 for view in views)
    assert (seen > 0).all()


def test_colmap_model_reads_back(truth, tmp_path):
    views = capture_views(truth, 9)
    write_colmap(tmp_path, views)
    for view, read in zip(views, read_colmap(tmp_path), strict=True):
        np.testing.assert_allclose(read.camera_from_world, view.camera_from_world, atol=1e-9)
        assert (read.width, read.height) == (view.width, view.height)
        # Intrinsics are written with nine digits.
        np.testing.assert_allclose(
            [read.fx, read.fy, read.cx, read.cy], [view.fx, view.fy, view.cx, view.cy], rtol=1e-8
        )


def test_only_what_a_camera_can_see_counts_as_seen(truth):
    seen = seen_faces(truth, capture_views(truth, 48))
    vertices, normals = truth.vertices[truth.faces].mean(axis=1), truth.normals[truth.faces].mean(axis=1)
    if truth.kind == "object":
        assert seen.mean() > 0.99
    if truth.kind == "tabletop":
        assert not seen[vertices[:, 1] < -0.139].any()
        assert seen[(np.abs(vertices[:, 1]) < 1e-3) & (np.abs(vertices).max(axis=1) > 1.3)].all()
    if truth.kind == "room":
        outside = (np.abs(vertices[:, 0]) > 2.3) & (np.sign(vertices[:, 0]) * normals[:, 0] > 0.9)
        assert outside.sum() > 100
        assert not seen[outside].any()
        assert seen[truth.part[truth.faces[:, 0]] == truth.part.max()].mean() > 0.5


def test_splats_are_the_same_for_the_same_seed_and_as_many_as_asked(blob, blob_radiance):
    first, again, other = (splats_from(blob, blob_radiance, 2001, seed) for seed in (5, 5, 6))
    for name in ("means", "scales", "quats_wxyz", "opacities", "sh"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))
    assert len(first) == len(other) == 2001
    assert not np.array_equal(first.means, other.means)


def test_splats_have_the_statistics_of_trained_ones(blob, blob_radiance):
    count = 20_000
    splats = splats_from(blob, blob_radiance, count)
    tracer = tracer_of(blob, FLIP)
    points = o3d.core.Tensor(splats.means)
    closest = tracer.compute_closest_points(points)
    a, b, c = (blob.vertices[blob.faces[:, corner]].astype(np.float64) * FLIP for corner in range(3))
    cross = np.cross(b - a, c - a)
    spacing = np.sqrt(np.linalg.norm(cross, axis=1).sum() / 2 / count)
    normals = (cross / np.linalg.norm(cross, axis=1, keepdims=True))[closest["primitive_ids"].numpy()]
    offset = np.einsum("ij,ij->i", splats.means - closest["points"].numpy(), normals) / spacing
    scales = np.sort(splats.scales, axis=1)[:, ::-1]
    shortest = np.take_along_axis(splats.rotation_matrices(), splats.scales.argmin(axis=1)[:, None, None], axis=2)[
        ..., 0
    ]
    tilt_deg = np.degrees(np.arccos(np.clip(np.abs(np.einsum("ij,ij->i", shortest, normals)), 0, 1)))
    # Ranges around two trainings with vanilla 3DGS, in spacings: see the constants of scenes.splat.
    assert 1.2 < np.median(scales[:, 0]) / spacing < 1.8
    assert 0.2 < np.median(scales[:, 1] / scales[:, 0]) < 0.6
    assert 0.2 < np.median(scales[:, 2] / scales[:, 1]) < 0.3
    assert 0.12 < np.median(splats.opacities) < 0.4
    assert 0.1 < (splats.opacities > 0.9).mean() < 0.22
    assert -1.3 < np.median(offset) < -0.4
    assert (offset < 0).mean() > 0.95
    assert 10 < np.median(tilt_deg) < 21
    assert 1 <= (offset > 10).sum() <= 10  # floaters


def test_splats_render_like_the_mesh(blob, blob_radiance):
    """Against the mesh itself, ray cast: full coverage, colours in their places, depth at the surface."""
    splats = splats_from(blob, blob_radiance, 30_000)
    tracer, colors = tracer_of(blob, FLIP), np.clip(srgb_from_linear(blob_radiance), 0, 1)
    for view in capture_views(blob, 12, width=128)[2::4]:
        directions = view.ray_directions()
        rays = np.concatenate([np.broadcast_to(view.center, directions.shape), directions], axis=-1)
        hit = {
            name: value.numpy() for name, value in tracer.cast_rays(o3d.core.Tensor(rays.astype(np.float32))).items()
        }
        inside = binary_erosion(np.isfinite(hit["t_hit"]), iterations=2)
        face, uv = blob.faces[hit["primitive_ids"][inside]], hit["primitive_uvs"][inside]
        weights = np.column_stack([1 - uv.sum(axis=1), uv])
        expected = np.einsum("ij,ijk->ik", weights, colors[face])
        image = rasterize(splats, view)
        assert inside.sum() > 1000
        assert np.percentile(image.alpha[inside], 0.5) > 0.98
        error = image.color[inside] - expected
        assert -10 * np.log10((error**2).mean()) > 26  # dB: blur across the borders of the albedo patches
        assert np.abs(error.mean(axis=0)).max() < 0.01
        assert np.abs(np.median(image.depth_median[inside] - hit["t_hit"][inside])) < 0.01
        outside = ~np.isfinite(hit["t_hit"])
        assert image.alpha[~binary_erosion(~outside, border_value=1) & outside].mean() < 0.2


def test_no_splats_where_nothing_was_seen(tabletop):
    seen = seen_faces(tabletop, capture_views(tabletop, 24))
    grey = np.full_like(tabletop.vertices, 0.5)
    all_over, as_seen = (splats_from(tabletop, grey, 5000, 0, faces) for faces in (None, seen))
    # Under the middle of the slab, away from its rim, lies only what covers its underside, and two floaters.
    under = [
        ((splats.means[:, 1] > 0.07) & (np.abs(splats.means[:, ::2]) < 1.1).all(axis=1)).sum()
        for splats in (all_over, as_seen)
    ]
    assert under[0] > 200
    assert under[1] <= 2


def test_rotations_match_scipy():
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(200, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals[:2] = (0, 0, -1), (0, 0, 1)
    quats = _from_z_to(normals)
    rotation = Rotation.from_quat(quats, scalar_first=True)
    np.testing.assert_allclose(rotation.apply([0, 0, 1]), normals, atol=1e-12)
    angle = rng.uniform(-3, 3, 200)
    for axis in (1, 2, 3):
        step = Rotation.from_rotvec(angle[:, None] * np.eye(3)[axis - 1])
        turned = Rotation.from_quat(_then_about_axis(quats, axis, angle), scalar_first=True)
        np.testing.assert_allclose(turned.as_matrix(), (rotation * step).as_matrix(), atol=1e-12)


def generate(*arguments):
    command = [sys.executable, "-m", "scenes", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


@pytest.mark.slow
def test_command_writes_a_scene_that_the_tools_read(tmp_path):
    out = tmp_path / "scene"
    options = (out, "--splats", 1500, "--vertices", 3000, "--views", 10, "--env", "sunset", "--seed", 2)
    done = generate(*options, "--json")
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts == json.loads((out / "truth.json").read_text())
    assert (facts["kind"], facts["seed"], facts["environment"]) == ("tabletop", 2, "sunset")
    assert len(read_splats(out / "splat.ply")) == facts["splats"] == 1500
    assert len(read_colmap(out / "sparse" / "0")) == facts["views"] == 10
    truth, mesh = build("tabletop", 2, 3000), read_mesh(out / "truth.ply")
    np.testing.assert_array_equal(mesh.vertices, truth.vertices)
    np.testing.assert_array_equal(mesh.faces, truth.faces)
    np.testing.assert_array_equal(mesh.normals, truth.normals)
    header, body = (out / "truth.ply").read_bytes().split(b"end_header\n", 1)
    layout = [("floats", "<f4", 9), ("color", "u1", 3), ("part", "u1"), ("seen", "u1")]
    vertex = np.frombuffer(body, layout, count=len(truth.vertices))
    assert b"property float nz\nproperty float albedo_r\nproperty float albedo_g" in header
    np.testing.assert_array_equal(vertex["floats"][:, 6:], truth.albedo_linear)
    np.testing.assert_array_equal(vertex["part"], truth.part)
    assert set(vertex["seen"]) == {0, 1}
    radiance = bake(truth, Environment.load("sunset")) * facts["exposure"]
    np.testing.assert_allclose(mesh.colors_srgb, 255 * np.clip(srgb_from_linear(radiance), 0, 1), atol=0.51)

    refused = generate(*options)
    assert (refused.returncode, refused.stdout) == (2, "")
    assert refused.stderr.count("\n") == 1
    assert "--overwrite" in refused.stderr
    before = (out / "splat.ply").read_bytes()
    again = generate(*options, "--overwrite")
    assert again.returncode == 0, again.stderr
    assert (out / "splat.ply").read_bytes() == before


@pytest.mark.parametrize(
    "arguments", [("--env", "nowhere"), ("--splats", 3), ("--views", 1), ("--seed", -1), ("--kind", "cellar")]
)
def test_command_refuses_bad_usage_and_leaves_nothing(tmp_path, capsys, arguments):
    try:
        code = main([str(tmp_path / "scene"), *map(str, arguments)])
    except SystemExit as stopped:  # by argparse
        code = stopped.code
    said = capsys.readouterr().err
    assert code == 2 and said and "Traceback" not in said
    assert list(tmp_path.iterdir()) == []
