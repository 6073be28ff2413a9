"""What objects change at the surfaces around them, and what light they receive."""

import numpy as np
import pytest
from disc_scenes import WHITE, disc, every, floor, form_factor, grid, standing_of

from relight.insert.gathering import Casting, change_at, light_on
from relight.insert.objects import InsertedObject, Part
from relight.insert.standing import Standing
from relight.insert.surroundings import Sky, surroundings_of
from relight.lamps.shapes import SphereLamp
from relight.light.environment import Environment
from relight.transfer.occluder import Frame, Occluder
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


@pytest.mark.parametrize("height", [0.2, 1.0])
def test_a_black_disc_hides_its_form_factor_of_an_even_sky(height):
    scene, occluder, black = floor()
    around = surroundings_of(scene, occluder, black, [Sky(WHITE, 2.0)], [])
    standing = standing_of(scene, *disc(0.5, height), albedo=0.0)
    change = change_at(around, standing, np.zeros_like(standing.vertices), Casting(256), every(occluder))
    distance = np.linalg.norm(scene.vertices[:, [0, 2]], axis=1)
    reached = distance < 3.0
    wanted = -2.0 * form_factor(distance, height, 0.5)[:, None]
    # 256 rays to a cone, or 2048 all around, of a sky of 2: at most one in a hundred of them is on the wrong side.
    np.testing.assert_allclose(change[reached], np.broadcast_to(wanted, change.shape)[reached], atol=0.025)


def test_a_disc_that_sends_what_it_hides_changes_nothing_and_a_brighter_one_adds_it():
    scene, occluder, black = floor()
    around = surroundings_of(scene, occluder, black, [Sky(WHITE, 1.0)], [])
    standing = standing_of(scene, *disc(0.5, 0.4), albedo=1.0)
    same = change_at(around, standing, np.ones_like(standing.vertices), Casting(32), every(occluder))
    np.testing.assert_allclose(same, 0.0, atol=1e-5)
    hidden = change_at(around, standing, np.zeros_like(standing.vertices), Casting(32), every(occluder))
    brighter = change_at(around, standing, np.full_like(standing.vertices, 2.0), Casting(32), every(occluder))
    np.testing.assert_allclose(brighter, -hidden, atol=1e-5)


def test_what_stands_between_place_and_object_keeps_the_change_from_it_to_the_bit():
    vertices, normals, faces = grid(41)
    lid = grid(41, height=0.2)
    both = Scene([Mesh(*mesh[:3], np.zeros((len(mesh[0]), 3), np.uint8)) for mesh in ((vertices, normals, faces), lid)])
    occluder = Occluder(both.vertices, both.normals, both.faces)
    around = surroundings_of(both, occluder, np.zeros_like(both.vertices), [Sky(WHITE, 1.0)], [])
    standing = standing_of(both, *disc(0.5, 0.5), albedo=0.5)
    change = change_at(around, standing, np.zeros_like(standing.vertices), Casting(32), every(occluder))
    inner = np.abs(vertices[:, [0, 2]]).max(axis=1) < 4.0
    assert not change[: len(vertices)][inner].any()
    assert change[len(vertices) :].any()


def test_surfaces_that_are_hidden_count_like_the_sky():
    vertices, normals, faces = grid(61)
    ceiling = grid(61, size=100.0, height=3.0)
    below = np.tile(np.float32([0, -1, 0]), (len(ceiling[0]), 1))
    room = Scene(
        [
            Mesh(*mesh, np.zeros((len(mesh[0]), 3), np.uint8))
            for mesh in ((vertices, normals, faces), (ceiling[0], below, ceiling[2]))
        ]
    )
    occluder = Occluder(room.vertices, room.normals, room.faces)
    sent = np.zeros_like(room.vertices)
    sent[len(vertices) :] = 0.7
    around = surroundings_of(room, occluder, sent, [], [])
    standing = standing_of(room, *disc(0.5, 0.5), albedo=0.0)
    found = change_at(around, standing, np.zeros_like(standing.vertices), Casting(256), every(occluder))
    change = found[: len(vertices)]
    distance = np.linalg.norm(vertices[:, [0, 2]], axis=1)
    reached = distance < 1.5
    wanted = -0.7 * form_factor(distance, 0.5, 0.5)[reached]
    np.testing.assert_allclose(change[reached].mean(axis=1), wanted, atol=0.02)  # as above


