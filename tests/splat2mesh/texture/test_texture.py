"""splat2mesh.texture: a ball in two colours gets them, whatever its chunks, and the file is valid."""

import io

import imageio.v3 as iio
import numpy as np
import open3d as o3d
import pygltflib
import pytest
from ball_splats import GREEN, RADIUS, RED, solid_ball
from gltf_check import validator_issues

from splat2mesh import convert
from splat2mesh.base.errors import InputError
from splat2mesh.options import ConvertOptions
from splat2mesh.render.footprints import TILE
from splat2mesh.render.view import View
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import write_inria_ply
from splat2mesh.surface.extract import EFFORTS, Effort, Look
from splat2mesh.texture.density import local_pixel
from splat2mesh.texture.glb import mesh_glb
from splat2mesh.texture.projection import deepest_of
from splat2mesh.texture.texture import texture_of
from splat2mesh.views.picture import mesh_depth

GREY = 90
"""Of the vertices, which no splat has."""


def ball_scene(limit=10**6):
    mesh = o3d.geometry.TriangleMesh.create_sphere(RADIUS, 24)
    points = np.asarray(mesh.vertices).astype(np.float32)
    faces = np.asarray(mesh.triangles).astype(np.int32)
    colors = np.full((len(points), 3), GREY, np.uint8)
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    return Scene.from_mesh(Mesh(points, points / np.float32(RADIUS), faces, colors), limit, scene_from_splat=flip)


def ball_look(ways=((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))):
    views = [View.look_at(8.0 * np.array(way), [0, 0, 0], [0.1, 1, 0.2], 40.0, 200) for way in ways]
    return Look(solid_ball(), 0.1, views, np.full(len(views), 0.1))


@pytest.fixture(scope="module")
def textured():
    return texture_of(ball_scene(), [ball_look()], 256)


def heights(texture):
    """How far up each texel lies, in the scene frame."""
    return texture.atlas.interpolate(texture.scene.vertices)[:, 1]


def test_each_texel_has_the_colour_of_the_splats_there(textured):
    up = heights(textured)
    assert textured.unseen == 0
    for part, color in ((up > 0.4, RED), (up < -0.4, GREEN)):  # between them splats of both overlap
        off = np.abs(textured.colors[part] / 255 - color).max(axis=1)
        assert off.max() < 0.02  # rounding to bytes twice, and the balls within that show through by 3%


def test_pictures_reach_as_deep_as_the_surface_that_they_show():
    scene, view = ball_scene(), View.look_at([0, 0, -8.0], [0, 0, 0], [0, 1, 0], 40.0, 200)
    deepest = deepest_of(view, mesh_depth(scene.vertices, scene.faces), (0.0, 0.1)).reshape(13, 13)
    pixels, depth = view.project(scene.vertices)
    column, row = (pixels // TILE).astype(int).T
    back = view.center - scene.vertices
    facing = (back * scene.normals).sum(axis=1) > 0.3 * np.linalg.norm(back, axis=1)  # a ray's spacing from the rim
    assert (depth <= deepest[row, column])[facing].all()
    assert deepest.max() < 8.0 + 0.1 and deepest[6, 6] < 8.0 - 0.8 * RADIUS and deepest[0, 0] == 0.0


def test_the_division_into_chunks_changes_no_texel(textured):
    again = texture_of(ball_scene(limit=200), [ball_look()], 256)
    assert len(again.scene.chunks) > 3
    np.testing.assert_array_equal(again.atlas.texels, textured.atlas.texels)
    np.testing.assert_array_equal(again.colors, textured.colors)


def test_what_no_view_shows_keeps_the_colour_of_its_vertices():
    above = texture_of(ball_scene(), [ball_look([(0, -1, 0)])], 256)  # y points down there
    up = heights(above)
    assert (above.colors[up < -0.3] == GREY).all() and above.unseen >= (up < -0.3).sum()
    assert np.abs(above.colors[up > 1.0] / 255 - RED).max() < 0.02


def test_the_pixel_of_a_place_is_that_of_the_splats_there():
    splats = solid_ball()
    splats.scales[splats.means[:, 0] > 0] *= 0.25
    points, faces = (np.asarray(each) for each in (ball_scene().vertices, ball_scene().faces))
    pixel = local_pixel(splats, points * np.float32([1, -1, -1]), faces)
    across = points[faces].mean(axis=1)[:, 0]
    ratio = np.median(pixel[across < -0.5]) / np.median(pixel[across > 0.5])
    np.testing.assert_allclose(ratio, 4.0, rtol=1e-6)


def test_the_file_is_valid_and_says_the_same(textured, tmp_path):
    content = mesh_glb(textured, 1, {"scene_from_splat": [1.0]})
    assert content == mesh_glb(texture_of(ball_scene(), [ball_look()], 256), 1, {"scene_from_splat": [1.0]})
    (tmp_path / "mesh.glb").write_bytes(content)
    issues = validator_issues(tmp_path / "mesh.glb")
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]
    document = pygltflib.GLTF2().load(tmp_path / "mesh.glb")
    view = document.bufferViews[document.images[0].bufferView]
    blob = document.binary_blob()
    picture = iio.imread(io.BytesIO(blob[view.byteOffset : view.byteOffset + view.byteLength]), extension=".jpg")
    shown = picture.reshape(-1, 3)[textured.atlas.texels].astype(int)
    assert np.sqrt(((shown - textured.colors) ** 2).mean()) < 4  # JPEG of quality 95, a sharp equator in it
    assert document.meshes[0].name == "chunk_0000" and document.scenes[0].extras == {"scene_from_splat": [1.0]}


@pytest.fixture(scope="module")
def converted(tmp_path_factory):
    """A folder with and one without a texture."""
    folder = tmp_path_factory.mktemp("ball")
    write_inria_ply(folder / "ball.ply", solid_ball())
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        for texture in ("auto", "none"):
            options = ConvertOptions(detail="draft", vertices=500, background="keep", texture=texture)
            convert(folder / "ball.ply", options).save(folder / texture)
    return folder


def test_a_scene_folder_holds_it_where_asked_and_is_the_same_otherwise(converted):
    names = [{path.name for path in (converted / name).iterdir()} for name in ("auto", "none")]
    assert names[0] - names[1] == {"mesh.glb"}
    for chunk in (converted / "none" / "chunks").iterdir():
        assert chunk.read_bytes() == (converted / "auto" / "chunks" / chunk.name).read_bytes()
    with_one, without = (Scene.load(converted / name) for name in ("auto", "none"))
    assert with_one.settings.pop("texture") == "auto" and with_one.settings == without.settings
    assert with_one.statistics["texture_size"] == 256 and "texture_size" not in without.statistics


@pytest.mark.parametrize("texture", ["big", 8, 10_000, -1, 2.5, True])
def test_a_bad_texture_is_refused(texture):
    with pytest.raises(InputError, match=r"`texture`.*expected auto, none or a number of texels from 16 to 8192"):
        ConvertOptions(texture=texture)
