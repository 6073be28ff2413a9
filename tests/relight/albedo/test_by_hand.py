"""The captured light set by hand: the right sun takes shadows out, and commands use what was kept."""

from dataclasses import replace

import numpy as np
import pytest
from captured_scenes import patchy, yard

from relight import Relighter
from relight.albedo.by_hand import RANGES, HandLight, HandScene, SkyAndSun, angles, keep, offered_in, sun_through
from relight.albedo.captured import CapturedScene
from relight.albedo.direct import direct_light
from relight.albedo.offered import drawn_sun, environment_of, texels
from relight.engine import appearance
from relight.engine.by_hand import LightByHand, can_be_set
from relight.light.captured_light import NAME, LikelyLight, LikelySun, offer, read_lights, write_lights
from relight.light.projections import texel_directions
from relight.light.sun_position import toward
from relight.transfer.bounces import with_bounces
from relight.transfer.transport import Transport
from relight.transfer.visibility import raytraced_scene
from splat2mesh.base.errors import InputError
from splat2mesh.scene.color import bytes_from_unit, luminance, srgb_from_linear
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

TRUE, WRONG = (200.0, 40.0), (290.0, 50.0)  # azimuth and height of the sun
GROUND = 49 * 49  # the first vertices of the yard


def sunny(azimuth, height, strength=10.0):
    """A blue sky over dark ground, and a sun: (LikelyLight, Environment)."""
    directions, _ = texels()
    image = np.where(directions[:, 1:2] > 0.0, [0.25, 0.3, 0.4], [0.08, 0.08, 0.07]).astype(np.float64)
    irradiance = tuple(strength / np.pi * factor for factor in (1.0, 0.9, 0.75))
    image += drawn_sun(np.array(toward(azimuth, height)), np.array(irradiance))
    entry = LikelyLight(f"sun at {azimuth:g}", 0.5, LikelySun(azimuth, height, irradiance), "")
    return entry, environment_of(image, "captured")


@pytest.fixture(scope="module")
def captured():
    """(Scene in the colours of the true sun, its true albedo, CapturedScene)."""
    white, (occluder, _, interreflection, _) = yard()
    transfer = raytraced_scene(occluder, 8, 64)
    albedo = patchy(occluder)
    albedo[:GROUND] = 0.4
    direct = direct_light(occluder, transfer, sunny(*TRUE)[1])
    radiance = with_bounces(direct, albedo, interreflection, tolerance=1e-6)[0]
    radiance *= 0.8 / radiance.max()
    chunk = white.chunks[0]
    colors = bytes_from_unit(srgb_from_linear(radiance))
    scene = Scene([Mesh(chunk.vertices, chunk.normals, chunk.faces, colors)], capture=dict(white.capture))
    transport = Transport(transfer, interreflection)
    return scene, albedo, CapturedScene(occluder, scene.colors_linear, 0, lambda count: None, transport)


def contrast(albedo):
    """Spread of the log albedo over ground of one paint."""
    return float(np.std(np.log(luminance(albedo[:GROUND]))))


@pytest.mark.parametrize("exact", [False, True])
def test_the_true_sun_takes_the_shadows_out(captured, exact):
    hands = HandScene(captured[2])
    offered = SkyAndSun.of(*sunny(*WRONG))
    before = contrast(hands.albedo(offered, offered.hand, exact))
    moved = offered.hand.changed(azimuth_deg=TRUE[0], height_deg=TRUE[1])
    after = contrast(hands.albedo(offered, moved, exact))
    assert contrast(captured[0].colors_linear) > 0.5 and before > 0.3
    assert after < (0.3 if exact else 0.5) * before  # harmonics blur the edges of shadows
    away = offered.hand.changed(azimuth_deg=TRUE[0] + 15.0, height_deg=TRUE[1])
    assert contrast(hands.albedo(offered, away, exact)) > (1.5 if exact else 1.2) * after


def test_an_offered_light_that_nobody_touches_stays_as_it_was(captured):
    entry, environment = sunny(*TRUE)
    offered = SkyAndSun.of(entry, environment)
    assert (offered.hand.azimuth_deg, offered.hand.height_deg) == TRUE and 0.3 < offered.hand.sun_share < 0.9
    wanted = environment.sh(3)
    for found in (offered.environment(offered.hand).sh(3), offered.coefficients(offered.hand, 3)):
        assert np.abs(found - wanted).max() < 0.03 * np.abs(wanted).max()
    cloudy = SkyAndSun.of(LikelyLight("cloudy", 0.5, None, ""), environment)
    np.testing.assert_allclose(cloudy.environment(cloudy.hand).sh(3), wanted, atol=0.01 * np.abs(wanted).max())


