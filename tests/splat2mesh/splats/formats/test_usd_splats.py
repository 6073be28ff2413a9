"""Splats in USD: what usd-core writes by its schema, in both precisions, up axes, and placed; damage."""

import numpy as np
import pytest
from splat_samples import make_splats, store

from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.splats.formats import kind_of, read_splats
from splat2mesh.splats.placing import placed, similarity

pxr = pytest.importorskip("pxr")
from pxr import Gf, Usd, UsdGeom, UsdVol, Vt  # noqa: E402

if not hasattr(UsdVol, "ParticleField3DGaussianSplat"):
    pytest.skip("usd-core knows splats from 26.03 on", allow_module_level=True)

TURNS = {"Y": np.diag([1.0, -1.0, -1.0]), "Z": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])}


def define(stage, path, splats, half=False):
    field = UsdVol.ParticleField3DGaussianSplat.Define(stage, path)
    xyzw = np.ascontiguousarray(splats.quats_wxyz[:, [1, 2, 3, 0]])
    sh = np.ascontiguousarray(splats.sh.reshape(-1, 3))
    if half:
        field.CreatePositionshAttr(Vt.Vec3hArray.FromNumpy(splats.means.astype(np.float16)))
        field.CreateOrientationshAttr(Vt.QuathArray.FromNumpy(xyzw.astype(np.float16)))
        field.CreateScaleshAttr(Vt.Vec3hArray.FromNumpy(splats.scales.astype(np.float16)))
        field.CreateOpacitieshAttr(Vt.HalfArray.FromNumpy(splats.opacities.astype(np.float16)))
        field.CreateRadianceSphericalHarmonicsCoefficientshAttr(Vt.Vec3hArray.FromNumpy(sh.astype(np.float16)))
    else:
        field.CreatePositionsAttr(Vt.Vec3fArray.FromNumpy(splats.means))
        field.CreateOrientationsAttr(Vt.QuatfArray.FromNumpy(xyzw))
        field.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(splats.scales))
        field.CreateOpacitiesAttr(Vt.FloatArray.FromNumpy(splats.opacities))
        field.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray.FromNumpy(sh))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(splats.degree)
    return field


def stage_at(path, axis="Y"):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, axis)
    return stage


def assert_close(found, expected, atol=1e-6):
    for name in ("means", "scales", "opacities", "sh"):
        np.testing.assert_allclose(getattr(found, name), getattr(expected, name), atol=atol, err_msg=name)
    np.testing.assert_allclose(found.covariances(), expected.covariances(), atol=atol)


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usd"])
@pytest.mark.parametrize("axis", ["Y", "Z"])
def test_a_stage_of_either_up_axis(tmp_path, suffix, axis):
    splats = make_splats(40, 3)
    path = tmp_path / f"a.{suffix}"
    stage = stage_at(path, axis)
    define(stage, "/World/Splat", splats)
    stage.GetRootLayer().Save()
    assert kind_of(path) == "usd"
    found = read_splats(path)
    assert_close(found, placed(splats, similarity(rotation=TURNS[axis])), atol=3e-6)
    assert found.facts.up == (0, -1, 0) and axis in found.facts.up_from


def test_half_precision(tmp_path):
    splats = make_splats(40, 1)
    stage = stage_at(tmp_path / "a.usdc")
    define(stage, "/a", splats, half=True)
    stage.GetRootLayer().Save()
    # Half floats have 11 bits: numbers up to 4 are off by 1e-3.
    assert_close(read_splats(tmp_path / "a.usdc"), placed(splats, similarity(rotation=TURNS["Y"])), atol=4e-3)


def test_prims_are_placed_and_hidden_ones_left_out(tmp_path):
    splats = make_splats(20, 1)
    stage = stage_at(tmp_path / "a.usda")
    UsdGeom.Xform.Define(stage, "/World").AddTranslateOp().Set(Gf.Vec3d(5, 0, 0))
    define(stage, "/World/a", splats)
    define(stage, "/World/b", splats).AddScaleOp().Set(Gf.Vec3f(2, 2, 2))
    UsdGeom.Imageable(define(stage, "/World/hidden", splats)).MakeInvisible()
    stage.GetRootLayer().Save()
    found = read_splats(tmp_path / "a.usda")
    assert len(found) == 40
    turn = similarity(rotation=TURNS["Y"])
    assert_close(found.take(slice(20)), placed(splats, turn @ similarity(translation=(5, 0, 0))), atol=3e-6)
    assert_close(found.take(slice(20, 40)), placed(splats, turn @ similarity(2.0, None, (5, 0, 0))), atol=5e-6)


def test_degrees_above_the_third_are_dropped_with_a_count(tmp_path):
    splats = make_splats(20, 3)
    stage = stage_at(tmp_path / "a.usda")
    field = define(stage, "/a", splats)
    sh = np.zeros((20, 25, 3), np.float32)
    sh[:, :16] = splats.sh
    field.CreateRadianceSphericalHarmonicsCoefficientsAttr(Vt.Vec3fArray.FromNumpy(sh.reshape(-1, 3)))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(4)
    stage.GetRootLayer().Save()
    with pytest.warns(DataWarning, match="dropped the harmonics above degree 3 of 20 splats"):
        assert_close(read_splats(tmp_path / "a.usda"), placed(splats, similarity(rotation=TURNS["Y"])), atol=3e-6)


def test_what_cannot_be_used_gets_one_line(tmp_path):
    stage = stage_at(tmp_path / "mesh.usda")
    UsdGeom.Mesh.Define(stage, "/mesh")
    stage.GetRootLayer().Save()
    stage = stage_at(tmp_path / "short.usda")
    field = define(stage, "/a", make_splats(20, 1))
    field.CreateScalesAttr(Vt.Vec3fArray.FromNumpy(np.ones((3, 3), np.float32)))
    stage.GetRootLayer().Save()
    stage = stage_at(tmp_path / "colourless.usda")
    field = define(stage, "/a", make_splats(20, 1))
    field.CreateRadianceSphericalHarmonicsDegreeAttr(3)
    stage.GetRootLayer().Save()
    store(tmp_path, "broken.usda", b"#usda 1.0\ndef nonsense {{{")
    store(tmp_path, "broken.usdc", b"PXR-USDC" + bytes(200))
    for name, message in (
        ("mesh.usda", "holds no Gaussian splats: expected a visible prim"),
        ("short.usda", "has 3 scales for 20 splats"),
        ("colourless.usda", "has 80 coefficients for 20 splats of 16"),
        ("broken.usda", "damaged, or not a USD file"),
        ("broken.usdc", "damaged"),
    ):
        with pytest.raises(InputError, match=message) as caught:
            read_splats(tmp_path / name)
        assert "\n" not in str(caught.value)


def test_without_usd_core_one_line_names_the_command(tmp_path, monkeypatch):
    store(tmp_path, "a.usda", b"#usda 1.0\n")
    monkeypatch.setattr("splat2mesh.base.extras.importlib.import_module", _missing)
    with pytest.raises(
        InputError, match=r'USD needs usd-core, which is not installed: pip install "splat2mesh\[usd\]"'
    ):
        read_splats(tmp_path / "a.usda")


def _missing(name):
    raise ModuleNotFoundError(name=name)
