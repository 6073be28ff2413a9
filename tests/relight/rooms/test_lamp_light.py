"""The parts that rooms are made of, against closed forms: light of a lamp, views from eyes, averages, strengths."""

from itertools import pairwise

import numpy as np
import pytest

from relight.rooms import lamps, received, strengths
from relight.rooms.evenness import Evenness
from relight.rooms.seen import seen_from
from relight.transfer.occluder import Occluder

DOWN, UP = (0.0, -1.0, 0.0), (0.0, 1.0, 0.0)


def sheet(size, height, normal, count=1):
    """A level square about the axis, of count x count cells: vertices, normals, faces."""
    line = np.linspace(-size / 2.0, size / 2.0, count + 1)
    x, z = (axis.ravel() for axis in np.meshgrid(line, line, indexing="ij"))
    corner = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    first = np.stack([corner, corner + 1, corner + count + 2], axis=1)
    second = np.stack([corner, corner + count + 2, corner + count + 1], axis=1)
    faces = np.concatenate([first, second])
    vertices = np.stack([x, np.full(len(x), height), z], axis=1).astype(np.float32)
    return vertices, np.tile(np.float32(normal), (len(x), 1)), faces if normal == UP else faces[:, ::-1]


def joined(*parts):
    """Meshes as one, and where the vertices of each begin."""
    starts = np.cumsum([0, *(len(part[0]) for part in parts)])
    faces = np.concatenate([part[2] + start for part, start in zip(parts, starts[:-1], strict=True)])
    mesh = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts]), faces
    return mesh, [np.arange(low, high) for low, high in pairwise(starts)]


def vertex_areas(occluder):
    """(V,) a third of the area of each face about a vertex, unit frame."""
    corners = occluder.origins[occluder.faces].astype(np.float64)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2.0
    return np.bincount(occluder.faces.ravel(), np.repeat(area / 3.0, 3), len(occluder.origins))


def lit(*between):
    """What the middle of a floor 4 wide receives of a lamp .2 wide, 2 above it, with sheets between; and the lamp."""
    mesh, (floor, bulb, *_) = joined(sheet(4.0, 0.0, UP, 2), sheet(0.2, 2.0, DOWN, 8), *between)
    occluder = Occluder(*mesh)
    areas = vertex_areas(occluder)
    middle = floor[np.argmin(np.linalg.norm(mesh[0][floor], axis=1))]
    area = float(areas[bulb].sum())
    lamp = lamps.Lamp(bulb, area, occluder.origins[bulb].mean(axis=0), np.array(DOWN), np.ones(3))
    return lamps.light_of(lamp, occluder, areas, occluder.normals)[middle]


def test_a_small_lamp_lights_by_its_area_and_the_inverse_square_of_the_distance():
    # Facing and parallel, both cosines are 1: irradiance over pi is area over pi times the squared distance.
    assert lit() == pytest.approx(0.2**2 / (np.pi * 2.0**2), rel=0.02)


def test_a_lamp_behind_a_board_lights_nothing():
    assert lit(sheet(1.0, 1.0, UP)) == 0.0


def test_an_eye_sees_fronts_that_nothing_hides():
    mesh, (floor, board, back) = joined(sheet(4.0, 0.0, UP, 8), sheet(1.0, 1.0, UP), sheet(0.5, 3.0, UP))
    occluder = Occluder(*mesh)
    # The floor and the board face the eye 2 above the middle; the highest sheet turns its back on it.
    center = (mesh[0].min(axis=0) + mesh[0].max(axis=0)) / 2.0
    diagonal = np.linalg.norm(np.ptp(mesh[0], axis=0))
    eye = ((np.array([[0.0, 2.0, 0.0]]) - center) / diagonal).astype(np.float32)
    seen = seen_from(occluder, np.arange(len(mesh[0])), eye)
    # From 2 above, a board 1 wide half the way down hides a square 2 wide on the floor: its edge is left out here.
    reach = np.abs(mesh[0][floor][:, [0, 2]]).max(axis=1)
    assert not seen[floor][reach < 0.99].any() and seen[floor][reach > 1.01].all()
    assert seen[board].all() and not seen[back].any()