def test_the_share_leaves_what_faces_the_sun_as_bright_and_tint_leaves_its_luminance(captured):
    offered = SkyAndSun.of(*sunny(*TRUE))

    def facing(hand):
        image = offered.environment(hand)
        directions = texel_directions(128, 256).reshape(-1, 3)
        area = np.repeat(np.sin(np.pi * (np.arange(128) + 0.5) / 128), 256)
        shares = area * 4 * np.pi / area.sum() * np.maximum(directions @ hand.direction, 0.0)
        return shares @ image.lookup(directions).astype(np.float64)

    level = luminance(facing(offered.hand))
    for changes in ({"sun_share": 0.2}, {"sun_share": 0.9}, {"azimuth_deg": 40.0}, {"warmth": 1.0}, {"green": -0.5}):
        assert luminance(facing(offered.hand.changed(**changes))) == pytest.approx(level, rel=0.03), changes
    assert luminance(facing(offered.hand.changed(brightness_ev=1.0))) == pytest.approx(2 * level, rel=1e-3)
    warm = facing(offered.hand.changed(warmth=1.0)) / facing(offered.hand)
    assert warm[0] / warm[2] == pytest.approx(2.0, rel=1e-3) and warm[1] ** 2 == pytest.approx(warm[0] * warm[2])


def test_values_are_brought_into_range_and_others_refused():
    hand = HandLight().changed(azimuth_deg=-30.0, height_deg=120.0, sun_share=2)
    assert (hand.azimuth_deg, hand.height_deg, hand.sun_share) == (330.0, 90.0, RANGES["sun_share"][1])
    for changes, problem in (
        ({"strength": 1.0}, "strength: expected one of azimuth_deg"),
        ({"warmth": float("nan")}, "warmth must be a finite number, found nan"),
        ({"warmth": "red"}, "warmth must be a finite number, found red"),
    ):
        with pytest.raises(InputError, match=problem):
            hand.changed(**changes)


def test_an_edge_and_what_casts_it_give_the_sun():
    for azimuth, height in (TRUE, WRONG, (0.0, 10.0)):
        edge = np.array([0.3, -0.2, 1.0])
        found = sun_through(edge, edge + 2.5 * np.array(toward(azimuth, height)))
        assert found == {"azimuth_deg": pytest.approx(azimuth, abs=1e-6), "height_deg": pytest.approx(height)}
        assert angles(toward(azimuth, height))["height_deg"] == pytest.approx(height)
    with pytest.raises(InputError, match="below the horizon"):
        sun_through([0, 1, 0], [1, 0, 0])
    with pytest.raises(InputError, match="click two"):
        sun_through([0, 1, 0], [0, 1, 0])


def test_commands_use_what_was_kept_until_they_are_told_otherwise(captured, tmp_path):
    folder = tmp_path / "scene"
    captured[0].save(folder)
    offer(folder, [sunny(*WRONG), sunny(*TRUE)])
    saved = Scene.load(folder)
    estimated = appearance.appearance_of("estimated", None, Relighter(saved, captured_light=1))
    by_hand = LightByHand(Relighter(saved), estimated)
    assert can_be_set(estimated, Relighter(saved)) and len(by_hand.offered) == 2 and by_hand.first == 0
    hand = by_hand.offered[0].hand.changed(azimuth_deg=TRUE[0], height_deg=TRUE[1], brightness_ev=-1.0, warmth=0.3)
    assert by_hand.keep(0, hand) == folder / NAME

    chosen = read_lights(folder / NAME).chosen
    assert chosen.by_hand and chosen.name == f"set by hand from sun at {WRONG[0]:g}" and chosen.brightness == 0.5
    assert (chosen.sun.azimuth_deg, chosen.sun.height_deg) == TRUE
    used = appearance.appearance_of("estimated", None, Relighter(saved))
    assert used.capture["light"] == chosen.name
    np.testing.assert_array_equal(used.albedo, by_hand.albedo(0, hand, exact=True))  # no exposure is found anew
    likeliest = appearance.appearance_of("estimated", None, Relighter(saved, captured_light=1))
    np.testing.assert_array_equal(likeliest.albedo, estimated.albedo)

    offer(folder, [sunny(*WRONG)])  # another estimate
    assert read_lights(folder / NAME).chosen == chosen
    again = LightByHand(Relighter(saved), used)
    assert again.first == 1 and again.offered[1].hand.azimuth_deg == TRUE[0]
    np.testing.assert_allclose(again.albedo(1, again.offered[1].hand, True), used.albedo, atol=0.02)
    again.keep(1, again.offered[1].hand)
    assert read_lights(folder / NAME).chosen.name == chosen.name
    assert len(list(folder.glob("captured_light-*.npz"))) == 2
    write_lights(folder, replace(read_lights(folder / NAME), chosen=None))
    assert len(offered_in(read_lights(folder / NAME), folder)) == 1


def test_a_scene_in_memory_keeps_no_light(captured):
    look = appearance.appearance_of("estimated", sunny(*TRUE)[1], Relighter(captured[0]))
    by_hand = LightByHand(Relighter(Scene(captured[0].chunks)), look)
    assert [each.entry.name for each in by_hand.offered] == ["as estimated"] and by_hand.first == 0
    with pytest.raises(InputError, match="this scene has none: save it"):
        by_hand.keep(0, HandLight())
    given = appearance.appearance_of("white", None, Relighter(captured[0]))
    assert not can_be_set(given, Relighter(captured[0]))


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    offered = SkyAndSun.of(*sunny(*TRUE))
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(InputError, match="cannot write"):
        keep(tmp_path / "file" / "scene", offered, offered.hand)
