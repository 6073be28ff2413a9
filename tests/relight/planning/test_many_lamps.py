"""The plan of many lamps sees the error of choosing among them: its reference takes every lamp."""

import numpy as np
import pytest

from relight.lamps.emitters import emitters_of
from relight.lamps.shapes import SphereLamp
from relight.lamps.tracing import lamplight, ordered
from relight.planning import lamp_plan
from relight.planning.lamp_plan import MANY, plan_lamps
from relight.transfer.occluder import Occluder

SIDE, LAMPS = 30, 300


@pytest.fixture(scope="module")
def street():
    """(Occluder of a floor with a ridge, Emitters above it): no lamp outshines the others."""
    x, z = np.meshgrid(np.linspace(-0.5, 0.5, SIDE), np.linspace(-0.5, 0.5, SIDE))
    height = 0.05 * (np.abs(x) < 0.05)
    vertices = np.stack([x, height, z], axis=-1).reshape(-1, 3).astype(np.float32)
    corner = np.arange(SIDE * (SIDE - 1)).reshape(SIDE - 1, SIDE)[:, :-1].ravel()
    low = np.stack([corner, corner + SIDE, corner + 1], axis=1)
    faces = np.concatenate([low, np.stack([corner + 1, corner + SIDE, corner + SIDE + 1], axis=1)])
    normals = np.tile(np.float32([0, 1, 0]), (len(vertices), 1))
    rng = np.random.default_rng(1)
    places = rng.uniform((-0.5, 0.1, -0.5), (0.5, 0.3, 0.5), (LAMPS, 3))
    lamps = [SphereLamp(tuple(place), 0.002, (5.0,) * 3) for place in places]
    return Occluder(vertices, normals, faces.astype(np.int32)), emitters_of(lamps, np.zeros(3), 1.0)


def test_every_lamp_is_the_sum_of_single_ones(street):
    occluder, emitters = street
    rows = np.arange(0, SIDE * SIDE, 41)
    every = lamplight(occluder, emitters, 8, at=ordered(occluder, rows), every=True)
    alone = sum(lamplight(occluder, emitters.of_lamp(number), 8, at=ordered(occluder, rows)) for number in range(LAMPS))
    # Rays of half-shadows differ: 8 of them to small spheres.
    np.testing.assert_allclose(every, alone, rtol=0.02)


def test_a_plan_predicts_the_error_of_the_choice_and_keeps_to_the_tolerance(street):
    occluder, emitters = street
    assert LAMPS > MANY
    nothing = np.zeros_like(occluder.origins)
    true = lamplight(occluder, emitters, 64, at=ordered(occluder, seed=7), every=True)

    def error(rays):
        return np.linalg.norm(lamplight(occluder, emitters, rays) - true) / np.linalg.norm(true)

    plan = plan_lamps(occluder, emitters, nothing, 0.03)
    assert plan.within and plan.error <= 0.03
    assert error(plan.rays) < 0.03 * 1.2  # the sample is not the scene
    few = next(step for step in plan.curve if step[2] == 8)
    assert 0.8 < few[1] / error(8) < 1.4 and error(8) > 0.03


def test_a_tolerance_that_nothing_keeps_to_is_said(street, monkeypatch):
    monkeypatch.setattr(lamp_plan, "BOUNCE_RAYS", (8, 16))
    occluder, emitters = street
    plan = plan_lamps(occluder, emitters, np.zeros_like(occluder.origins), 1e-7)
    assert not plan.within and not plan.as_dict()["within_tolerance"]
    assert any("above the tolerance" in line for line in plan.table(LAMPS))
