"""relight.lamps.usd_lights: stages that usd-core wrote, by what its schemas say."""

import resource
import time

import numpy as np
import pytest
from attacks import damaged

from relight.lamps.asked import LampScale, resolve
from relight.lamps.color import blackbody, luminance
from relight.lamps.files import read_lamps
from relight.lamps.photometry import axis_intensity, flux
from relight.lamps.shapes import MeshLamp, RectangleLamp, SphereLamp, SpotLamp, TubeLamp
from splat2mesh.base.errors import DataWarning, InputError

pytest.importorskip("pxr", reason="usd-core is not installed")

SCALE = LampScale(1.0, 1.0)


def stage_at(path):
    from pxr import Usd

    return Usd.Stage.CreateNew(str(path))


def read(stage):
    stage.GetRootLayer().Save()
    found = read_lamps(stage.GetRootLayer().realPath)
    assert all(asked.brightness.unit == "picture" for asked in found)
    return [resolve(asked, SCALE) for asked in found]


@pytest.fixture
def stage(tmp_path):
    return stage_at(tmp_path / "lamps.usda")


def test_radiance_is_intensity_exposure_color_and_temperature(stage):
    from pxr import UsdLux

    light = UsdLux.SphereLight.Define(stage, "/Bulb")
    light.CreateRadiusAttr(0.1)
    light.CreateIntensityAttr(3.0)
    light.CreateExposureAttr(2.0)
    light.CreateColorAttr((1.0, 0.5, 0.25))
    (lamp,) = read(stage)
    assert isinstance(lamp, SphereLamp) and lamp.radius == pytest.approx(0.1)
    assert lamp.radiance == pytest.approx((12.0, 6.0, 3.0))
    light.CreateColorTemperatureAttr(3000.0)
    assert read(stage)[0].radiance == pytest.approx((12.0, 6.0, 3.0))  # until it is enabled
    light.CreateEnableColorTemperatureAttr(True)
    assert read(stage)[0].radiance == pytest.approx(np.array([12.0, 6.0, 3.0]) * blackbody(3000.0))
    assert read_lamps(stage.GetRootLayer().realPath)[0].name == "Bulb"


def test_defaults_are_those_of_the_schemas(stage):
    from pxr import UsdLux

    UsdLux.SphereLight.Define(stage, "/A")
    UsdLux.RectLight.Define(stage, "/B")
    UsdLux.CylinderLight.Define(stage, "/C")
    sphere, rectangle, tube = read(stage)
    assert sphere.radius == 0.5 and sphere.radiance == pytest.approx((1.0, 1.0, 1.0))
    assert isinstance(rectangle, RectangleLamp) and not rectangle.two_sided
    assert np.cross(rectangle.edge_u, rectangle.edge_v).tolist() == [0.0, 0.0, -1.0]
    assert tube == TubeLamp((-0.5, 0.0, 0.0), (0.5, 0.0, 0.0), 0.5, tube.radiance)


@pytest.mark.parametrize("scale", [1.0, 0.25])
def test_normalized_lights_keep_their_flux_whatever_their_size(stage, scale):
    from pxr import UsdGeom, UsdLux

    # Radiance is 1 over the area, so that the flux is pi.
    room = UsdGeom.Xform.Define(stage, "/Room")
    room.AddScaleOp().Set((scale, scale, scale))
    kinds = UsdLux.SphereLight, UsdLux.RectLight, UsdLux.DiskLight, UsdLux.CylinderLight
    for number, kind in enumerate(kinds):
        light = kind.Define(stage, f"/Room/L{number}")
        light.CreateNormalizeAttr(True)
    for lamp in read(stage):
        assert flux(lamp) == pytest.approx([np.pi] * 3), type(lamp)


def test_places_turns_and_scales_of_parents(stage):
    from pxr import UsdGeom, UsdLux

    room = UsdGeom.Xform.Define(stage, "/Room")
    room.AddTranslateOp().Set((1.0, 2.0, 3.0))
    room.AddRotateXOp().Set(-90.0)  # -z goes to -y
    room.AddScaleOp().Set((2.0, 2.0, 2.0))
    panel = UsdLux.RectLight.Define(stage, "/Room/Panel")
    panel.CreateWidthAttr(0.5)
    panel.AddTranslateOp().Set((0.0, 0.0, 0.5))
    (lamp,) = read(stage)
    assert lamp.center == pytest.approx((1.0, 3.0, 3.0))
    assert np.cross(lamp.edge_u, lamp.edge_v) == pytest.approx((0.0, -2.0, 0.0), abs=1e-12)


