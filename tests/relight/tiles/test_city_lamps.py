"""Lamps and captured light in a city: as in the untiled one, without a seam, and only where they reach."""

import json
import pickle

import numpy as np
import pytest
from cities import relit_city

from relight import Environment, LightingOptions, Relighter
from relight.engine.appearance import Appearance
from relight.engine.placed import LampLight
from relight.lamps.asked import LampScale, resolve
from relight.lamps.shapes import MeshLamp, SphereLamp, SpotLamp, TubeLamp
from relight.lamps.spec import asked_lamps
from relight.tiles.local import tile_mesh
from relight.tiles.shared import city_of, shared_at
from splat2mesh.base.errors import InputError
from splat2mesh.scene.scene import Scene
from splat2mesh.splats.formats import read_splats
from splat2mesh.tiles.store import Store

OPTIONS = {"bands": 3, "rays": 64, "effects": "shadows"}


def tiles(city):
    return [entry for entry in city_of(Store(city))["tiles"] if entry["faces"]]


def whole_city(city):
    store = Store(city)
    matrix = np.array(city_of(store)["scene_from_splat"])
    return Scene([tile_mesh(store, entry["tile"]) for entry in tiles(city)], scene_from_splat=matrix)


def radiance(city, folder):
    return np.concatenate([np.load(city / folder / entry["name"] / "radiance.npy") for entry in tiles(city)])


def border_lamp(city, scene, power):
    """A bulb over the middle of the city, where four tiles meet, in the frame of the scene."""
    cores = np.array([entry["core"] for entry in tiles(city)])
    x, z = cores.reshape(-1, 2).min(axis=0) / 2 + cores.reshape(-1, 2).max(axis=0) / 2
    y = float(scene.vertices[:, 1].max()) + 1.0
    return SphereLamp((float(x), y, float(z)), 0.3, (power, power, power))


def in_splat(lamp, scene):
    back = np.linalg.inv(scene.scene_from_splat)
    x, y, z = back[:3, :3] @ lamp.position + back[:3, 3]
    scale = float(np.cbrt(np.linalg.det(back[:3, :3])))
    return SphereLamp((float(x), float(y), float(z)), lamp.radius * scale, lamp.radiance)


@pytest.mark.slow
def test_a_lamp_at_a_border_lights_all_tiles_as_the_whole_city(city):
    scene = whole_city(city)
    lamp = border_lamp(city, scene, 2000.0)
    options = LightingOptions(**OPTIONS, placed=(in_splat(lamp, scene),), env_scale=0.5)
    report = relit_city(city, "noon", options, formats=("npy",), albedo="white", folder="relit/lamp")
    shared = shared_at(str(city), "relit/lamp", report["light"]["sha256"])
    relighter = Relighter(scene, LightingOptions(**OPTIONS))
    sky = relighter.shade(Environment.load("noon"))
    captured = scene.colors_linear
    direct = LampLight(relighter, Appearance(None, captured, captured), [lamp], 0.03, 0.0).placed.direct
    expected = 0.5 * sky + direct / shared.light.beside[0]
    found = radiance(city, "relit/lamp")
    assert np.linalg.norm(direct) / shared.light.beside[0] > 0.3 * np.linalg.norm(sky)  # or nothing is tested
    assert np.linalg.norm(found - expected) < 0.03 * np.linalg.norm(expected)
    dark = relit_city(city, "noon", LightingOptions(**OPTIONS), formats=("npy",), albedo="white", folder="relit/dark")
    assert "lamps" not in dark["light"]
    # The lamp alone has no seam: what it adds differs from the whole city's nowhere by much.
    added = found - 0.5 * radiance(city, "relit/dark")
    rough = np.abs(added - direct / shared.light.beside[0]).max(axis=1) > 0.1 * direct.max() / shared.light.beside[0]
    assert rough.mean() < 0.005


def test_captured_light_is_dimmed_everywhere_alike(city):
    options = LightingOptions(**OPTIONS, captured=0.25, env_scale=0.0)
    report = relit_city(city, "noon", options, formats=("npy",), albedo="captured", folder="relit/dimmed")
    shared = shared_at(str(city), "relit/dimmed", report["light"]["sha256"])
    expected = np.float32(0.25) * whole_city(city).colors_linear / np.float32(shared.light.beside[0])
    np.testing.assert_allclose(radiance(city, "relit/dimmed"), expected, rtol=1e-6)


