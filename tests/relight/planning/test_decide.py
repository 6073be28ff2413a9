"""From a sample to a plan: how finely the sample is traced for what is asked, and what a plan says of itself."""

import numpy as np
import pytest
from plan_scenes import corner, difference, occluder_of, truth

from relight import Environment, Relighter
from relight.options import LightingOptions
from relight.planning import planner, unmeasured
from relight.planning.choice import SAFETY
from relight.planning.plan import Plan
from relight.planning.sample import PlannedScene, Sample
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


# -- without a sample


@pytest.mark.parametrize("tolerance,bands", [(0.05, 8), (0.016, 8), (0.0159, 10), (0.0095, 10), (0.0094, None)])
def test_few_vertices_take_everything_without_a_sample(scene, monkeypatch, tolerance, bands):
    monkeypatch.setattr(unmeasured, "UNMEASURED_VERTICES", len(scene.vertices))
    white = PlannedScene(occluder_of(scene))
    plan = unmeasured.unmeasured(white, LightingOptions(tolerance=tolerance))
    if bands is None:
        assert plan is None
        return
    assert plan.settings.bands == bands and plan.settings.bounce_rays == 0 < plan.settings.sun_tolerance
    assert plan.error <= tolerance and plan.rays == 0 and plan.seconds > 0.0
    assert (plan.seconds, plan.error, plan.settings) in plan.curve
    assert Plan.from_dict(plan.as_dict()).settings == plan.settings and "not measured" in plan.table()[1]
    looser = unmeasured.unmeasured(white, LightingOptions(tolerance=2.0 * tolerance))
    assert looser.settings.rays <= plan.settings.rays
    grey = PlannedScene(white.occluder, np.full(scene.vertices.shape, 0.5, np.float32))
    assert unmeasured.unmeasured(grey, LightingOptions(tolerance=tolerance)).settings.bounce_rays > 0
    for asked in ({"bands": 4}, {"rays": 8}, {"effects": "shadows"}, {"method": "raytraced"}):
        assert unmeasured.unmeasured(white, LightingOptions(tolerance=tolerance, **asked)) is None
    assert unmeasured.unmeasured(white, LightingOptions(budget_s=1e-9)).settings.bands == 8  # the quickest
    assert unmeasured.unmeasured(white, LightingOptions(budget_s=1000.0)).settings.bands == 10  # the finest
    monkeypatch.setattr(unmeasured, "UNMEASURED_VERTICES", len(scene.vertices) - 1)
    assert unmeasured.unmeasured(white, LightingOptions(tolerance=tolerance)) is None


@pytest.mark.parametrize("tolerance", [0.05, 0.01])
@pytest.mark.parametrize("sky", ["noon", "overcast"])
def test_what_is_taken_without_a_sample_is_within_the_tolerance(scene, monkeypatch, tolerance, sky):
    monkeypatch.setattr(unmeasured, "UNMEASURED_VERTICES", len(scene.vertices))
    albedo, light = np.full(scene.vertices.shape, 0.5, np.float32), Environment.load(sky)
    relighter = Relighter(scene, tolerance=tolerance)
    shading = relighter.shading(light, albedo)
    plan = relighter.plan_for(light, albedo)
    assert plan.rays == 0 and plan.checked is None and shading.settings == plan.settings
    assert difference(shading.radiance, truth(scene, light, albedo)) <= tolerance


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
