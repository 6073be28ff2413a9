"""From a sample to a plan: how finely the sample is traced for what is asked, and what a plan says of itself."""

import numpy as np
import pytest
from plan_scenes import corner, occluder_of

from relight import Environment
from relight.options import LightingOptions
from relight.planning import decide
from relight.planning.choice import SAFETY, SKIPPED
from relight.planning.decide import VOLUME_PART, PlannedScene, leaves_for
from relight.planning.sample import Sample
from relight.transfer.volume import DIRECTIONS, noise


@pytest.fixture(scope="module")
def scene():
    return corner(8)[0]


@pytest.mark.parametrize(
    "asked,directions",
    [
        ({"tolerance": 0.5}, 1024),
        ({"tolerance": 0.03}, 1024),
        ({"tolerance": 0.0279}, 2048),
        ({"tolerance": 0.014}, 2048),
        ({"tolerance": 0.01}, 4096),
        ({"tolerance": 0.001}, 8192),
        ({"budget_s": 1.0}, 8192),  # whatever is the finest that a budget could pay for
    ],
)
def test_a_sample_is_as_fine_as_the_tolerance(scene, monkeypatch, asked, directions):
    found = []

    def sample(occluder, sizes, vertices, count, traced, cache):
        found.append(count)
        return Sample(occluder, sizes, 32, 64, traced)

    monkeypatch.setattr(decide, "Sample", sample)
    options, light = LightingOptions(**asked), Environment.load("overcast")
    plan = decide.planned(PlannedScene(occluder_of(scene), [len(scene.vertices)]), light, options)
    assert found == [directions]
    assert (plan.tolerance, plan.budget_s) == (asked.get("tolerance"), asked.get("budget_s"))
    assert plan.vertices == len(plan.rows) <= 32 and plan.checked is None


def test_a_plan_is_the_candidate_that_it_was_chosen_as(scene):
    light, sizes = Environment.load("overcast"), np.array([len(scene.vertices)])
    plan = decide.planned(PlannedScene(occluder_of(scene), sizes), light, LightingOptions(tolerance=0.05))
    (same,) = [each for each in plan.choice._candidates if each.settings == plan.settings]
    assert plan.error == same.error <= SAFETY * 0.05
    assert plan.seconds == same.seconds - plan.choice.found_s(plan.settings)
    assert all(each.seconds >= same.seconds for each in plan.choice._candidates if each.error <= SAFETY * 0.05)


# -- leaves and grass

LEAST, MOST = min(DIRECTIONS), max(DIRECTIONS)


@pytest.mark.parametrize("count", DIRECTIONS)
def test_leaves_have_as_few_directions_as_the_tolerance_allows(count):
    wish = 0.02
    leafy = VOLUME_PART * wish / noise(count)  # whose noise is just within its part
    found = leaves_for(1.0, 0.999 * leafy, wish, None, 0.5, 40)
    assert found == (count, 1.0, 0.5 * count, 40, pytest.approx(0.999 * VOLUME_PART * wish))
    finer = leaves_for(1.0, 1.001 * leafy, wish, None, 0.5, 40)
    assert finer.directions == min((other for other in DIRECTIONS if other > count), default=MOST)
    assert finer.lost == pytest.approx(noise(finer.directions) * 1.001 * leafy)


def test_where_no_number_of_directions_is_enough_the_most_are_taken():
    found = leaves_for(1.0, 1.0, 1e-6, None, 0.5, 40)
    assert (found.directions, found.lost, found.seconds) == (MOST, noise(MOST), 0.5 * MOST)


def test_leaves_that_cost_little_as_surfaces_stay_surfaces():
    wish = 0.02
    assert leaves_for(SKIPPED * wish, 1.0, wish, None, 0.5, 40) == (0, SKIPPED * wish, 0.0, 40, SKIPPED * wish)
    assert leaves_for(1.001 * SKIPPED * wish, 0.0, wish, None, 0.5, 40).directions == LEAST


@pytest.mark.parametrize("error", [0.0, 1.0])
def test_effects_that_are_asked_for_decide_on_leaves(error):
    assert leaves_for(error, 0.0, 0.02, frozenset({"shadows", "volume"}), 0.5, 40).directions == LEAST
    assert leaves_for(error, 0.0, 0.02, frozenset({"shadows"}), 0.5, 40) == (0, error, 0.0, 40, error)


class Thick:
    """A Foliage of which half of all light is hidden from what is a volume: the planned choice asks nothing else."""

    def __init__(self, count, share):
        self.rows, self.probe_count, self._share = np.arange(count), 7, share

    def seen(self, rows, directions):
        return np.full(len(rows), self._share, np.float32), np.full((len(rows), len(directions)), 0.5, np.float32), 1


def test_a_plan_lists_leaves_and_the_light_they_were_chosen_for(scene):
    light, sizes = Environment.load("overcast"), [len(scene.vertices)]

    def plan(foliage, **asked):
        options = LightingOptions(**asked)
        return decide.planned(PlannedScene(occluder_of(scene), sizes, foliage=foliage), light, options)

    thick = plan(Thick(sizes[0], 1.0), tolerance=0.05)
    assert thick.settings.volume in DIRECTIONS and thick.settings.rays
    table = {effect: (error, decision) for effect, error, decision in thick.contributions}
    assert table["volume"][0] > SKIPPED * 0.05
    assert table["volume"][1].startswith(f"{thick.settings.volume} directions for {sizes[0]:,} vertices")
    surfaces = plan(Thick(sizes[0], 0.0), tolerance=0.05)  # a volume of nothing
    assert surfaces.settings == plan(None, tolerance=0.05).settings and surfaces.settings.volume == 0
    assert dict((effect, decision) for effect, _, decision in surfaces.contributions)["volume"] == "skipped"


def test_methods_that_trace_nothing_have_no_leaves(scene):
    light, sizes = Environment.load("overcast"), [len(scene.vertices)]
    options = LightingOptions(tolerance=0.05, method="analytic")
    plan = decide.planned(PlannedScene(occluder_of(scene), sizes, foliage=Thick(sizes[0], 1.0)), light, options)
    assert plan.settings.volume == 0 and "volume" not in [effect for effect, *_ in plan.contributions]
