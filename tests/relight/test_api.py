"""The library in a line: names that can be seen, splats and scenes relit, meshes of other libraries, types shipped."""

import ast
import inspect
from pathlib import Path

import numpy as np
import open3d as o3d
import pytest
from ball_splats import solid_ball
from viewer_scenes import ball_on_plate

import relight
import splat2mesh
from relight import Environment, LightingOptions, Relighter, Scene, estimate_albedo, relight_scene, relight_splat
from splat2mesh.base.errors import InputError
from splat2mesh.scene.foreign import as_scene
from splat2mesh.splats.formats import read_splats, write_inria_ply, write_splats
from splat2mesh.surface.extract import EFFORTS, Effort

DRAFT = {"detail": "draft", "vertices": 800, "stand": "outside"}


@pytest.fixture(scope="module", autouse=True)
def quick():
    """A detail below draft: what is tested does not depend on accuracy."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(EFFORTS, "draft", Effort(views=12, pixels=96, cells=80))
        yield


@pytest.mark.parametrize("package", [relight, splat2mesh], ids=["relight", "splat2mesh"])
def test_public_names_are_seen_by_dir_and_by_type_checkers(package):
    stub = ast.parse(Path(package.__file__).with_suffix(".pyi").read_text())
    typed = {alias.asname for node in stub.body for alias in node.names}
    assert typed == set(package.__all__) == set(dir(package))
    for name in package.__all__:
        assert getattr(package, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        package.nothing  # noqa: B018
    assert (Path(package.__file__).parent / "py.typed").is_file()


def functions():
    """Every public function and method of the public API."""
    for package in (relight, splat2mesh):
        for name in package.__all__:
            value = getattr(package, name)
            if inspect.isfunction(value):
                yield name, value
            elif inspect.isclass(value) and not issubclass(value, Exception):
                for key, member in vars(value).items():
                    member = getattr(member, "__func__", member)
                    if inspect.isfunction(member) and not key.startswith("_"):
                        yield f"{name}.{key}", member


OTHERS = {"Environment", "Splats", "convert"}  # light, splats, and the pipeline keep their arrays' shapes in comments


@pytest.mark.parametrize(("name", "function"), [(n, f) for n, f in functions() if n.split(".")[0] not in OTHERS])
def test_public_functions_say_their_types_and_what_they_do(name, function):
    signature = inspect.signature(function)
    untyped = [
        each for each, p in signature.parameters.items() if each not in ("self", "cls") and p.annotation is p.empty
    ]
    assert untyped == [] and signature.return_annotation is not signature.empty and inspect.getdoc(function), name


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    path = tmp_path_factory.mktemp("api") / "ball.ply"
    write_inria_ply(path, solid_ball(1200))
    return path


@pytest.fixture(scope="module")
def relit(ball):
    return relight_splat(ball, "sunset", angle_deg=45, tolerance=0.1, meshing=DRAFT)


def test_a_splat_is_relit_in_one_line(ball, relit, tmp_path):
    source = read_splats(ball)
    for name in ("means", "scales", "quats_wxyz", "opacities"):
        np.testing.assert_array_equal(getattr(relit.splats, name), getattr(source, name))
    assert np.abs(relit.splats.sh[:, 0] - source.sh[:, 0]).max() > 0.1
    assert relit.report["angle_deg"] == 45.0 and relit.report["environment"]["name"] == "sunset"
    relit.save(tmp_path / "b.ply")
    np.testing.assert_array_equal(read_splats(tmp_path / "b.ply").sh, relit.splats.sh)
    relit.save(tmp_path / "b.compressed.ply")
    assert len(read_splats(tmp_path / "b.compressed.ply")) == len(source)
    with pytest.raises(InputError, match="exists already"):
        relit.save(tmp_path / "b.ply")
    with pytest.raises(InputError, match=r"expected a name that ends in \.ply"):
        relit.save(tmp_path / "b.xyz")


@pytest.mark.slow
def test_a_splat_of_another_kind_and_its_scene_folder_give_the_same(ball, relit, tmp_path):
    write_splats(tmp_path / "ball.compressed.ply", read_splats(ball), "compressed.ply")
    other = relight_splat(tmp_path / "ball.compressed.ply", "sunset", angle_deg=45, tolerance=0.1, meshing=DRAFT)
    assert len(other.splats) == 1200 and other.mesh.radiance.shape[1] == 3
    relit.mesh.scene.save(tmp_path / "scene")
    again = relight_splat(tmp_path / "scene", "sunset", angle_deg=45, tolerance=0.1)
    np.testing.assert_array_equal(again.splats.sh, relit.splats.sh)


def test_a_scene_is_relit_shown_and_saved(tmp_path):
    scene = ball_on_plate()
    found = relight_scene(scene, "noon", "analytic", bands=3, angle_deg=30.0, formats=("npy", "glb"))
    expected = Relighter(scene, "analytic", bands=3, tolerance=0.01)
    light = Environment.load("noon").rotated(30.0)
    np.testing.assert_array_equal(found.radiance, expected.shade(light, scene.colors_linear))
    report = found.save(tmp_path / "out")
    assert set(report["files"]) == {"relit.glb", "radiance.npy"} and (tmp_path / "out" / "report.json").is_file()
    np.testing.assert_array_equal(np.load(tmp_path / "out" / "radiance.npy"), found.radiance)
    assert sorted(found.save(tmp_path / "out")["files"]) == sorted(report["files"])  # the same once more
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="exists already"):
        found.save(tmp_path / "taken")
    mesh = found.to_pyvista()
    np.testing.assert_array_equal(mesh.point_data["radiance"], found.radiance)
    np.testing.assert_array_equal(mesh.regular_faces, scene.faces)
    assert mesh.point_data["rgb"].dtype == np.uint8


def test_the_albedo_of_a_scene_and_of_a_relighter_are_the_same(relit):
    scene = relit.mesh.scene
    one, other = estimate_albedo(scene), estimate_albedo(Relighter(scene))
    np.testing.assert_array_equal(one.albedo, other.albedo)
    assert one.albedo.shape == (scene.vertex_count, 3) and 0.0 < one.albedo.min() and one.albedo.max() <= 0.95


def colored(resolution=6):
    """Arrays of a small sphere: vertices, faces, and colours in bytes."""
    mesh = o3d.geometry.TriangleMesh.create_sphere(1.0, resolution)
    vertices = np.asarray(mesh.vertices, np.float32)
    return vertices, np.asarray(mesh.triangles), np.uint8(100 + 100 * vertices)


def of_trimesh():
    trimesh = pytest.importorskip("trimesh")
    vertices, faces, colors = colored()
    return trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)


def of_open3d():
    vertices, faces, colors = colored()
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(vertices), o3d.utility.Vector3iVector(faces))
    mesh.vertex_colors = o3d.utility.Vector3dVector(colors / 255.0)
    return mesh


@pytest.mark.parametrize("make", [of_trimesh, of_open3d])
def test_meshes_of_other_libraries_are_lit_in_their_own_order(make):
    vertices, faces, colors = colored()
    scene = as_scene(make())
    np.testing.assert_array_equal(scene.vertices, vertices)
    np.testing.assert_array_equal(scene.faces, faces)
    np.testing.assert_array_equal(scene.colors_srgb, colors)
    outward = np.einsum("vi,vi->v", scene.normals, vertices)
    assert (outward > 0.9).all()
    white = Environment(np.ones((8, 16, 3), np.float32))
    np.testing.assert_allclose(Relighter(make(), "analytic").shade(white), 1.0, atol=1e-5)


@pytest.mark.parametrize("wrong", [3, None, np.zeros((4, 3)), o3d.geometry.PointCloud()])
def test_what_is_no_mesh_is_refused(wrong):
    with pytest.raises(InputError, match="expected a"):
        Relighter(wrong)


def test_a_relighter_takes_a_path_and_options(tmp_path):
    ball_on_plate().save(tmp_path / "scene")
    relighter = Relighter(tmp_path / "scene", LightingOptions("analytic", bands=4), rays=8)
    assert relighter.options == LightingOptions("analytic", bands=4, rays=8)
    assert relighter.transfer.shape == (Scene.load(tmp_path / "scene").vertex_count, 16)
