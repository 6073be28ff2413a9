"""relight.output.usd: read back by usd-core."""

import numpy as np
import pytest
from lit_ball import TILT, ball_scene, splats_of_ball

from relight import Environment
from relight.output.lamps_glb import ShownLight
from relight.output.usd import FILE, LIGHT, write_usd
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.placing import placed
from splat2mesh.splats.splats import REACH

pxr = pytest.importorskip("pxr", reason="usd-core is not installed")


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("usd")
    scene, albedo = ball_scene(10)
    splats, _ = splats_of_ball(50)
    bare = splats.take(slice(None))
    object.__setattr__(bare, "sh", splats.sh[:, :1] * np.float32(0.5))
    light = Environment.load("sunset").rotated(30.0)
    names = write_usd(folder, {"relit": splats, "albedo": bare}, scene, albedo, ShownLight(light, 0.7))
    assert names == [FILE, LIGHT] and {path.name for path in folder.iterdir()} == {FILE, LIGHT}
    return folder, scene, albedo, splats, bare, light


def opened(folder):
    from pxr import Usd

    return Usd.Stage.Open(str(folder / FILE))


def test_the_splats_are_a_particle_field_in_the_scene_frame(written):
    from pxr import UsdGeom, UsdVol

    folder, _, _, splats, bare, _ = written
    stage = opened(folder)
    assert UsdGeom.GetStageUpAxis(stage) == "Y" and stage.GetDefaultPrim().GetPath() == "/World"
    field = UsdVol.ParticleField3DGaussianSplat(stage.GetPrimAtPath("/World/Splat"))
    assert field and field.GetPrim().GetTypeName() == "ParticleField3DGaussianSplat"
    looks = field.GetPrim().GetVariantSets().GetVariantSet("look")
    assert looks.GetVariantNames() == ["albedo", "relit"] and looks.GetVariantSelection() == "relit"
    for name, each in (("relit", splats), ("albedo", bare)):
        looks.SetVariantSelection(name)
        there = placed(each, TILT)
        np.testing.assert_array_equal(np.array(field.GetPositionsAttr().Get()), there.means)
        np.testing.assert_array_equal(np.array(field.GetScalesAttr().Get()), there.scales)
        np.testing.assert_array_equal(np.array(field.GetOpacitiesAttr().Get()), there.opacities)
        quats = [(q.GetReal(), *q.GetImaginary()) for q in field.GetOrientationsAttr().Get()]
        np.testing.assert_array_equal(np.float32(quats), there.quats_wxyz)
        assert field.GetRadianceSphericalHarmonicsDegreeAttr().Get() == there.degree
        coefficients = np.array(field.GetRadianceSphericalHarmonicsCoefficientsAttr().Get())
        np.testing.assert_array_equal(coefficients.reshape(there.sh.shape), there.sh)
    low, high = np.array(field.GetExtentAttr().Get())
    reach = REACH * splats.scales.max()
    assert (low >= placed(splats, TILT).means.min(axis=0) - 1.001 * reach).all()
    assert (low <= placed(splats, TILT).means.min(axis=0)).all() and (
        high >= placed(splats, TILT).means.max(axis=0)
    ).all()


def test_the_proxy_is_the_mesh_and_the_dome_is_the_light(written):
    from pxr import Usd, UsdGeom, UsdLux

    folder, scene, albedo, _, _, light = written
    stage = opened(folder)
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/Proxy"))
    np.testing.assert_array_equal(np.array(mesh.GetPointsAttr().Get()), scene.vertices)
    np.testing.assert_array_equal(np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3), scene.faces)
    np.testing.assert_array_equal(np.array(mesh.GetDisplayColorPrimvar().Get()), albedo)
    assert mesh.GetPurposeAttr().Get() == "proxy" and UsdGeom.Mesh.ValidateTopology(
        mesh.GetFaceVertexIndicesAttr().Get(), mesh.GetFaceVertexCountsAttr().Get(), scene.vertex_count
    )
    dome = UsdLux.DomeLight(stage.GetPrimAtPath("/World/Light"))
    assert dome.GetIntensityAttr().Get() == np.float32(0.7)
    texture = dome.GetTextureFileAttr().Get()
    assert texture.path == f"./{LIGHT}" and texture.resolvedPath
    np.testing.assert_allclose(Environment.load(folder / LIGHT).radiance, light.radiance, rtol=1e-3, atol=1e-5)
    # What the unturned picture has at +z shines from where the light has it.
    matrix = np.array(UsdGeom.Xformable(dome).ComputeLocalToWorldTransform(Usd.TimeCode.Default()))[:3, :3]
    np.testing.assert_allclose(
        light.lookup(np.array([[0.0, 0.0, 1.0]]) @ matrix),
        Environment(light.radiance).lookup(np.array([[0.0, 0, 1]])),
        rtol=1e-5,
    )


def test_gloss_is_a_preview_surface_of_the_proxy(written, tmp_path):
    from pxr import UsdGeom, UsdShade

    folder, scene, albedo, splats, _, light = written
    roughness = np.linspace(0.1, 1, len(albedo)).astype(np.float32)
    write_usd(tmp_path, {"relit": splats}, scene, albedo, ShownLight(light, 0.7), roughness)
    stage = opened(tmp_path)
    mesh = stage.GetPrimAtPath("/World/Proxy")
    material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
    surface = material.ComputeSurfaceSource()[0]
    assert surface.GetIdAttr().Get() == "UsdPreviewSurface"
    read = {}
    for name in ("diffuseColor", "roughness"):
        reader = UsdShade.Shader(surface.GetInput(name).GetConnectedSources()[0][0].source)
        primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(reader.GetInput("varname").Get())
        assert primvar.GetInterpolation() == "vertex"
        read[name] = np.array(primvar.Get())
    np.testing.assert_array_equal(read["roughness"], roughness)
    np.testing.assert_array_equal(read["diffuseColor"], albedo)
    bare = opened(folder)
    assert not bare.GetPrimAtPath("/World/Gloss") and not bare.GetPrimAtPath("/World/Proxy").HasAPI(
        "MaterialBindingAPI"
    )


def test_the_same_input_gives_the_same_bytes(written, tmp_path):
    folder, scene, albedo, splats, bare, light = written
    write_usd(tmp_path, {"relit": splats, "albedo": bare}, scene, albedo, ShownLight(light, 0.7))
    for name in (FILE, LIGHT):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_the_package_reads_the_look_that_its_own_file_shows(written):
    folder, scene, _, splats, _, _ = written
    found = read_splats(folder / FILE)
    expected = placed(placed(splats, scene.scene_from_splat), np.diag([1.0, -1, -1, 1]))
    for name in ("means", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=2e-6)
    np.testing.assert_allclose(found.covariances(), expected.covariances(), atol=2e-6)
    assert found.facts.metres == 1.0
