"""relit.glb in the texture of its scene: as captured in the light of the capture, and linear in a new one."""

from dataclasses import replace

import numpy as np
import open3d as o3d
import pygltflib
import pytest
from ball_splats import RADIUS, solid_ball
from gltf_check import validator_issues
from relight.output.relit_texture import RelitTexture

from relight.cli import main
from relight.engine.appearance import Appearance
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.progress import Stages
from splat2mesh.pipeline import add_texture
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.texture.projection import Look

LIMIT = 150


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene folder of a ball in several chunks, with its texture."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(RADIUS, 16)
    points, faces = np.asarray(mesh.vertices).astype(np.float32), np.asarray(mesh.triangles).astype(np.int32)
    colors = np.full((len(points), 3), 120, np.uint8)
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    made = Scene.from_mesh(Mesh(points, points / np.float32(RADIUS), faces, colors), LIMIT, scene_from_splat=flip)
    ways = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
    views = [View.look_at(8.0 * np.array(way), [0, 0, 0], [0.1, 1, 0.2], 40.0, 160) for way in ways]
    add_texture(made, [Look(solid_ball(), views, np.full(len(views), 0.1))], 128, Stages())
    path = tmp_path_factory.mktemp("ball") / "scene"
    made.save(path)
    return path


def as_captured(scene):
    """The Appearance of a scene whose colours are its albedo."""
    return Appearance(scene.colors_linear, scene.colors_linear, np.ones_like(scene.colors_linear), None)


def test_light_of_one_shows_the_capture_and_a_quarter_shows_a_quarter(folder):
    scene = Scene.load(folder)
    texture = RelitTexture.of_scene(scene, as_captured(scene))
    white = np.ones((scene.vertex_count, 3), np.float32)
    captured, quarter = texture.image(white, 1.0), texture.image(white, 0.25)
    assert captured.shape == (128, 128, 3) and len(np.unique(captured.reshape(-1, 3), axis=0)) > 10
    # Half a byte of sRGB is .0018 at a quarter of the light, and .0008 more is a quarter of the same at all of it.
    expected = 0.25 * linear_from_srgb(captured / np.float32(255))
    np.testing.assert_allclose(linear_from_srgb(quarter / np.float32(255)), expected, atol=3e-3)


def test_the_file_is_valid_and_has_the_faces_of_the_scene(folder, tmp_path):
    scene = Scene.load(folder)
    texture = RelitTexture.of_scene(scene, as_captured(scene))
    texture.write(tmp_path / "a.glb", np.ones((scene.vertex_count, 3), np.float32), 1.0, {"environment": "noon"})
    issues = validator_issues(tmp_path / "a.glb")
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]
    document = pygltflib.GLTF2().load(tmp_path / "a.glb")
    assert len(document.meshes) == len(scene.chunks) > 1
    counts = [document.accessors[mesh.primitives[0].indices].count // 3 for mesh in document.meshes]
    assert counts == [len(chunk.faces) for chunk in scene.chunks]
    assert document.scenes[0].extras == {"exposure": 1.0, "environment": "noon"}


def test_a_changed_scene_keeps_the_texture_of_what_is_left(folder, tmp_path):
    scene = Scene.load(folder)
    left = [np.arange(0, len(chunk.faces), 2) for chunk in scene.chunks]
    left[1] = left[1][:0]
    chunks = []
    for chunk, rows in zip(scene.chunks, left, strict=True):
        used, corners = np.unique(chunk.faces[rows], return_inverse=True)
        parts = [getattr(chunk, name)[used] for name in ("vertices", "normals", "colors_srgb")]
        chunks += [Mesh(*parts[:2], corners.reshape(-1, 3).astype(np.int32), parts[2])] if len(rows) else []
    plate = Mesh(
        np.eye(3, dtype=np.float32),
        np.eye(3, dtype=np.float32),
        np.array([[0, 1, 2]], np.int32),
        np.full((3, 3), 9, np.uint8),
    )
    changed = replace(scene, chunks=[*chunks, plate], left=tuple(left))
    texture, whole = (RelitTexture.of_scene(each, as_captured(each)) for each in (changed, scene))
    white = np.ones((changed.vertex_count, 3), np.float32)
    pictures = texture.image(white, 1.0), whole.image(np.ones((scene.vertex_count, 3), np.float32), 1.0)
    shown = np.zeros(texture.size**2, bool)
    shown[texture._atlas.texels[texture._atlas.inside]] = True
    for one in (0, 1, 2):
        np.testing.assert_array_equal(*(picture.reshape(-1, 3)[shown, one] for picture in pictures))
    radiance = white.copy()
    radiance[-3:] = 0.5
    texture.write(tmp_path / "a.glb", white, 1.0, {}, radiance=radiance)
    issues = validator_issues(tmp_path / "a.glb")
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]
    document = pygltflib.GLTF2().load(tmp_path / "a.glb")
    counts = [document.accessors[mesh.primitives[0].indices].count // 3 for mesh in document.meshes]
    assert counts == [len(rows) for rows in left if len(rows)] + [1]
    assert document.meshes[-1].primitives[0].attributes.COLOR_0 is not None


def test_the_command_lights_the_texture(folder, tmp_path):
    words = [str(folder), "--env", "noon", "--method", "analytic", "--albedo", "captured", "--format", "glb", "-q"]
    assert main([*words, "-o", str(tmp_path / "out")]) == 0
    document = pygltflib.GLTF2().load(tmp_path / "out" / "relit.glb")
    assert document.meshes[0].primitives[0].attributes.TEXCOORD_0 is not None
    assert {"exposure", "clipped_vertices", "environment"} <= set(document.scenes[0].extras)


def test_a_changed_file_is_left_alone_with_a_warning(folder):
    scene = Scene.load(folder)
    scene.statistics["texture_sha256"] = "0" * 64
    with pytest.warns(DataWarning, match="not as splat2mesh wrote it"):
        assert RelitTexture.of_scene(scene, as_captured(scene)) is None


def test_without_one_there_is_none(folder):
    scene = Scene.load(folder)
    del scene.statistics["texture_sha256"]
    assert RelitTexture.of_scene(scene, as_captured(scene)) is None