def test_averages_keep_what_is_even_and_the_mean_of_a_pair():
    vertices, normals, faces = sheet(1.0, 0.0, UP, 6)
    even = Evenness(Occluder(vertices, normals, faces))
    np.testing.assert_allclose(even.average(np.full((len(vertices), 3), 0.7), 5), 0.7, rtol=1e-6)
    # A linear ramp is kept by any mean over a ring that is even about its middle; the middle of the sheet is.
    ramp = even.average(vertices[:, 0].astype(np.float64), 1)
    middle = np.argmin(np.linalg.norm(vertices, axis=1))
    assert ramp[middle] == pytest.approx(0.0, abs=1e-6)
    noisy = np.random.default_rng(0).normal(size=len(vertices))
    assert even.average(noisy, 4).std() < 0.5 * noisy.std()


def test_a_mean_of_directions_has_length_one():
    vertices, normals, faces = sheet(1.0, 0.0, UP, 6)
    tilted = normals + np.random.default_rng(1).normal(scale=0.2, size=normals.shape)
    tilted = (tilted / np.linalg.norm(tilted, axis=1, keepdims=True)).astype(np.float32)
    mean = Evenness(Occluder(vertices, normals, faces)).average_directions(tilted, 4)
    np.testing.assert_allclose(np.linalg.norm(mean, axis=1), 1.0, rtol=1e-5)
    assert mean[:, 1].mean() > tilted[:, 1].mean()


def test_a_room_without_emitters_has_no_strengths_and_a_sky_that_nobody_saw_is_dimmer_beneath():
    up_and_down = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    known, unknown = received.sky_parts(None, up_and_down)
    assert not known.any()
    np.testing.assert_array_equal(unknown, [[1.0] * 3, [received.GROUND] * 3])
    none = np.zeros((0, 3))
    empty = received.RoomIrradiance(
        np.arange(100), np.ones((100, 3)), np.zeros((0, 100, 3)), none, np.zeros((100, 3)), np.zeros((0, 2), int),
        np.zeros(0), np.zeros((100, 3)),
    )  # fmt: skip
    assert strengths.solve(empty, none) is None


def two_lamps(ratio, albedo=strengths.USUAL_ALBEDO):
    """A RoomIrradiance of places in a row, of one albedo, that two lamps at its ends light, the second more so."""
    at = np.linspace(0.0, 1.0, 400)
    falloff = np.stack([1.0 / (0.1 + at**2), 1.0 / (0.1 + (1.0 - at) ** 2)])
    emitters = np.repeat(falloff[:, :, None], 3, axis=2)
    captured = albedo * (emitters[0] + ratio * emitters[1])
    pairs = np.stack([np.arange(380), np.arange(20, 400)], axis=1)
    still = np.zeros((400, 3))
    return received.RoomIrradiance(
        np.arange(400), still, emitters, np.zeros((0, 3)), still, pairs, np.full(380, 1.0 / 380.0), np.log(captured)
    )


def test_two_lamps_of_equal_strength_and_the_usual_albedo_are_found_as_they_are():
    found = strengths.solve(two_lamps(1.0), np.ones((2, 3)))
    np.testing.assert_allclose(found.radiance, 1.0, rtol=0.02)
    assert found.albedo == pytest.approx(strengths.USUAL_ALBEDO, rel=0.02) and found.gain > 0.9
    assert found.share.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("ratio", [2.0, 0.5])
def test_the_falloff_says_which_of_two_lamps_is_brighter(ratio):
    found = strengths.solve(two_lamps(ratio), np.ones((2, 3)))
    first, second = found.radiance.mean(axis=1)
    assert second / first == pytest.approx(ratio, rel=0.1)


def test_fewer_than_64_places_give_no_strengths():
    full = two_lamps(1.0)
    few = full._replace(
        vertices=full.vertices[:63],
        known=full.known[:63],
        emitters=full.emitters[:, :63],
        bounce=full.bounce[:63],
        pairs=full.pairs[:40],
        weights=full.weights[:40],
        log_captured=full.log_captured[:63],
    )
    assert strengths.solve(few, np.ones((2, 3))) is None
