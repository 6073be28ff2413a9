"""From a sample to a plan: how finely the sample is traced for what is asked, and what a plan says of itself."""

import numpy as np
import pytest
from plan_scenes import corner, occluder_of

from relight import Environment
from relight.options import LightingOptions
from relight.planning import decide
from relight.planning.choice import SAFETY
from relight.planning.sample import Sample


@pytest.fixture(scope="module")
def scene():
    return corner(8)[0]


@pytest.mark.parametrize(
    "asked,directions",
    [
        ({"tolerance": 0.5}, 1024),
        ({"tolerance": 0.03}, 1024),
        ({"tolerance": 0.0299}, 2048),
        ({"tolerance": 0.014}, 2048),
        ({"tolerance": 0.01}, 4096),
        ({"tolerance": 0.001}, 8192),
        ({"budget_s": 1.0}, 8192),  # whatever is the finest that a budget could pay for
    ],
)
def test_a_sample_is_as_fine_as_the_tolerance(scene, monkeypatch, asked, directions):
    found = []

    def sample(occluder, sizes, vertices, count, traced):
        found.append(count)
        return Sample(occluder, sizes, 32, 64, traced)

    monkeypatch.setattr(decide, "Sample", sample)
    options, light = LightingOptions(**asked), Environment.load("overcast")
    plan = decide.planned(occluder_of(scene), [len(scene.vertices)], light, options=options)
    assert found == [directions]
    assert (plan.tolerance, plan.budget_s) == (asked.get("tolerance"), asked.get("budget_s"))
    assert plan.vertices == len(plan.rows) <= 32 and plan.checked is None


def test_a_plan_is_the_candidate_that_it_was_chosen_as(scene):
    light, sizes = Environment.load("overcast"), np.array([len(scene.vertices)])
    plan = decide.planned(occluder_of(scene), sizes, light, options=LightingOptions(tolerance=0.05))
    (same,) = [each for each in plan.choice._candidates if each.settings == plan.settings]
    assert plan.error == same.error <= SAFETY * 0.05
    assert plan.seconds == same.seconds - plan.choice.found_s(plan.settings)
    assert all(each.seconds >= same.seconds for each in plan.choice._candidates if each.error <= SAFETY * 0.05)
