"""relight.texture: charts by search, colours against known ones, files against other readers."""

import json
import warnings

import imageio.v3 as iio
import numpy as np
import open3d as o3d
import pytest
from gltf_check import validator_issues
from scipy.spatial import cKDTree

from relight.albedo import Prior, albedo_of
from relight.jobs.textures import gloss_picture, textured, write_transfer
from relight.output.images import png_bytes
from relight.texture import KnownColors, bake
from splat2mesh.base.errors import InputError
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.splats import SH_C0, Splats


def eyes(directions, distance=6.0, fov_deg=30.0, pixels=500):
    """Views of the origin from directions of the scene frame, in that of the splat."""
    return [
        View.look_at(
            np.array(way) * [1, -1, -1] * distance / np.linalg.norm(way), [0, 0, 0], [0.1, 1, 0.2], fov_deg, pixels
        )
        for way in directions
    ]


FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
"""scene_from_splat of a y-down splat."""

AROUND = eyes([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)])


def sphere(resolution=12, radius=1.0):
    """A closed mesh with smooth normals, as (vertices, normals, faces)."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(radius, resolution)
    vertices = np.asarray(mesh.vertices).astype(np.float32)
    return vertices, (vertices / radius).astype(np.float32), np.asarray(mesh.triangles).astype(np.int32)


def scene_of(vertices, normals, faces, colors=None, limit=10**6, **fields):
    colors = np.full((len(vertices), 3), 200, np.uint8) if colors is None else colors
    return Scene.from_mesh(Mesh(vertices, normals, faces, colors), limit, **fields)


def random_colors(count, seed=0):
    return np.random.default_rng(seed).integers(0, 256, (count, 3), dtype=np.uint8)


def splats_on(points, normals, colors_srgb, scale, opacity=0.95):
    """Flat opaque Gaussians on a surface, given in the scene frame, as a y-down file holds them."""
    points, normals = points * [1, -1, -1], normals * [1, -1, -1]
    half = normals + np.array([0.0, 0.0, 1.0])  # the half-turn about it takes z to the normal
    bad = np.linalg.norm(half, axis=1) < 1e-3
    half[bad] = [1.0, 0.0, 0.0]
    quats = np.column_stack([np.zeros(len(points)), half / np.linalg.norm(half, axis=1, keepdims=True)])
    scales = np.tile([scale, scale, 0.05 * scale], (len(points), 1))
    return Splats(points, scales, quats, np.full(len(points), opacity), ((colors_srgb - 0.5) / SH_C0)[:, None])


def even_sphere(count):
    index = np.arange(count) + 0.5
    z, azimuth = 1 - 2 * index / count, index * np.pi * (3 - np.sqrt(5))
    return np.stack([np.sqrt(1 - z * z) * np.cos(azimuth), np.sqrt(1 - z * z) * np.sin(azimuth), z], axis=1)


def barycentric(points, corners):
    """Weights of points (N, 2) in one triangle (3, 2), by a linear system."""
    system = np.vstack([corners.T, np.ones(3)])
    return np.linalg.solve(system, np.vstack([points.T, np.ones(len(points))])).T


def bilinear(image, uv):
    """What a graphics card reads: linear values of an sRGB image (S, S, 3) uint8 at uv (N, 2), edges clamped."""
    linear, size = linear_from_srgb(image / 255.0), len(image)
    place = uv * size - 0.5
    low = np.floor(place).astype(int)
    result = 0.0
    for dx in (0, 1):
        for dy in (0, 1):
            part = np.abs(1 - dx - (place - low)[:, :1]) * np.abs(1 - dy - (place - low)[:, 1:])
            column, row = np.clip(low + np.array([dx, dy]), 0, size - 1).T
            result = result + part * linear[row, column]
    return result


@pytest.fixture(scope="module")
def ball():
    vertices, normals, faces = sphere()
    return scene_of(vertices, normals, faces, random_colors(len(vertices)), scene_from_splat=FLIP)


def test_charts_keep_their_distance(ball):
    atlas = bake(ball, size=256).atlas
    chart, parent = {}, list(range(len(atlas.uv)))

    def root(v):
        while parent[v] != v:
            v = parent[v]
        return v

    for a, b, c in atlas.faces:
        parent[root(a)] = root(b)
        parent[root(b)] = root(c)
    for number in range(len(atlas.faces)):
        chart.setdefault(root(atlas.faces[number, 0]), []).append(number)
    assert len(chart) > 1
    label = np.zeros(len(atlas.faces), int)
    for index, members in enumerate(chart.values()):
        label[members] = index
    texels, of = atlas.texels[atlas.inside], label[atlas.face[atlas.inside]]
    places = np.stack([texels % 256, texels // 256], axis=1)
    for index in range(len(chart)):
        apart, _ = cKDTree(places[of == index]).query(places[of != index])
        assert apart.min() >= 3  # both have a texel of their own beside them


def test_from_texel_to_surface_and_back(ball):
    atlas = bake(ball, size=128).atlas
    np.testing.assert_array_equal(ball.vertices[atlas.vertex[atlas.faces]], ball.vertices[ball.faces])
    np.testing.assert_allclose(atlas.weights.sum(axis=1), 1.0, atol=1e-6)
    assert atlas.weights.min() >= -1e-6
    place = np.einsum("tk,tkc->tc", atlas.weights, atlas.uv[atlas.faces[atlas.face]].astype(float)) * 128
    center = np.stack([atlas.texels % 128 + 0.5, atlas.texels // 128 + 0.5], axis=1)
    away = np.linalg.norm(place - center, axis=1)
    assert away[atlas.inside].max() < 1e-3  # float32 of coordinates up to 128
    assert 0.0 < away[~atlas.inside].max() <= 1.5 + 1e-3
    points = atlas.interpolate(ball.vertices)
    caster = o3d.t.geometry.RaycastingScene()
    caster.add_triangles(ball.vertices, ball.faces.astype(np.uint32))
    assert caster.compute_distance(points).numpy().max() < 1e-5


def test_constant_colour_stays_constant_in_every_texel():
    vertices, normals, faces = sphere()
    scene = scene_of(vertices, normals, faces, np.full((len(vertices), 3), (200, 90, 10), np.uint8))
    baked = bake(scene, size=64)
    image = baked.relit()
    assert image.shape == (64, 64, 3)
    assert (np.abs(image.astype(int) - (200, 90, 10)) <= 1).all()  # albedo is kept as half floats
    light = np.full((len(vertices), 3), 0.25)
    expected = np.round(255 * srgb_from_linear(0.5 * linear_from_srgb(np.array([200, 90, 10]) / 255)))
    assert (np.abs(baked.relit(2.0 * light, 1.0) - expected) <= 1).all()


def test_vertex_colours_come_back_at_the_vertices_and_seams_do_not_show(ball):
    smooth = np.clip(127.5 + 120 * ball.vertices, 0, 255).astype(np.uint8)
    scene = scene_of(ball.vertices, ball.normals, ball.faces, smooth)
    baked = bake(scene, size=512)
    shown = bilinear(baked.relit(), baked.atlas.uv.astype(float))
    expected = linear_from_srgb(smooth / 255.0)[baked.atlas.vertex]
    # A texel is a fortieth of an edge, where the colour changes by 0.2; a seam's copies are read in different charts.
    np.testing.assert_allclose(shown, expected, atol=0.012)


@pytest.mark.parametrize("limit", [60, 23])
def test_chunks_change_no_texel(limit):
    vertices, normals, faces = sphere()
    colors = random_colors(len(vertices))
    whole = scene_of(vertices, normals, faces, colors)
    cut = scene_of(vertices, normals, faces, colors, limit)
    assert len(cut.chunks) > 1
    light = np.abs(np.random.default_rng(3).normal(size=whole.vertices.shape)).astype(np.float32)
    own = light[cKDTree(whole.vertices).query(cut.vertices)[1]]
    expected = bake(whole, size=128).relit(light, 1.0)
    np.testing.assert_array_equal(bake(cut, size=128).relit(own, 1.0), expected)


def test_a_splats_checkerboard_arrives_sharp():
    """Cells that the mesh's vertices, 0.5 apart, cannot hold; edges no softer than splats and texels are."""
    xs, ys = np.meshgrid(np.linspace(-1, 1, 5), np.linspace(-1, 1, 5))
    vertices = np.stack([xs.ravel(), ys.ravel(), np.zeros(25)], axis=1).astype(np.float32)
    corner = (np.arange(4)[:, None] * 5 + np.arange(4)).ravel()
    faces = np.concatenate([corner[:, None] + [0, 1, 6], corner[:, None] + [0, 6, 5]]).astype(np.int32)
    scene = scene_of(vertices, np.tile(np.float32([0, 0, 1]), (25, 1)), faces, scene_from_splat=FLIP)
    step = 0.0125
    x, y = np.meshgrid(np.arange(-1, 1, step) + step / 2, np.arange(-1, 1, step) + step / 2)
    # The splats lie off the mesh, as those of a mesh with few faces do, by a twentieth of a cell.
    points = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.01)], axis=1)

    def board(p):
        return (np.floor(p[:, 0] / 0.2) + np.floor(p[:, 1] / 0.2)) % 2

    colors = np.where(board(points)[:, None] == 1, [0.9, 0.8, 0.2], [0.1, 0.2, 0.6])
    splats = splats_on(points, np.tile([0.0, 0, 1], (len(points), 1)), colors, 0.7 * step)
    views = eyes([(0, 0, 1), (0.5, 0, 1), (-0.3, 0.4, 1)], fov_deg=36.0, pixels=600)
    baked = bake(scene, splats, size=512, views=views)
    assert baked.unseen == 0
    places = baked.atlas.interpolate(scene.vertices)
    shown = srgb_from_linear(baked.albedo.astype(np.float32))
    to_edge = np.abs((places[:, :2] / 0.2 + 0.5) % 1.0 - 0.5).min(axis=1) * 0.2
    inner = (to_edge > 0.03) & (np.abs(places[:, :2]).max(axis=1) < 0.97)
    assert inner.mean() > 0.4
    expected = np.where(board(places)[:, None] == 1, [0.9, 0.8, 0.2], [0.1, 0.2, 0.6])
    np.testing.assert_allclose(shown[inner], expected[inner], atol=0.02)