@pytest.mark.slow
def test_all_of_the_captured_light_gives_the_captured_splats(city):
    options = LightingOptions(**OPTIONS, captured=1.0, env_scale=0.0)
    relit_city(city, "noon", options, formats=("splat",), folder="relit/same")
    found = [read_splats(path) for path in sorted((city / "relit/same/tiles").glob("*/splats.ply"))]
    plain = relit_city(city, "noon", LightingOptions(**OPTIONS), formats=("splat",), folder="relit/plain")
    assert plain["tiles"] == len(tiles(city))
    store = Store(city)
    for tile, splats in zip(tiles(city), found, strict=True):
        number = tile["tile"]
        pieces = [
            store.read_arrays(f"splats/{piece:05d}_{number:05d}.npz")["sh"]
            for piece in range(64)
            if store.exists(f"splats/{piece:05d}_{number:05d}.npz")
        ]
        np.testing.assert_allclose(splats.sh, np.concatenate(pieces), atol=2e-5)


def test_the_light_of_the_capture_stays_to_the_bit_and_lamps_come_beside_it(city):
    scene = whole_city(city)
    captured, lamp = scene.colors_linear, border_lamp(city, scene, 200.0)
    plain = LightingOptions(**OPTIONS)
    relit_city(city, "captured", plain, formats=("npy", "splat"), albedo="captured", folder="relit/kept")
    np.testing.assert_array_equal(radiance(city, "relit/kept"), captured)
    for path in sorted((city / "relit/kept/far").glob("*.ply")):  # far splats and sky stay, to the bit
        kept = Store(city).read_arrays(f"splats/far_{path.stem}.npz")
        np.testing.assert_array_equal(read_splats(path).sh, kept["sh"])
    beside = LightingOptions(**OPTIONS, placed=(in_splat(lamp, scene),), captured=0.5)
    relit_city(city, "captured", beside, formats=("npy",), albedo="white", folder="relit/beside")
    relighter = Relighter(scene, plain)
    direct = LampLight(relighter, Appearance(None, captured, captured), [lamp], 0.03, 0.0).placed.direct
    expected = 0.5 * captured + direct  # in units of the picture
    assert np.linalg.norm(direct) > 0.1 * np.linalg.norm(captured)  # or nothing is tested
    assert np.linalg.norm(radiance(city, "relit/beside") - expected) < 0.03 * np.linalg.norm(expected)


def test_a_tile_out_of_reach_knows_no_lamp(city):
    scene = whole_city(city)
    core = np.array(tiles(city)[0]["core"]).reshape(2, 2)
    (x, z), width = core[0] + 0.2 * (core[1] - core[0]), float((core[1] - core[0]).min())
    under = np.argmin(np.linalg.norm(scene.vertices[:, [0, 2]] - [x, z], axis=1))
    above = (float(x), float(scene.vertices[under, 1]) + 0.1 * width, float(z))
    median = 0.2  # of the captured light, about; the lamp falls below the part of it that counts within half a tile
    power = 3e-4 * median * (0.5 * width / 0.05) ** 2
    lamp = SphereLamp(above, 0.05, (power, power, power))
    options = LightingOptions(**OPTIONS, placed=(in_splat(lamp, scene),))
    relit_city(city, "noon", options, formats=("npy",), albedo="white", folder="relit/corner")
    reports = [json.loads((city / "relit/corner" / entry["name"] / "relit.json").read_text()) for entry in tiles(city)]
    assert sorted(each["lamps"] for each in reports)[0] == 0 and max(each["lamps"] for each in reports) == 1
    plain = relit_city(city, "noon", LightingOptions(**OPTIONS), formats=("npy",), albedo="white", folder="relit/none")
    assert plain["vertices"]
    for entry, each in zip(tiles(city), reports, strict=True):
        one, other = (
            np.load(city / folder / entry["name"] / "radiance.npy") for folder in ("relit/corner", "relit/none")
        )
        assert np.array_equal(one, other) == (each["lamps"] == 0)


def test_lamps_reach_workers_to_the_bit():
    corners, faces = np.eye(3), np.array([[0, 1, 2]], np.int32)
    lamps = (
        SphereLamp((1.0, 2.0, 1 / 3), 0.1, (0.1, 5.0, 7.0)),
        SpotLamp((0.0, 1.0, 2.0), (0.1, 0.2, 0.3), intensity=(3.0, 2.0, 1.0), cutoff_deg=33.0, beam_deg=11.0),
        TubeLamp((0.0, 0.0, 0.0), (0.1, 0.7, 0.0), 0.02, (1.0, 1.0, 2.0)),
        MeshLamp(corners, faces, np.array([0.3, 0.2, 0.1])),
    )
    options = pickle.loads(pickle.dumps(LightingOptions(placed=tuple(asked_lamps(lamps)))))
    again = [resolve(each, LampScale(1.0, 1.0)) for each in asked_lamps(options.placed)]
    for one, other in zip(again[:3], lamps[:3], strict=True):
        assert one == other
    np.testing.assert_array_equal(again[3].vertices, corners)


@pytest.mark.parametrize("wish", [{"lamps": "off"}])
def test_what_only_rooms_have_is_refused(city, wish):
    with pytest.raises(InputError, match=next(iter(wish))):
        relit_city(city, "noon", LightingOptions(**OPTIONS, **wish), folder="relit/refused")
