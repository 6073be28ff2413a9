"""A closed box in which a ball moves: its lamp lights it where it is, as radiosity knows."""

from dataclasses import replace

import numpy as np
import pytest
from lit_rooms import room

from relight import Environment, LightingOptions
from relight.engine.appearance import CAPTURE
from relight.jobs.job import Job
from relight.request import RelightRequest
from relight.rooms.room_poses import RoomPoses
from scenes.radiosity import light
from splat2mesh.base.errors import DataWarning
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

SHIFT = np.float32([-0.5, 0.3, 0.0])
"""Of the ball: off the floor, beneath the lamp."""


@pytest.fixture(scope="module")
def poses():
    """(the place, with its ball elsewhere, the Room in either pose, and the vertices of the ball)."""
    scene, place, _, _ = room()
    asked = RelightRequest(scene, "captured", LightingOptions(tolerance=0.05), albedo="estimated", caching="none")
    with pytest.warns(DataWarning, match="closed room"):
        known = Job(asked).known
        found = known.appearance.room
    solids = [np.flatnonzero(place.part == part) for part in np.unique(place.part)]
    ball = min(
        (rows for rows in solids if not place.emitted[rows].any()),
        key=lambda rows: np.abs(place.vertices[rows].mean(axis=0) - [0.5, 0.22, 0.55]).sum(),
    )
    vertices = place.vertices.copy()
    vertices[ball] += SHIFT
    (mesh,) = scene.chunks
    then = Scene([Mesh(vertices, mesh.normals, mesh.faces, mesh.colors_srgb)], capture=scene.capture)
    still = known.relighter.posed(scene, CAPTURE)
    moved = still.posed(then, CAPTURE)
    lamps = RoomPoses(found, still.occluder, still.transport(CAPTURE).interreflection)
    again = lamps.at(still.occluder, still.transport(CAPTURE).interreflection)
    there = lamps.at(moved.occluder, moved.transport(CAPTURE).interreflection)
    return place, replace(place, vertices=vertices), (found, again, there), ball


def test_where_nothing_moves_the_room_is_as_found(poses):
    _, _, (found, again, _), _ = poses
    np.testing.assert_array_equal(again.by_lamps, found.by_lamps)
    np.testing.assert_array_equal(again.lamp_light, found.lamp_light)


def test_the_light_of_its_lamp_follows_what_moves(poses):
    place, moved, (found, _, there), ball = poses
    sky = Environment.load("overcast")
    before, after = (light(each, sky).radiance() for each in (place, moved))
    rest = np.ones(len(before), bool)
    rest[ball] = False
    rest &= ~place.emitted.any(axis=1) & (place.vertices[:, 1] < 0.05)  # the floor, where its shadow falls
    true, model = (
        np.log(np.maximum(new, 1e-3) / np.maximum(old, 1e-3))[rest].mean(axis=1)
        for old, new in ((before, after), (found.by_lamps, there.by_lamps))
    )
    changed = np.abs(true) > 0.3
    assert changed.sum() > 5 and np.corrcoef(true[changed], model[changed])[0, 1] > 0.8
    assert np.abs(model - true)[changed].mean() < 0.6 * np.abs(true)[changed].mean()