def test_light_of_the_capture_is_divided_out(ball):
    count = len(ball.vertices)
    irradiance = (0.3 + 0.5 * np.random.default_rng(7).random((count, 3))).astype(np.float32)
    prior = Prior(np.full(3, 0.4, np.float32), np.full(3, 0.05, np.float32))
    plain, baked = bake(ball, size=64), bake(ball, None, KnownColors(irradiance, prior), size=64)
    captured = linear_from_srgb(np.rint(255 * srgb_from_linear(plain.albedo.astype(np.float32))) / np.float32(255))
    expected = albedo_of(captured.astype(np.float32), baked.atlas.interpolate(irradiance), prior)
    np.testing.assert_allclose(baked.albedo, expected, rtol=1e-3, atol=1e-4)  # half floats
    known = bake(ball, None, KnownColors(irradiance, albedo=np.full((count, 3), 0.5)), size=64)
    np.testing.assert_allclose(known.albedo, 0.5, atol=5e-4)


def test_texels_that_no_splat_covers_have_the_colours_of_vertices():
    vertices, normals, faces = sphere()
    grey = scene_of(vertices, normals, faces, np.full((len(vertices), 3), 90, np.uint8), scene_from_splat=FLIP)
    points = even_sphere(4000)
    covered = points[:, 2] > -0.3
    colors = np.tile([0.8, 0.3, 0.1], (len(points), 1))
    splats = splats_on(points[covered], points[covered], colors[covered], 0.04)
    baked = bake(grey, splats, size=128, views=AROUND)
    assert 0.2 < baked.unseen / len(baked.albedo) < 0.5
    shown = srgb_from_linear(baked.albedo.astype(np.float32))
    depth = baked.atlas.interpolate(vertices)[:, 2]
    np.testing.assert_allclose(shown[depth > -0.1], [[0.8, 0.3, 0.1]] * int((depth > -0.1).sum()), atol=0.01)
    np.testing.assert_allclose(shown[depth < -0.5], 90 / 255, atol=0.003)
    with pytest.raises(InputError, match="no view of the splat shows the mesh"):
        bake(grey, splats_on(points + 50.0, points, colors, 0.04), size=128, views=AROUND)


