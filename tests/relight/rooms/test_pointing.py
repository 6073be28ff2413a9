"""Lamps that a person points at: a generated closed box whose lamp is too yellow to be found by its colours."""

import warnings
from functools import cache

import numpy as np
import pytest
from lit_rooms import room

from relight import LightingOptions
from relight.jobs.job import Job
from relight.request import RelightRequest
from splat2mesh.base.errors import DataWarning, InputError
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene

YELLOW = 245, 215, 165
"""sRGB bytes of the lamp as captured: a wall beside a lamp has such colours, so it does not count as one."""


@cache
def yellow_box():
    """(Scene, (V,) bool of its lamp, the place of the lamp)."""
    scene, place, *_ = room()
    glowing = place.emitted.any(axis=1)
    colors = scene.colors_srgb.copy()
    colors[glowing] = YELLOW
    mesh = Mesh(scene.vertices, scene.normals, scene.faces, colors)
    at = tuple(scene.vertices[glowing].mean(axis=0).tolist())
    turned = np.eye(4)
    turned[:3, 3] = 1.0, -2.0, 3.0
    return Scene([mesh], capture=scene.capture, scene_from_splat=turned), glowing, tuple(np.subtract(at, turned[:3, 3]))


def job_of(scene, lamps):
    lighting = LightingOptions(tolerance=0.05, lamps=lamps)
    return Job(RelightRequest(scene, "captured", lighting, albedo="estimated", caching="none"))


def shaded(scene, lamps):
    job = job_of(scene, lamps)
    with pytest.warns(DataWarning, match="closed room"):
        found = next(iter(job.shaded()))
    return job, found.shading.radiance * found.exposure


@pytest.mark.slow
def test_a_lamp_that_was_pointed_at_goes_out_and_leaves_neither_glow_nor_stain():
    scene, glowing, at = yellow_box()
    captured = scene.colors_linear
    job, dark = shaded(scene, {at: 0.0})
    # The ceiling was lamp 1 before; beside the true one it cannot prove it, and is dark, but keeps its number.
    other, lamp = job.known.lamps_found
    assert job.known.appearance.room.report["pointed"] == [2] and not any(other["radiance"])
    np.testing.assert_allclose(lamp["place"], scene.vertices[glowing].mean(axis=0), atol=0.1)
    # It is the only lamp of a room without an opening.
    assert dark[~glowing].mean() < 0.05 * captured[~glowing].mean() and dark[glowing].max() < 0.05
    _, half = shaded(scene, {at: 0.5})
    unclipped = ~glowing & (captured.max(axis=1) < 0.9)
    # As of lamps that are found: half the light is half of every colour.
    np.testing.assert_allclose(half[unclipped], 0.5 * captured[unclipped], rtol=0.1, atol=0.01)


@pytest.mark.slow
def test_a_place_on_a_lamp_that_was_found_means_that_one():
    scene, place, *_ = room()
    at = scene.vertices[place.emitted.any(axis=1)].mean(axis=0)
    by_place, by_number = (shaded(scene, lamps)[1] for lamps in ({tuple(at.tolist()): 0.5}, "1=0.5"))
    np.testing.assert_allclose(by_place, by_number, rtol=1e-5, atol=1e-6)
    both = job_of(scene, {1: 0.25, tuple(at.tolist()): 0.5})
    with (
        pytest.raises(InputError, match=r"this is lamp 1, which has the factor 0\.25 already"),
        pytest.warns(DataWarning, match="closed room"),
    ):
        _ = both.room


@pytest.mark.parametrize(
    ("lamps", "message"),
    [
        ("at=90,0,0=off", "the nearest surface is"),
        ("at=FLOOR=off", "what is there was captured at"),
        ("9=off,at=LAMP", "its lamps are 1 to 2"),
    ],
)
def test_a_place_that_is_no_lamp_gets_one_line(lamps, message):
    scene, _, at = yellow_box()
    shift = scene.scene_from_splat[:3, 3]
    corner = scene.vertices[np.argmin(scene.vertices.sum(axis=1))] - shift
    text = {"FLOOR": corner, "LAMP": at}
    for word, place in text.items():
        lamps = lamps.replace(word, ",".join(f"{each:.4f}" for each in place))
    with pytest.raises(InputError, match=message), warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # of the room itself
        next(iter(job_of(scene, lamps).shaded()))


def test_a_place_belongs_to_a_closed_room():
    scene = Scene(yellow_box()[0].chunks)
    request = RelightRequest(scene, "noon", LightingOptions(lamps="at=0,1,0=off"), albedo="captured", caching="none")
    with pytest.raises(InputError, match="at=0,1,0=0: expected a closed room"):
        next(iter(Job(request).shaded()))


def test_words_for_places():
    asked = LightingOptions(lamps=" 1=off, at=1.2,2.0,-.4=0.5 ,3=keep,at=0,0,1")
    assert asked.lamps == ((1, 0.0), (3, 1.0), ((0.0, 0.0, 1.0), 0.0), ((1.2, 2.0, -0.4), 0.5))
    assert asked.pointed_at == [(0.0, 0.0, 1.0), (1.2, 2.0, -0.4)]
    assert asked.lamp_factors(4, [4, 2]) == [0.0, 0.5, 1.0, 0.0]
    assert LightingOptions(lamps={(1.2, 2, -0.4): "off"}).lamps == (((1.2, 2.0, -0.4), 0.0),)
    for wrong in ("at=1,2=off", "at=1,2,x", "at=1,2,nan=off", "at=1,2,3=dim", "at=1,2,3,at=1,2,3", {(1, 2): 0.0}):
        with pytest.raises(InputError, match="expected"):
            LightingOptions(lamps=wrong)
