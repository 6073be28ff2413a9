import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from live_scene import SETTINGS, TILT, live_scene, scene_and_splats

from relight import Environment
from relight.live.bundle import write_bundle
from relight.live.lights import light_of
from relight.live.live import LiveScene, live_of
from relight.live.surface import LIT
from relight.splats import Binding
from relight.splats.light_ratio import CURVE_POWER
from splat2mesh.splats.formats import read_splats
from splat2mesh.splats.splats import SH_C0

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def reader():
    """The reference reader of docs/live.md."""
    return runpy.run_path(str(ROOT / "examples/read_bundle.py"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("live")
    write_bundle(path, live_scene()[3])
    return path


def test_the_reader_finds_the_change_of_light_that_a_relit_splat_has(reader, folder):
    relighter, look, splats, live = live_scene()
    bundle = reader["read"](folder)
    binding = Binding(splats, relighter.scene, views=())
    for light, angle in ((0, 0.0), (0, 250.0)):  # the overcast sky, which has no sun
        turned = Environment.load(bundle[0]["lights"][light]["name"]).rotated(angle)
        after = look.received(relighter.shading(turned, look.albedo, SETTINGS).radiance)
        relit = binding.relit(look.irradiance, after, 0.7)
        color = 0.5 + SH_C0 * splats.sh[:, 0]
        expected = (((0.5 + SH_C0 * relit.sh[:, 0] + 0.055) / (color + 0.055)) ** CURVE_POWER)[live.order]
        found = reader["change"](bundle, bundle[0]["lights"][light], np.radians(angle))
        off = np.abs(found - expected) / expected.mean()
        assert np.sqrt(np.mean(off**2)) < 0.04  # what the bytes may add; bounces of 10 bands and colours are below
        assert np.quantile(off, 0.99) < 0.1


def test_turning_coefficients_is_turning_the_light(reader):
    light = live_scene()[3].lights[1]

    turned = light_of(Environment.load("noon").rotated(70.0), 0.7)
    np.testing.assert_allclose(reader["turned"](light.rest, np.radians(70.0)), turned.rest, atol=1e-9)


def test_row_i_is_splat_i(reader, folder):
    _, _, splats, live = live_scene()
    assert sorted(live.order) == list(range(len(splats)))
    np.testing.assert_array_equal(read_splats(folder / "splat.ply").means, splats.means[live.order])
    packed = read_splats(folder / "splat.compressed.ply")
    np.testing.assert_allclose(packed.means, splats.means[live.order], atol=2e-3)
    assert (reader["read"](folder)[4][:, 7] == LIT).all()


def test_the_light_of_the_capture_changes_nothing(reader, folder):
    bundle = reader["read"](folder)
    light = bundle[0]["lights"][-1]
    assert light["name"] == "capture"
    # It was the same from everywhere, which no light is on a plate with a ball above: the nearest there is.
    assert np.sqrt(np.mean((reader["change"](bundle, light) - 1.0) ** 2)) < 0.25


def test_surfaces_lie_where_splats_do_and_face_as_they_do():
    from unpacked import from_octahedral

    _, _, splats, live = live_scene()
    rows = live.surfaces.packed
    normals = from_octahedral(rows[:, :2].view(np.int8))
    moved = splats.means[live.order] @ TILT[:3, :3].T + TILT[:3, 3]
    places = moved + normals * rows[:, 3:4].view(np.int8) * live.surfaces.lift
    on_plate = np.abs(moved[:, 1]) < 1e-3
    on_ball = np.abs(np.linalg.norm(places - [0, 0.8, 0], axis=1) - 0.5) < 0.02
    inner = on_plate & (np.abs(moved[:, [0, 2]]) < 1.3).all(axis=1)
    assert inner.sum() > 300 and on_ball.sum() > 200
    assert normals[inner, 1].min() > 0.999
    away = (places[on_ball] - [0, 0.8, 0]) / 0.5
    assert np.median((away * normals[on_ball]).sum(axis=1)) > 0.99  # faces are chords


def test_the_same_scene_gives_the_same_bytes(tmp_path, folder):
    from relight.engine.appearance import appearance_of
    from relight.engine.relighter import Relighter

    relighter = Relighter(scene_and_splats()[0])
    look = appearance_of("captured", None, relighter)
    lights = [light_of(Environment.load(name), 0.7) for name in ("overcast", "noon")]
    write_bundle(tmp_path, live_of(LiveScene(relighter, look, scene_and_splats()[1]), lights, SETTINGS))
    for path in sorted(folder.rglob("*.*")):
        assert (tmp_path / path.relative_to(folder)).read_bytes() == path.read_bytes(), path.name


def test_errors_fall_with_bytes_and_the_first_choice_within_the_tolerance_is_taken(folder):
    tried = json.loads((folder / "live.json").read_text())["transfer"]["errors"]
    assert all(each["error"] > 0.03 for each in tried[:-1]) and tried[-1]["error"] <= 0.03


@pytest.mark.parametrize("change", ["another splat", "fewer rows", "a newer version"])
def test_what_does_not_belong_together_is_refused(reader, folder, tmp_path, change):
    meta = json.loads((folder / "live.json").read_text())
    for name in ("splat.ply", "transfer.bin", "surface.bin", "basis.bin"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    if change == "another splat":
        (tmp_path / "splat.ply").write_bytes((folder / "splat.ply").read_bytes()[:-4] + b"\0\0\0\1")
    if change == "fewer rows":
        meta["count"] -= 1
    if change == "a newer version":
        meta["version"] = 3
    (tmp_path / "live.json").write_text(json.dumps(meta))
    with pytest.raises(ValueError, match=r"is not the splat|not a bundle of version 1"):
        reader["read"](tmp_path)