def test_both_sides_of_a_thin_wall_keep_their_colours():
    """Two squares a twentieth apart, red before and blue behind."""
    square = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    vertices = np.concatenate([square + np.float32([0, 0, 0.025]), square - np.float32([0, 0, 0.025])])
    normals = np.repeat(np.float32([[0, 0, 1], [0, 0, -1]]), 4, axis=0)
    scene = scene_of(vertices, normals, np.int32([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6]]), scene_from_splat=FLIP)
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 60), np.linspace(-1, 1, 60)), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.insert(grid, 2, z, axis=1) for z in (0.02, -0.02)])
    ways = np.repeat([[0.0, 0, 1], [0, 0, -1]], len(grid), axis=0)
    colors = np.repeat([[0.9, 0.1, 0.1], [0.1, 0.1, 0.9]], len(grid), axis=0)
    baked = bake(scene, splats_on(points, ways, colors, 0.03, 0.99), size=128, views=eyes([(0.3, 0, 1), (0, 0.3, -1)]))
    places = baked.atlas.interpolate(scene.vertices)
    expected = np.where(places[:, 2:] > 0, [0.9, 0.1, 0.1], [0.1, 0.1, 0.9])
    inner = np.abs(places[:, :2]).max(axis=1) < 0.95
    np.testing.assert_allclose(srgb_from_linear(baked.albedo.astype(np.float32))[inner], expected[inner], atol=0.02)


