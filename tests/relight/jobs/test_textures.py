"""relit.glb and --bake in the texture of mesh.glb: as captured in the light of the capture, and linear in a new one."""

from dataclasses import replace
from types import SimpleNamespace

import imageio.v3 as iio
import numpy as np
import open3d as o3d
import pygltflib
import pytest
from ball_splats import GREEN, RADIUS, RED, solid_ball
from gltf_check import validator_issues

from relight.cli import main
from relight.engine.appearance import Appearance
from relight.jobs.job import Job
from relight.jobs.scene_files import LitFolder
from relight.jobs.textures import SceneTextures
from relight.output.lamps_glb import NO_LAMPS
from relight.request import RelightRequest
from splat2mesh.base.errors import DataWarning
from splat2mesh.base.progress import Stages
from splat2mesh.pipeline import add_texture
from splat2mesh.render.view import View
from splat2mesh.scene.color import linear_from_srgb
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.meshfile import read_mesh
from splat2mesh.scene.scene import Scene
from splat2mesh.surface.extract import Look
from splat2mesh.texture.kept import kept_texture, textured_part

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
    add_texture(made, [Look(solid_ball(), 0.1, views, np.full(len(views), 0.1))], 128, Stages())
    path = tmp_path_factory.mktemp("ball") / "scene"
    made.save(path)
    return path


def textures_of(scene):
    """The SceneTextures of a scene whose colours are its albedo."""
    colors = scene.colors_linear
    look = Appearance(colors, colors, np.ones_like(colors), None)
    job = Job(RelightRequest(scene, "noon", formats=(), baked=("texture",)))
    vars(job.inputs).update(splats=None)
    vars(job.known).update(appearance=look)
    source = SimpleNamespace(received=lambda shading, exposure: shading.received)
    return SceneTextures(job, SimpleNamespace(shown=lambda shaded: shaded), source)


def shaded(scene, exposure=1.0, radiance=None):
    """A light that gives every vertex of a scene as much as white would send out."""
    white = np.ones((scene.vertex_count, 3), np.float32)
    shading = SimpleNamespace(received=white, radiance=white if radiance is None else radiance)
    return SimpleNamespace(shading=shading, exposure=exposure, light=SimpleNamespace(name="noon", rotation_deg=0.0))


def test_light_of_one_shows_the_capture_and_a_quarter_shows_a_quarter(folder):
    scene = Scene.load(folder)
    textures = textures_of(scene)
    captured, quarter = textures.picture(shaded(scene)), textures.picture(shaded(scene, 0.25))
    assert captured.shape == (128, 128, 3) and len(np.unique(captured.reshape(-1, 3), axis=0)) > 10
    # Half a byte of sRGB is .0018 at a quarter of the light, and .0008 more is a quarter of the same at all of it.
    expected = 0.25 * linear_from_srgb(captured / np.float32(255))
    np.testing.assert_allclose(linear_from_srgb(quarter / np.float32(255)), expected, atol=3e-3)


def test_the_file_is_valid_and_has_the_faces_of_the_scene(folder, tmp_path):
    scene = Scene.load(folder)
    textures = textures_of(scene)
    assert not textures.shows_vertices
    textures.write_relit(tmp_path / "a.glb", shaded(scene), {"environment": "noon"}, NO_LAMPS)
    issues = validator_issues(tmp_path / "a.glb")
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]
    document = pygltflib.GLTF2().load(tmp_path / "a.glb")
    assert len(document.meshes) == len(scene.chunks) > 1
    counts = [document.accessors[mesh.primitives[0].indices].count // 3 for mesh in document.meshes]
    assert counts == [len(chunk.faces) for chunk in scene.chunks]
    assert document.scenes[0].extras == {"exposure": 1.0, "environment": "noon"}


def test_baked_files_have_the_texels_of_the_capture(folder, tmp_path):
    """No second unwrapping: texture coordinates are those of mesh.glb, and the albedo is its picture."""
    scene = Scene.load(folder)
    into = LitFolder(tmp_path, shaded(scene))
    names, facts = textures_of(scene).write(into), into.facts["texture"]
    assert facts == {"size": 128, "unseen_texels": scene.statistics["texels_unseen"]}
    before = pygltflib.GLTF2().load(folder / "mesh.glb")
    captured = picture_of(before)
    for name in names:
        found = pygltflib.GLTF2().load(tmp_path / name)
        assert validator_issues(tmp_path / name)["numErrors"] == 0
        coordinates = [[floats(file, mesh) for mesh in file.meshes] for file in (before, found)]
        assert all(np.array_equal(*pair) for pair in zip(*coordinates, strict=True)) and len(coordinates[0]) > 1
        atlas, _ = kept_texture(textured_part(scene), (folder / "mesh.glb").read_bytes())
        inside = atlas.texels[atlas.inside]
        # Half floats of albedo are good to 5e-4 of it, less than a step of 255.
        off = picture_of(found).reshape(-1, 3)[inside].astype(int) - captured.reshape(-1, 3)[inside]
        assert np.abs(off).max() <= 1


def picture_of(document):
    """The first picture in a glTF document."""
    view = document.bufferViews[document.images[0].bufferView]
    return iio.imread(document.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength])


def floats(document, mesh):
    """The texture coordinates of a mesh, as they stand in the file."""
    accessor = document.accessors[mesh.primitives[0].attributes.TEXCOORD_0]
    view = document.bufferViews[accessor.bufferView]
    return np.frombuffer(document.binary_blob(), "<f4", 2 * accessor.count, view.byteOffset)


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
    texture, whole = textures_of(changed), textures_of(scene)
    assert whole.is_whole and not texture.is_whole
    pictures = texture.picture(shaded(changed)), whole.picture(shaded(scene))
    atlas, shown = texture.baked.atlas, np.zeros(128**2, bool)
    shown[atlas.texels[atlas.inside]] = True
    for one in (0, 1, 2):
        np.testing.assert_array_equal(*(picture.reshape(-1, 3)[shown, one] for picture in pictures))
    radiance = np.ones((changed.vertex_count, 3), np.float32)
    radiance[-3:] = 0.5
    texture.write_relit(tmp_path / "a.glb", shaded(changed, radiance=radiance), {}, NO_LAMPS)
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


def test_the_file_read_as_a_mesh_has_the_colours_of_its_texture(folder):
    """The vertices of the folder are grey, the splats of the ball are not."""
    mesh = read_mesh(folder / "mesh.glb")
    for chosen, color in ((mesh.vertices[:, 1] > 0.5, RED), (mesh.vertices[:, 1] < -0.5, GREEN)):
        assert np.abs(mesh.colors_srgb[chosen] / 255.0 - color).max() < 0.05  # JPEG of quality 95


def test_a_changed_file_is_left_alone_with_a_warning(folder):
    scene = Scene.load(folder)
    scene.statistics["texture_sha256"] = "0" * 64
    with pytest.warns(DataWarning, match="not as splat2mesh wrote it"):
        assert textures_of(scene).shows_vertices


def test_without_one_there_is_none(folder):
    scene = Scene.load(folder)
    del scene.statistics["texture_sha256"]
    assert textures_of(scene).shows_vertices
