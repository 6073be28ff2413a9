"""From a sample to a plan: how finely the sample is traced for what is asked, and what a plan says of itself."""

import numpy as np
import pytest
from plan_scenes import corner, occluder_of

from relight import Environment
from relight.options import LightingOptions
from relight.planning import planner
from relight.planning.choice import SAFETY
from relight.planning.planner import PlannedScene
from relight.planning.sample import Sample
from relight.transfer.settings import VOLUME_DIRECTIONS


@pytest.fixture(scope="module")
def scene():
    return corner(8)[0]


@pytest.mark.parametrize(
    "asked",
    [
        {"tolerance": 0.5},
        {"tolerance": 0.001},
        {"budget_s": 1000.0},
        {"budget_s": 1e-6},
    ],
)
def test_a_sample_is_the_same_whatever_is_asked(scene, monkeypatch, asked):
    found = []

    def sample(occluder, vertices, count, traced, cache):
        found.append(count)
        return Sample(occluder, 32, 64, traced)

    monkeypatch.setattr(planner, "Sample", sample)
    options, light = LightingOptions(**asked), Environment.load("overcast")
    plan = planner.planned(PlannedScene(occluder_of(scene)), light, options)
    assert found == [planner.SAMPLE_DIRECTIONS]
    assert (plan.tolerance, plan.budget_s) == (asked.get("tolerance"), asked.get("budget_s"))
    assert plan.vertices == len(plan.rows) <= 32 and plan.checked is None


def test_a_plan_is_the_candidate_that_it_was_chosen_as(scene):
    light = Environment.load("overcast")
    plan = planner.planned(PlannedScene(occluder_of(scene)), light, LightingOptions(tolerance=0.05))
    (same,) = [each for each in plan.choice.candidates if each.settings == plan.settings]
    assert plan.error == same.error <= SAFETY * 0.05
    assert plan.seconds == same.seconds
    assert all(each.seconds >= same.seconds for each in plan.choice.candidates if each.error <= SAFETY * 0.05)


# -- leaves and grass


class Thick:
    """A Foliage of which half of all light is hidden from what is a volume: the planned choice asks nothing else."""

    def __init__(self, count, share):
        self.rows, self.probe_count, self._share = np.arange(count), 7, share

    def seen(self, rows, directions):
        return np.full(len(rows), self._share, np.float32), np.full((len(rows), len(directions)), 0.5, np.float32), 1


def test_a_plan_lists_leaves_and_the_light_they_were_chosen_for(scene):
    light, count = Environment.load("overcast"), len(scene.vertices)

    def plan(foliage, **asked):
        options = LightingOptions(**asked)
        return planner.planned(PlannedScene(occluder_of(scene), foliage=foliage), light, options)

    thick = plan(Thick(count, 1.0), tolerance=0.05)
    assert thick.settings.volume == VOLUME_DIRECTIONS and thick.settings.rays
    table = {effect: (error, decision) for effect, error, decision in thick.contributions}
    assert table["volume"][0] > 0.0
    assert table["volume"][1].startswith(f"{thick.settings.volume} directions for {count:,} vertices")
    surfaces = plan(Thick(count, 0.0), tolerance=0.05, effects="shadows,sun")
    assert surfaces.settings.volume == 0
    assert dict((effect, decision) for effect, _, decision in surfaces.contributions)["volume"] == "skipped"


def test_methods_that_trace_nothing_have_no_leaves(scene):
    light, count = Environment.load("overcast"), len(scene.vertices)
    options = LightingOptions(tolerance=0.05, method="analytic")
    plan = planner.planned(PlannedScene(occluder_of(scene), foliage=Thick(count, 1.0)), light, options)
    assert plan.settings.volume == 0 and "volume" not in [effect for effect, *_ in plan.contributions]