def test_a_view_shows_nothing_behind_the_mesh():
    """Of a square behind another, a view from the front shows the rim, one from the side the middle as well."""
    square = np.float32([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    vertices = np.concatenate([0.5 * square + np.float32([0, 0, 0.5]), square])
    normals = np.tile(np.float32([0, 0, 1]), (8, 1))
    faces = np.int32([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])
    scene = scene_of(vertices, normals, faces, scene_from_splat=FLIP)
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 80), np.linspace(-1, 1, 80)), axis=-1).reshape(-1, 2)
    points = np.concatenate([np.insert(0.5 * grid, 2, 0.5, axis=1), np.insert(grid, 2, 0.0, axis=1)])
    colors = np.repeat([[0.9, 0.1, 0.1], [0.1, 0.1, 0.9]], len(grid), axis=0)
    splats = splats_on(points, np.tile([0.0, 0, 1], (len(points), 1)), colors, 0.015, 0.9)
    front = bake(scene, splats, size=128, views=eyes([(0, 0, 1)]))
    places = front.atlas.interpolate(scene.vertices)
    expected = np.where(places[:, 2:] > 0.25, [0.9, 0.1, 0.1], [0.1, 0.1, 0.9])
    out, behind = np.abs(places[:, :2]).max(axis=1), places[:, 2] < 0.25
    inner = np.where(behind, (out > 0.64) & (out < 0.95), out < 0.47)  # splats at the rim reach farther
    shown = srgb_from_linear(front.albedo.astype(np.float32))[inner]
    np.testing.assert_allclose(shown, expected[inner], atol=0.025)  # two roundings to bytes, of .004, among it
    # Half of the side and a twelfth by perspective, and the pixels that the edge mixes.
    assert abs(front.unseen / behind.sum() - 0.25 * (6.0 / 5.5) ** 2) < 0.03
    sides = bake(scene, splats, size=128, views=eyes([(0.9, 0, 1), (-0.9, 0, 1)]))
    assert sides.unseen < 0.2 * front.unseen  # the rim of the nearer square has two depths in one pixel