@pytest.mark.parametrize("mirror", [(1.0, 1.0, -1.0), (-1.0, 1.0, 1.0)])
def test_mirrored_panels_and_discs_shine_where_their_frame_says(stage, mirror):
    from pxr import UsdGeom, UsdLux

    UsdGeom.Xform.Define(stage, "/Room").AddScaleOp().Set(mirror)
    UsdLux.RectLight.Define(stage, "/Room/A")
    UsdLux.DiskLight.Define(stage, "/Room/B")
    panel, disc = read(stage)
    assert np.cross(panel.edge_u, panel.edge_v)[2] == pytest.approx(-mirror[2])
    corners = disc.vertices[disc.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.sign(normals[:, 2]) == -mirror[2]).all()


def test_a_disc_has_its_area_and_its_side(stage):
    from pxr import UsdLux

    UsdLux.DiskLight.Define(stage, "/Disc").CreateRadiusAttr(0.3)
    (lamp,) = read(stage)
    assert isinstance(lamp, MeshLamp)
    assert axis_intensity(lamp) == pytest.approx([np.pi * 0.09] * 3)
    corners = lamp.vertices[lamp.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] < 0.0).all()


@pytest.mark.parametrize(("softness", "beam"), [(0.0, 25.0), (0.2, 20.0), (1.0, 0.0), (7.0, 0.0)])
def test_a_sphere_with_a_cone_is_a_spot(stage, softness, beam):
    from pxr import UsdLux

    light = UsdLux.SphereLight.Define(stage, "/Spot")
    light.CreateRadiusAttr(0.1)
    light.CreateIntensityAttr(100.0)
    shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
    shaping.CreateShapingConeAngleAttr(25.0)
    shaping.CreateShapingConeSoftnessAttr(softness)
    (lamp,) = read(stage)
    assert isinstance(lamp, SpotLamp) and lamp.cutoff_deg == 25.0 and lamp.beam_deg == pytest.approx(beam)
    assert lamp.radius == pytest.approx(0.1) and lamp.target == (0.0, 0.0, -1.0)
    assert lamp.intensity == pytest.approx([np.pi * 0.01 * 100.0] * 3)
    light.CreateTreatAsPointAttr(True)
    (point,) = read(stage)
    assert point.radius == 0.0 and point.intensity == pytest.approx(lamp.intensity)
    shaping.CreateShapingConeAngleAttr(180.0)
    assert isinstance(read(stage)[0], SphereLamp)


def test_a_normalized_point_of_no_radius_has_light(stage):
    from pxr import UsdLux

    light = UsdLux.SphereLight.Define(stage, "/Point")
    light.CreateRadiusAttr(0.0)
    light.CreateNormalizeAttr(True)
    light.CreateIntensityAttr(8.0)
    (lamp,) = read(stage)
    assert lamp.radius == 0.0 and flux(lamp) == pytest.approx([8.0 * np.pi] * 3)


def test_a_mesh_light_of_quads_is_its_triangles(stage):
    from pxr import UsdGeom, UsdLux

    mesh = UsdGeom.Mesh.Define(stage, "/Sign")
    mesh.CreatePointsAttr([(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0), (0, 2, 0)])
    mesh.CreateFaceVertexCountsAttr([4, 3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 3, 3, 2, 4])
    UsdLux.MeshLightAPI.Apply(mesh.GetPrim())
    (lamp,) = read(stage)
    assert isinstance(lamp, MeshLamp) and len(lamp.faces) == 3
    assert axis_intensity(lamp) == pytest.approx([3.0] * 3) and not lamp.two_sided
    corners = lamp.vertices[lamp.faces]
    assert (np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2] > 0.0).all()


def test_suns_and_domes_are_counted_and_alone_are_no_lamps(stage):
    from pxr import UsdLux

    UsdLux.DistantLight.Define(stage, "/Sun")
    UsdLux.DomeLight.Define(stage, "/Sky")
    with (
        pytest.warns(DataWarning, match="skipped 2 distant and dome"),
        pytest.raises(InputError, match="holds no lamps"),
    ):
        read(stage)
    UsdLux.SphereLight.Define(stage, "/Bulb")
    with pytest.warns(DataWarning, match="skipped 2 distant and dome"):
        assert len(read(stage)) == 1


def test_what_lights_lose_is_counted(stage):
    from pxr import UsdLux

    light = UsdLux.RectLight.Define(stage, "/Panel")
    light.CreateTextureFileAttr("x.png")
    shaping = UsdLux.ShapingAPI.Apply(light.GetPrim())
    shaping.CreateShapingIesFileAttr("x.ies")
    shaping.CreateShapingFocusAttr(2.0)
    shaping.CreateShapingConeAngleAttr(40.0)
    with pytest.warns(DataWarning) as caught:
        (lamp,) = read(stage)
    messages = " ".join(str(each.message) for each in caught)
    assert isinstance(lamp, RectangleLamp)
    assert all(word in messages for word in ("1 textures", "1 IES profiles", "1 focuses", "1 cones of rectangles"))


