"""Lamps that are put into a scene, and what stays of its captured light: closed forms, and the same to the bit."""

import math

import numpy as np
import pytest
import trimesh
from place_splats import room as room_of_splats

from relight import LightingOptions, RelightRequest
from relight.engine.appearance import Appearance, appearance_of
from relight.engine.lamp_scale import lamp_scale
from relight.engine.light_mix import light_beside
from relight.engine.placed import LampLight
from relight.engine.relighter import Relighter, Shading
from relight.jobs.job import Job
from relight.lamps.shapes import SphereLamp
from relight.light.loading import CapturedLight
from relight.splats import Binding
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

ALBEDO = 0.6


def hollow_ball(subdivisions=3, grey=ALBEDO):
    """A ball of radius 1 seen from within: every place on it receives the same of a lamp in its middle."""
    ball = trimesh.creation.icosphere(subdivisions)
    vertices = np.array(ball.vertices, np.float32)
    faces = np.array(ball.faces[:, ::-1], np.int32)
    byte = round(255 * (1.055 * grey ** (1 / 2.4) - 0.055))
    colors = np.full(vertices.shape, byte, np.uint8)
    return Scene([Mesh(vertices, -vertices, faces, colors)])


def lamp_light(scene, lamps, tolerance=0.01, effects="auto", captured=1.0):
    relighter = Relighter(scene, LightingOptions(effects=effects))
    look = appearance_of("captured", None, relighter)
    return LampLight(relighter, look, lamps, tolerance, captured)


def test_in_a_ball_light_is_thrown_on_as_a_geometric_series():
    """All of it receives direct / (1 - albedo): each bounce is as even as the light before it."""
    light = lamp_light(hollow_ball(), [SphereLamp((0, 0, 0), 0.0, intensity=(1.0, 2.0, 0.5))])
    placed = light.placed
    albedo = float(light._look.albedo.mean())
    direct = np.array([1.0, 2.0, 0.5]) / math.pi
    np.testing.assert_allclose(placed.direct, np.broadcast_to(direct, placed.direct.shape), rtol=0.01)
    received = direct / (1.0 - albedo)  # rays to 640 vertices, and bounces up to a thousandth left out
    np.testing.assert_allclose(placed.received, np.broadcast_to(received, placed.received.shape), rtol=0.02)
    np.testing.assert_allclose(placed.radiance, albedo * placed.received, rtol=1e-4)
    series = [before * albedo for before in placed.bounces[:-1]]
    assert len(placed.bounces) > 8 and all(
        later < 1.05 * before for before, later in zip(series, placed.bounces[1:], strict=True)
    )


def test_without_bounces_there_are_none():
    light = lamp_light(hollow_ball(), [SphereLamp((0, 0, 0), 0.1, (1, 1, 1))], effects="shadows")
    np.testing.assert_array_equal(light.placed.received, light.placed.direct)
    assert light.placed.bounces == []


def test_each_lamp_by_itself_adds_up_to_all():
    lamps = [SphereLamp((0.3, 0, 0), 0.05, (3, 0, 0)), SphereLamp((-0.2, 0.4, 0), 0.1, (0, 2, 0))]
    light = lamp_light(hollow_ball(), lamps)
    parts = [light.direct_of(number) for number in range(2)]
    np.testing.assert_allclose(sum(parts), light.placed.direct, atol=0.01 * float(light.placed.direct.max()))
    assert parts[0][:, 1].max() == 0.0 and parts[1][:, 0].max() == 0.0


def test_a_lamp_outside_lights_nothing_and_says_so():
    light = lamp_light(hollow_ball(), [SphereLamp((3, 0, 0), 0.1, (5, 5, 5))])
    with pytest.warns(DataWarning, match="no vertex receives light from the lamps"):
        assert not light.placed.radiance.any()


def test_the_plan_keeps_to_its_tolerance_and_says_what_the_lamps_are():
    lamps = [SphereLamp((0.0, 0.2, 0), 0.3, (1, 1, 1))]
    few, many = (lamp_light(hollow_ball(), lamps, tolerance).plan for tolerance in (0.1, 0.001))
    assert few.error <= 0.1 and few.rays <= many.rays
    assert 0.0 < few.share < 1.0 and few.curve[0][2] == 8
    assert "1 lamp," in few.table(1)[0] and few.as_dict()["rays"] == few.rays


def look_of(captured, irradiance, albedo):
    return Appearance(albedo, captured, irradiance)


def test_captured_light_that_stays_is_the_same_to_the_bit():
    rng = np.random.default_rng(0)
    captured, albedo = rng.random((2, 50, 3)).astype(np.float32)
    look = look_of(captured, captured / np.maximum(albedo, 0.02), albedo)
    nothing = Shading(np.zeros_like(captured), 0, [], None)
    same = light_beside(look, captured, 1.0, None, 1.0).shading(look, nothing)
    np.testing.assert_array_equal(same.radiance, captured)
    np.testing.assert_array_equal(same.received, look.irradiance)
    half = light_beside(look, captured, 0.5, None, 2.0).shading(look, nothing)
    np.testing.assert_allclose(half.radiance, captured / 4.0, rtol=1e-6)
    np.testing.assert_allclose(half.received, look.irradiance / 4.0, rtol=1e-6)


def test_the_parts_of_a_mixture_add_up():
    rng = np.random.default_rng(1)
    captured, radiance = rng.random((2, 20, 3)).astype(np.float32)
    albedo = np.full_like(captured, 0.5)
    look = look_of(captured, captured / albedo, albedo)
    environment = Shading(radiance, 2, [0.1], None)
    found = light_beside(look, captured, 0.1, None, 1.0)._replace(env_scale=0.25).shading(look, environment)
    np.testing.assert_allclose(found.radiance, 0.1 * captured + 0.25 * radiance, rtol=1e-5)
    np.testing.assert_allclose(found.received, found.radiance / albedo, rtol=1e-5)
    assert found.bounces == [0.1] and found.sun_count == 2


