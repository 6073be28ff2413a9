"""What a person says of the captured light: read from options, and part of the key of what depends on it."""

from dataclasses import replace

import numpy as np
import pytest

from relight import Environment, LightingOptions, Relighter
from relight.albedo import CaptureEvidence
from relight.albedo.said import Said
from relight.engine import appearance
from relight.light.captured_light import LikelyLight, offer, read_lights, write_lights
from relight.transfer.store import array_key
from scenes import build
from splat2mesh.base.errors import InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


@pytest.fixture(scope="module")
def scene():
    truth = build("tabletop", 3, 1000)
    colors = np.uint8(255 * truth.albedo_linear)
    return Scene([Mesh(truth.vertices, truth.normals, truth.faces, colors)])


def test_nothing_said_is_nothing():
    said = Said.read(None, None, None)
    assert said.sun is said.sky is said.light is None and said.key == []
    assert CaptureEvidence().said.key == [] and LightingOptions().said == ()


def test_options_say_it_to_the_estimate(scene, monkeypatch):
    relighter = Relighter(scene, captured_sun="90,30", captured_sky="Hazy")
    np.testing.assert_allclose(relighter.said.sun, [0.75**0.5, 0.5, 0.0], atol=1e-12)
    assert relighter.said.sky == "hazy" and relighter.said.light is None
    seen = []

    def estimate(*arguments, evidence, **more):
        seen.append(evidence.said)
        raise InputError("stop")

    monkeypatch.setattr("relight.engine.appearance.estimate", estimate)
    with pytest.raises(InputError, match="stop"):
        appearance.appearance_of("estimated", None, relighter)
    assert seen == [relighter.said]


def test_a_said_light_acts_as_a_known_one(scene):
    noon = Environment.load("noon")
    given = appearance.appearance_of("estimated", noon, Relighter(scene))
    said = appearance.appearance_of("estimated", None, Relighter(scene, captured_light=noon))
    np.testing.assert_array_equal(said.albedo, given.albedo)
    assert said.capture["light"] == given.capture["light"] == "noon"


def test_what_is_said_is_part_of_the_key():
    sky = Environment(np.ones((4, 8, 3), np.float32))
    said = [
        Said(),
        Said(sun=np.array([0.0, 1.0, 0.0])),
        Said(sun=np.array([1.0, 0.0, 0.0])),
        Said(sky="clear"),
        Said(sky="shade"),
        Said(sky=sky),
        Said(sky=sky.rotated(30.0)),
        Said(sun=np.array([0.0, 1.0, 0.0]), sky="clear"),
    ]
    assert len({array_key(np.zeros(3), *each.key) for each in said}) == len(said)


def test_the_light_chosen_in_the_folder_of_a_scene_is_said(scene, tmp_path):
    Scene(scene.chunks).save(tmp_path / "scene")
    offer(tmp_path / "scene", [(LikelyLight("noon", 1.0, None, ""), Environment.load("noon"))])
    saved = Scene.load(tmp_path / "scene")
    assert Relighter(saved).said.light is None
    assert Relighter(saved, captured_light="1").said.light.name == "noon"
    lights = read_lights(tmp_path / "scene" / "captured_light.json")
    write_lights(tmp_path / "scene", replace(lights, chosen=lights.candidates[0]))
    assert Relighter(saved).said.light.name == "noon"
    assert Relighter(saved, captured_light="AUTO").said.light is None


def test_bad_words_are_refused(scene, tmp_path):
    for wishes, problem in (
        ({"captured_sky": "blue"}, "`captured_sky` blue: expected clear, hazy"),
        ({"captured_sky": tmp_path / "no.exr"}, "no such file"),
        ({"captured_light": "no.exr"}, "`captured_light` no.exr: no such file"),
        ({"captured_light": 1}, "`captured_light` 1: a scene in memory holds no"),
    ):
        with pytest.raises(InputError, match=problem):
            _ = Relighter(scene, **wishes).said
    with pytest.raises(InputError, match="`captured_light` 0: expected the number"):
        LightingOptions(captured_light="0")
    with pytest.raises(InputError, match="`captured_sun`: it needs an estimated albedo"):
        appearance.appearance_of("white", None, Relighter(scene, captured_sun="90,30"))