def test_a_lamp_throws_the_shadow_of_a_disc_and_reaches_all_else():
    scene, occluder, black = floor()
    lamp = SphereLamp((0.0, 2.0, 0.0), 0.01, (5000.0, 5000.0, 5000.0))
    around = surroundings_of(scene, occluder, black, [], [lamp])
    standing = standing_of(scene, *disc(0.5, 1.0), albedo=0.0)
    change = change_at(around, standing, np.zeros_like(standing.vertices), Casting(32), every(occluder))
    distance = np.linalg.norm(scene.vertices[:, [0, 2]], axis=1)
    inside, outside = distance < 0.95, distance > 1.05  # twice the disc, and a soft edge
    unhidden = 5000.0 * 0.01**2 * 2.0 / (distance**2 + 4.0) ** 1.5
    np.testing.assert_allclose(change[inside, 0], -unhidden[inside], rtol=2e-3)
    assert not change[outside].any()


def test_a_sun_throws_its_shadow_where_it_falls():
    image = np.full((64, 128, 3), 0.01, np.float32)
    image[20, 40] = 3000.0
    sunny = Environment(image, "sunny")
    scene, occluder, black = floor()
    around = surroundings_of(scene, occluder, black, [Sky(sunny, 1.0)], [])
    assert 1 <= len(around.suns) < 64  # parts of one texel
    standing = standing_of(scene, *disc(0.5, 1.0), albedo=0.0)
    change = change_at(around, standing, np.zeros_like(standing.vertices), Casting(16), every(occluder))
    direction = around.suns.directions.mean(axis=0)
    direction /= np.linalg.norm(direction)
    spot = -direction[[0, 2]] / direction[1]
    distance = np.linalg.norm(scene.vertices[:, [0, 2]] - spot, axis=1)
    full = around.suns.weights.sum(axis=0)[0] / np.pi * direction[1]
    np.testing.assert_allclose(change[distance < 0.4, 0], -full, rtol=0.02)  # a texel is 2.8 degrees wide
    assert (change[distance > 0.65, 0] > -0.05 * full).all()


def test_objects_in_an_even_light_receive_just_that_light():
    scene, occluder, _ = floor()
    around = surroundings_of(scene, occluder, np.full_like(scene.vertices, 0.3), [Sky(WHITE, 0.3)], [])
    standing = standing_of(scene, *disc(0.5, 1.0), albedo=0.5)
    np.testing.assert_allclose(light_on(around, standing), 0.3, atol=1e-4)


def test_an_object_below_a_sky_above_a_black_floor_receives_what_it_sees_of_either():
    scene, occluder, black = floor(size=1000.0)
    around = surroundings_of(scene, occluder, black, [Sky(WHITE, 1.0)], [])
    above = light_on(around, standing_of(scene, *disc(0.5, 1.0, up=True), albedo=0.5))
    below = light_on(around, standing_of(scene, *disc(0.5, 1.0), albedo=0.5))
    np.testing.assert_allclose(above, 1.0, atol=1e-5)
    np.testing.assert_allclose(below, 0.0, atol=0.01)


def test_light_between_the_inner_sides_of_a_sphere_grows_by_its_albedo():
    # A closed white-lined sphere whose wall glows with 1: all inside receive 1 / (1 - albedo), of four rounds the sum.
    count = 24
    polar, turn = np.meshgrid(np.linspace(0, np.pi, count), np.linspace(0, 2 * np.pi, 2 * count), indexing="ij")
    vertices = np.stack([np.sin(polar) * np.cos(turn), np.cos(polar), np.sin(polar) * np.sin(turn)], -1).reshape(-1, 3)
    a = (np.arange(count - 1)[:, None] * 2 * count + np.arange(2 * count - 1)).ravel()
    faces = np.concatenate(
        [np.stack([a, a + 1, a + 2 * count], 1), np.stack([a + 1, a + 2 * count + 1, a + 2 * count], 1)]
    )
    scene, occluder, black = floor(size=100.0)
    around = surroundings_of(scene, occluder, black, [], [])
    colors, ones = np.ones((len(vertices), 4), np.float32), np.ones((len(vertices), 3), np.float32)
    points = (0.5 * vertices + [0, 2, 0]).astype(np.float32)
    inward = -vertices.astype(np.float32)
    part = Part(points, inward, faces.astype(np.int32), colors, None, 0.5 * ones, ones)
    standing = Standing.of(Frame.around(scene.vertices, scene.faces), [InsertedObject("sphere", [part])], [np.eye(4)])
    light = light_on(around, standing)
    wanted = sum(0.5**k for k in range(4))
    np.testing.assert_allclose(np.median(light), wanted, rtol=0.02)