def job_of(scene, **lighting):
    return Job(RelightRequest(scene, lighting=LightingOptions(**lighting), albedo="captured", caching="none"))


def test_a_lamp_alone_keeps_the_captured_light_and_its_exposure():
    job = job_of(hollow_ball(), placed=[SphereLamp((0, 0, 0), 0.1, (1, 1, 1))])
    shaded = next(job.shaded())
    assert isinstance(shaded.light, CapturedLight) and shaded.exposure == 1.0 and job.plan is None
    placed = job.mix.lamp_light.placed
    np.testing.assert_allclose(shaded.shading.radiance, job.known.appearance.captured + placed.radiance, rtol=1e-5)


def test_night_has_the_light_of_the_lamp_alone_and_no_lamp_changes_nothing():
    scene, lamp = hollow_ball(), SphereLamp((0, 0, 0), 0.1, (1, 1, 1))
    night = next(job_of(scene, placed=[lamp], captured=0.0).shaded())
    both = next(job_of(scene, placed=[lamp]).shaded())
    same = next(job_of(scene, captured=1.0).shaded())
    captured = scene.colors_linear
    np.testing.assert_array_equal(same.shading.radiance, captured)
    np.testing.assert_allclose(both.shading.radiance, night.shading.radiance + captured, rtol=1e-4)


def test_beside_an_environment_lamps_are_in_units_of_the_picture():
    """A mesh has no captured light: the environment is exposed by its brightest vertices, and the lamp then added."""
    ball = trimesh.creation.icosphere(2)
    colors = np.full(ball.vertices.shape, 200, np.uint8)
    vertices = np.array(ball.vertices, np.float32)
    scene = Scene([Mesh(vertices, vertices, np.array(ball.faces, np.int32), colors)])
    lamp = SphereLamp((0, 3.0, 0), 0.2, (20, 20, 20))

    def shown(**lighting):
        request = RelightRequest(scene, "noon", LightingOptions(**lighting), albedo="captured", caching="none")
        shaded = next(Job(request).shaded())
        return shaded.shading.radiance * shaded.exposure

    day, lit, dim = shown(), shown(placed=[lamp]), shown(placed=[lamp], env_scale=0.0)
    alone = next(job_of(scene, placed=[lamp], captured=0.0).shaded()).shading.radiance
    np.testing.assert_allclose(dim, alone, atol=1e-4)
    np.testing.assert_allclose(lit, day + alone, atol=2e-3)


def test_splats_keep_every_bit_where_the_captured_light_stays():
    splats = room_of_splats(0.2)
    scene = hollow_ball(2)
    relighter = Relighter(scene)
    look = appearance_of("captured", None, relighter)
    nothing = Shading(np.zeros_like(look.captured), 0, [], None)
    same = light_beside(look, look.captured, 1.0, None, 1.0).shading(look, nothing)
    relit = Binding(splats, scene, ()).relit(look.irradiance, same.received, 1.0)
    np.testing.assert_array_equal(relit.sh, splats.sh)


def test_a_metre_is_as_high_as_eyes_are_and_objects_are_a_metre():
    scene = hollow_ball()
    relighter = Relighter(scene)
    look = appearance_of("captured", None, relighter)
    scale = lamp_scale(scene, look, relighter.occluder)
    assert scale.metre == pytest.approx(scene.diagonal)
    assert scale.irradiance == pytest.approx(math.pi * np.median(look.irradiance @ [0.2126, 0.7152, 0.0722]), rel=1e-5)
    assert lamp_scale(scene, look, relighter.occluder, 3.0).metre == 3.0  # what is known takes precedence
    stood = Scene(scene.chunks, capture={"from": "inside", "eyes": [[0.0, 0.25, 0.0]]})
    assert lamp_scale(stood, look, relighter.occluder).metre == pytest.approx(1.0, rel=0.02)  # 1.25 above the bottom


@pytest.mark.parametrize(
    ("lighting", "message"),
    [
        ({"placed": ["1,2"]}, "1,2"),
        ({"placed": [3.0]}, "`placed`"),
        ({"captured": -1}, "`captured`"),
        ({"env_scale": math.nan}, "`env_scale`"),
        ({"lamps": "0x=1"}, "`lamps`"),
        ({"lamps": "1=off,1=2"}, "`lamps`"),
    ],
)
def test_what_makes_no_sense_is_said_before_any_work(lighting, message):
    with pytest.raises(InputError, match=message):
        job_of(hollow_ball(1), **lighting).inputs.asked_lamps  # noqa: B018


def test_lamps_by_number_belong_to_rooms():
    with pytest.raises(InputError, match=r"`lamps` 2=0: found no lamp"):
        next(job_of(hollow_ball(1), lamps="2=off").shaded())
    assert LightingOptions(lamps={2: 0.5, 1: "off"}).lamp_factors(3) == [0.0, 0.5, 1.0]


def test_the_light_of_the_capture_cannot_be_turned():
    with pytest.raises(InputError, match="cannot be turned"):
        RelightRequest("x", "captured", angles_deg=(45.0,))
    assert RelightRequest("x", lighting=LightingOptions(captured=0.2)).env == "captured"
    assert RelightRequest("x").env == "studio"


def test_without_lamps_nothing_is_lit_and_nothing_planned():
    light = lamp_light(hollow_ball(), [])
    nothing = np.zeros_like(light._look.captured)
    assert light.bounce_plan is None and not light.with_bounces(nothing).radiance.any()
