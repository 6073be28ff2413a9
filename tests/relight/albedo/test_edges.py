"""The sun of a capture by the edges of its shadows: a floor with a box."""

from functools import cache

import numpy as np
import pytest
from captured_scenes import lit, patchy, sheet
from scipy.spatial import cKDTree

from relight import Environment
from relight.albedo.captured import CapturedScene
from relight.albedo.edges import EDGES, sharpened, sun_at_edges
from relight.albedo.shadows import shadows_of
from relight.albedo.sun import Sun, lit_by
from relight.transfer.bounces import with_bounces
from relight.transfer.transport import Transport

SUN, SKY = np.array([0.5, 0.72, -0.3]) / np.linalg.norm([0.5, 0.72, -0.3]), 0.4
IRRADIANCE = 3.0
FACES = (0, 1, 0), (1, 0, 0), (-1, 0, 0), (0, 0, 1), (0, 0, -1)
NOWHERE = {"seed": 0, "advance": lambda count: None}


@cache
def floor():
    """A floor of 3 by 3 with four boxes on it, as of `captured_scenes.lit`."""
    parts = [(sheet(90, lambda u, v: (3 * u - 1.5, 0 * u, 3 * v - 1.5)), (0, 1, 0))]
    for x, z, side, high in (
        (-0.6, -0.5, 0.3, 0.6),
        (0.7, 0.6, 0.4, 0.4),
        (0.7, -0.6, 0.2, 0.8),
        (-0.5, 0.7, 0.3, 0.3),
    ):
        box = np.array([x, 0.5 * high, z]), 0.5 * np.array([side, high, side])
        parts += [(sheet(8, lambda u, v, box=box, face=face: on_box(*box, face, u, v)), face) for face in FACES]
    vertices, faces, normals, start = [], [], [], 0
    for (points, corners), normal in parts:
        a, b, c = points[corners[0]]
        vertices.append(points)
        faces.append((corners if np.cross(b - a, c - a) @ normal > 0.0 else corners[:, ::-1]) + start)
        normals.append(np.tile(normal, (len(points), 1)))
        start += len(points)
    return lit(*(np.concatenate(a).astype(kind) for a, kind in ((vertices, "f4"), (normals, "f4"), (faces, "i4"))))


def on_box(middle, half, face, u, v):
    """Points on the side of a box with this normal, as columns."""
    axis = int(np.abs(face).argmax())
    square = np.stack([2 * u - 1, 2 * v - 1], axis=1)
    return (middle + half * np.insert(square, axis, face[axis], axis=1)).T


@cache
def photographed(irradiance, noise=0.1):
    """The floor, painted, as a CapturedScene under an even sky and a sun of this irradiance at right angles."""
    occluder, transfer, interreflection, _ = floor()
    direct = transfer[:, :1] * np.float32(SKY * np.sqrt(4.0 * np.pi))
    direct = direct + irradiance * lit_by(occluder, np.arange(len(transfer)), SUN[None])
    albedo = patchy(occluder) * np.random.default_rng(1).lognormal(0.0, noise, (len(transfer), 1)).astype(np.float32)
    albedo = np.minimum(albedo, np.float32(0.95))
    captured = 0.5 * with_bounces(np.repeat(direct, 3, axis=1), albedo, interreflection, tolerance=1e-4)[0]
    return CapturedScene(occluder, captured, **NOWHERE, transport=Transport(transfer, interreflection))


def off(direction, degrees, turn):
    """A direction so far from another."""
    side = np.cross(direction, [0.0, 1.0, 0.0])
    side /= np.linalg.norm(side)
    side = np.cos(turn) * side + np.sin(turn) * np.cross(direction, side)
    return np.cos(np.radians(degrees)) * direction + np.sin(np.radians(degrees)) * side


@pytest.mark.parametrize("degrees, turn", [(0.0, 0.0), (9.0, 1.0), (15.0, 4.0)])
def test_the_direction_of_a_sun_follows_from_the_edges_of_its_shadows(degrees, turn):
    found = sun_at_edges(photographed(IRRADIANCE), off(SUN, degrees, turn))
    assert found is not None and found.clear and found.nats == 0.0
    assert found.direction @ SUN > np.cos(np.radians(2.0))
    assert found.width_deg <= 2.0