def test_lights_that_are_hidden_are_off(stage):
    from pxr import UsdGeom, UsdLux

    light = UsdLux.SphereLight.Define(stage, "/Bulb")
    UsdLux.SphereLight.Define(stage, "/Other")
    UsdGeom.Imageable(light.GetPrim()).MakeInvisible()
    assert len(read(stage)) == 1


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("inputs:intensity", float("nan")),
        ("inputs:exposure", 1e30),
        ("inputs:radius", -1.0),
        ("inputs:radius", float("inf")),
    ],
)
def test_numbers_that_make_no_lamp_are_refused_in_one_line(stage, name, value):
    from pxr import UsdLux

    light = UsdLux.SphereLight.Define(stage, "/Bulb")
    light.GetPrim().GetAttribute(name).Set(value)
    with pytest.raises(InputError) as caught:
        read(stage)
    assert "\n" not in str(caught.value)


def test_a_stage_of_very_many_prims_is_refused(stage, monkeypatch):
    from pxr import UsdLux

    for number in range(12):
        UsdLux.SphereLight.Define(stage, f"/Bulb{number}")
    assert len(read(stage)) == 12
    monkeypatch.setattr("relight.lamps.usd_lights.MOST_PRIMS", 11)
    with pytest.raises(InputError, match="over 11 prims"):
        read(stage)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz", ".usd"])
def test_truncated_and_damaged_files(tmp_path, suffix):
    from pxr import UsdLux, UsdUtils

    plain = tmp_path / ("whole.usda" if suffix == ".usda" else "whole.usdc")
    stage = stage_at(plain)
    UsdLux.SphereLight.Define(stage, "/World/Bulb").CreateIntensityAttr(5.0)
    UsdLux.RectLight.Define(stage, "/World/Panel")
    stage.GetRootLayer().Save()
    path = tmp_path / f"lamps{suffix}"
    if suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(str(plain), str(path))
    else:
        path.write_bytes(plain.read_bytes())
    assert luminance(resolve(read_lamps(path)[0], SCALE).radiance) == pytest.approx(5.0)
    whole, rng = path.read_bytes(), np.random.default_rng(7)
    contents = [whole[: int(len(whole) * share)] for share in (0.01, 0.3, 0.7, 0.99)]
    contents += [damaged(whole, rng)[0] for _ in range(20 if suffix == ".usda" else 5)]
    for number, content in enumerate(contents):
        path = tmp_path / f"damaged{number}{suffix}"
        path.write_bytes(content)
        try:
            assert len(read_lamps(path)) > 0
        except InputError as error:
            assert "\n" not in str(error)
        except DataWarning:
            pass


def test_a_count_that_would_fill_the_memory_is_refused_in_another_process(tmp_path):
    from pxr import UsdLux

    stage = stage_at(tmp_path / "whole.usdc")
    UsdLux.SphereLight.Define(stage, "/Bulb")
    stage.GetRootLayer().Save()
    whole = (tmp_path / "whole.usdc").read_bytes()
    (table,) = np.frombuffer(whole, "<i8", 1, 16)
    (count,) = np.frombuffer(whole, "<u8", 1, table)
    sections = {
        whole[at : at + 16].rstrip(b"\0"): int.from_bytes(whole[at + 16 : at + 24], "little")
        for at in range(table + 8, table + 8 + int(count) * 32, 32)
    }
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for name in (b"TOKENS", b"FIELDS", b"PATHS", b"SPECS"):
        at = sections[name]
        path = tmp_path / f"{name.decode()}.usdc"
        path.write_bytes(whole[:at] + (1 << 30).to_bytes(8, "little") + whole[at + 8 :])
        begun = time.monotonic()
        with pytest.raises(InputError) as caught:
            read_lamps(path)
        assert "\n" not in str(caught.value) and time.monotonic() - begun < 20.0
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1 << 20  # KiB: a gigabyte


def test_without_usd_core_one_line_says_how_to_install_it(stage, monkeypatch):
    stage.GetRootLayer().Save()
    monkeypatch.setitem(__import__("sys").modules, "pxr", None)
    with pytest.raises(InputError, match=r"pip install \"splat2mesh\[usd\]\""):
        read_lamps(stage.GetRootLayer().realPath)