@pytest.mark.parametrize("unlit", [True, False])
def test_glb_shows_the_same_colours_to_other_readers(tmp_path, ball, unlit):
    cut = scene_of(ball.vertices, ball.normals, ball.faces, ball.colors_srgb, 60)
    baked = bake(cut, size=128)
    image = baked.relit()
    for name in ("a.glb", "b.glb"):
        textured(cut, baked.atlas, [png_bytes(image)], unlit=unlit).save(tmp_path / name, {"exposure": 1.0})
    data = (tmp_path / "a.glb").read_bytes()
    assert data == (tmp_path / "b.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert ("KHR_materials_unlit" in document["materials"][0].get("extensions", {})) == unlit
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    start = 28 + int.from_bytes(data[12:16], "little") + view["byteOffset"]
    np.testing.assert_array_equal(iio.imread(data[start : start + view["byteLength"]]), image)
    model = o3d.io.read_triangle_model(str(tmp_path / "a.glb"))
    found = np.concatenate([_corners(part.mesh) for part in model.meshes])
    # open3d joins the meshes, and counts v from the bottom as OpenGL does.
    atlas = baked.atlas
    own = np.concatenate([cut.vertices[atlas.vertex], atlas.uv], axis=1)[atlas.faces].reshape(-1, 5)
    own[:, 4] = 1 - own[:, 4]
    np.testing.assert_allclose(found[np.lexsort(found.T)], own[np.lexsort(own.T)], atol=1e-6)


def _corners(mesh):
    """(3 F, 5) position and texture coordinates of the corners of an open3d mesh."""
    places = np.asarray(mesh.vertices)[np.asarray(mesh.triangles)].reshape(-1, 3)
    return np.concatenate([places, np.asarray(mesh.triangle_uvs)], axis=1).astype(np.float32)


@pytest.mark.parametrize("unlit", [True, False])
def test_khronos_finds_nothing_wrong(tmp_path, ball, unlit):
    cut = scene_of(ball.vertices, ball.normals, ball.faces, ball.colors_srgb, 60)
    baked = bake(cut, size=64)
    textured(cut, baked.atlas, [png_bytes(baked.relit())], unlit=unlit).save(tmp_path / "a.glb")
    issues = validator_issues(tmp_path / "a.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]


def test_gloss_is_in_a_texture_of_its_own_as_gltf_has_it(tmp_path, ball):
    scene = scene_of(ball.vertices, ball.normals, ball.faces, ball.colors_srgb, 40_000)
    baked = bake(scene, size=128)
    roughness = np.where(ball.vertices[:, 1] > 0, 0.4, 1.0).astype(np.float32)
    pictures = [png_bytes(baked.relit()), gloss_picture(baked.atlas, roughness)]
    textured(scene, baked.atlas, pictures, unlit=False).save(tmp_path / "a.glb")
    issues = validator_issues(tmp_path / "a.glb")
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"]
    data = (tmp_path / "a.glb").read_bytes()
    document = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    surface = document["materials"][0]["pbrMetallicRoughness"]
    assert surface["metallicFactor"] == surface["roughnessFactor"] == 1.0  # the texture's values count as they are
    source = document["textures"][surface["metallicRoughnessTexture"]["index"]]["source"]
    view = document["bufferViews"][document["images"][source]["bufferView"]]
    start = 28 + int.from_bytes(data[12:16], "little") + view["byteOffset"]
    image = iio.imread(data[start : start + view["byteLength"]])
    rows, columns = np.clip(np.floor(baked.atlas.uv[:, ::-1] * 128).astype(int), 0, 127).T
    upper = scene.vertices[baked.atlas.vertex][:, 1] > 0.3
    np.testing.assert_array_equal(image[rows, columns][upper, 1:], [[102, 0]] * int(upper.sum()))
    lower = scene.vertices[baked.atlas.vertex][:, 1] < -0.3
    np.testing.assert_array_equal(image[rows, columns][lower, 1:], [[255, 0]] * int(lower.sum()))


def test_a_shader_lights_the_mesh_by_the_documented_formula(tmp_path, ball):
    """Albedo times the sum of light and transfer, from the files alone, is what the vertices send out."""
    import OpenEXR

    rng = np.random.default_rng(2)
    transfer = (ball.vertices @ rng.normal(size=(3, 16))).astype(np.float32)
    light = rng.normal(size=(9, 3))
    baked = bake(ball, size=512)
    names = write_transfer(tmp_path, baked, transfer)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(names)
    assert json.loads((tmp_path / "transfer.json").read_text())["images"] == names[:3]
    images = [OpenEXR.File(str(tmp_path / name)).channels()["RGB"].pixels.astype(float) for name in names[:3]]
    texels = np.concatenate(images, axis=2)
    uv = baked.atlas.uv.astype(float)
    row, column = np.clip((uv[:, 1] * 512).astype(int), 0, 511), np.clip((uv[:, 0] * 512).astype(int), 0, 511)
    found = texels[row, column] @ light
    # A texel is 0.01 wide and its middle off by half its diagonal; half floats are good to 1e-3.
    exact = transfer[:, :9] @ light
    gradient = np.linalg.norm(np.linalg.lstsq(ball.vertices, exact, rcond=None)[0], axis=0)
    assert (np.abs(found - exact[baked.atlas.vertex]) < 0.015 * gradient).all()
    albedo = iio.imread(tmp_path / "albedo.png")
    np.testing.assert_array_equal(albedo, baked.relit())


def test_slivers_and_lost_faces_do_no_harm(ball):
    """Faces without area, twice the same face, and a sliver a millionth wide."""
    vertices = np.concatenate([ball.vertices, ball.vertices[:1] + np.float32(1e-6)])
    normals = np.concatenate([ball.normals, ball.normals[:1]])
    a, b, c = ball.faces[0]
    more = np.int32([[a, a, b], [a, b, c], [0, len(vertices) - 1, ball.faces[5, 0]]])
    faces = np.concatenate([ball.faces, more])
    scene = Scene([Mesh(vertices, normals, faces, np.full((len(vertices), 3), 120, np.uint8))])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        baked = bake(scene, size=128)
    assert (np.abs(baked.relit().astype(int) - 120) <= 1).all()
    assert np.isfinite(baked.atlas.uv).all() and np.isfinite(baked.atlas.weights).all()


def test_bad_input_is_refused(ball):
    count = len(ball.vertices)
    for size in (8, 10_000, 20.5, True):
        with pytest.raises(InputError, match="`texture_size`"):
            bake(ball, size=size)
    with pytest.raises(InputError, match=rf"irradiance must have shape \({count}, 3\)"):
        bake(ball, None, KnownColors(np.ones((count - 1, 3))), size=64)
    bad = np.ones((count, 3))
    bad[3, 1] = np.nan
    baked = bake(ball, size=64)
    with pytest.raises(InputError, match="irradiance of 1 vertices is not finite"):
        baked.relit(bad, 1.0)
    with pytest.raises(InputError, match="transfer images need"):
        write_transfer("unused", baked, np.zeros((count, 4)))
    flat = scene_of(np.zeros((3, 3), np.float32), np.tile(np.float32([0, 0, 1]), (3, 1)), np.int32([[0, 1, 2]]))
    with pytest.raises(InputError, match="needs a surface"):
        bake(flat, size=64)


def test_without_a_splat_the_texture_is_as_fine_as_half_an_edge(ball):
    edges = np.linalg.norm(ball.vertices[ball.faces] - ball.vertices[np.roll(ball.faces, 1, axis=1)], axis=2)
    fine = bake(scene_of(*sphere(60)))
    wanted = np.median(edges) * 12 / 60 / 2
    assert 0.8 * wanted < fine.atlas.texel_size < 1.25 * wanted  # at most a texture LEAST_SCALE as fine