def test_cast_shadows_show_how_strong_a_sun_is():
    scene = photographed(IRRADIANCE)
    rest = Environment(np.full((16, 32, 3), 0.5 * SKY, np.float32), "sky")
    for strength, share in ((0.3, 1.0), (4.0, 0.75)):
        lamp = Sun(off(SUN, 6.0, 2.0), 7.0, np.zeros(0), np.full(3, strength))
        edges = sun_at_edges(scene, lamp.direction)
        assert edges.shadows.deep and edges.nats_of_depth == 0.0
        found, before = sharpened(scene, rest, lamp, share, edges), share * strength
        shown = before * (found.irradiance / before) ** (1.0 / EDGES.weight)
        np.testing.assert_allclose(shown, 0.5 * IRRADIANCE, rtol=0.2)


def test_shadows_seen_at_their_edges_alone_make_a_sun_no_weaker():
    scene = photographed(IRRADIANCE)
    rest = Environment(np.full((16, 32, 3), 0.5 * SKY, np.float32), "sky")
    weak, strong = (Sun(SUN, 7.0, np.zeros(0), np.full(3, each)) for each in (0.3, 4.0))
    edges = sun_at_edges(scene, SUN)
    edges = edges._replace(shadows=edges.shadows._replace(distance=0.01))
    np.testing.assert_allclose(sharpened(scene, rest, weak, 1.0, edges).irradiance, 0.5 * IRRADIANCE, rtol=0.2)
    np.testing.assert_array_equal(sharpened(scene, rest, strong, 0.75, edges).irradiance, 3.0)


def test_blur_at_the_edges_does_not_hide_the_depth():
    """The depth away from edges is that of the light, and stays so where the colours are blurred."""
    scene = photographed(IRRADIANCE)
    occluder, rows = scene.occluder, np.flatnonzero(scene.usable)
    near = cKDTree(occluder.origins).query_ball_point(occluder.origins, 0.012)
    blurred = np.stack([scene.captured[each].mean(axis=0) for each in near])
    sharp, soft = (shadows_of(occluder, rows, each[rows], SUN) for each in (scene.captured, blurred))
    assert abs(sharp.depth - soft.depth) < 0.1 * sharp.depth
    assert shadows_of(occluder, rows[:100], scene.captured[rows[:100]], SUN) is None


def test_a_sun_whose_shadows_are_shallow_is_doubted():
    edges = sun_at_edges(photographed(IRRADIANCE), SUN)
    shallow = edges.shadows._replace(log_captured=0.4 * edges.shadows.log_captured)
    assert edges._replace(shadows=shallow).nats_of_depth < -2.0 and not edges._replace(shadows=shallow).clear
    assert edges._replace(shadows=shallow._replace(distance=0.01)).nats_of_depth == 0.0


@pytest.mark.parametrize("noise", [0.0, 0.3])
def test_without_a_sun_no_edge_shows_one(noise):
    scene = photographed(0.0, noise)
    for turn in (0.0, 2.5):
        found = sun_at_edges(scene, off(SUN, 8.0, turn))
        assert found is not None and not found.clear
        assert found.nats == 0.0 if noise else found.nats < -2.0  # strong paint hides any edge


def test_a_sun_far_from_where_it_was_found_before_is_left_alone():
    scene, far = photographed(IRRADIANCE), Sun(off(SUN, 60.0, 3.0), 7.0, np.zeros(0), np.ones(3))
    rest = Environment(np.ones((16, 32, 3), np.float32), "sky")
    assert sharpened(scene, rest, far, 1.0, sun_at_edges(scene, far.direction)) is None


def test_a_sun_whose_shadows_fall_on_nothing_is_not_doubted():
    found = sun_at_edges(photographed(0.0), off(SUN, 8.0, 0.0))
    assert found is not None and found._replace(shaded=0.1).nats == 0.0
