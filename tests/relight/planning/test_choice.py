"""What is chosen among candidates, by closed forms; and that nothing of it outlives its use."""

import gc
import time
import weakref

import numpy as np
import pytest
from plan_scenes import corner, sphere

from relight import Environment, LightingOptions, Relighter
from relight.light.sun_split import ENOUGH
from relight.planning.choice import SAFETY, Candidate, best_of, curve_of
from relight.transfer.settings import Settings
from splat2mesh.scene.mesh import Mesh
from splat2mesh.scene.scene import Scene


def candidates(rows):
    """Rows of (seconds, error), each with as many bands as its place in the list."""
    return [Candidate(*row, Settings("analytic", bands)) for bands, row in enumerate(rows)]


@pytest.mark.parametrize(
    "rows,best",
    [
        ([(3.0, 0.1), (1.0, 0.9), (2.0, 0.2)], 1),  # the quickest of those within the target
        ([(0.5, 1.2), (2.0, 1.0)], 1),  # too far off, however quick
        ([(2.0, 0.5), (1.0, 0.5), (1.0, 0.4), (1.0, 0.4)], 2),  # the more exact of two as quick; the first of equals
        ([(1.0, 2.01 * ENOUGH), (5.0, 2.0), (3.0, 1.99 * ENOUGH)], 2),  # none within: quick, and near the least
    ],
)
def test_a_tolerance_takes_the_quickest(rows, best):
    assert best_of(candidates(rows), 1.0 / SAFETY).settings.bands == best


@pytest.mark.parametrize("seed", range(20))
def test_a_looser_tolerance_takes_no_more_time_whatever_the_candidates(seed):
    rows = candidates(np.random.default_rng(seed).lognormal(size=(30, 2)))
    chosen = [best_of(rows, tolerance).seconds for tolerance in np.geomspace(0.01, 10.0, 100)]
    assert (np.diff(chosen) <= 0.0).all()


@pytest.mark.parametrize(
    "rows,best",
    [
        ([(1.0, 0.5), (2.0, 0.1), (3.0, 0.01)], 1),  # the most exact that can be paid
        ([(2.0, 0.1), (1.0, 0.1), (1.0, 0.1)], 1),  # the quicker of two as exact; the first of equals
        ([(5.0, 0.1), (4.0, 0.9), (4.0, 0.8)], 2),  # none can be paid: the quickest
    ],
)
def test_a_budget_takes_the_most_exact(rows, best):
    assert best_of(candidates(rows), 1.0, time.perf_counter() + 2.5).settings.bands == best


def test_a_curve_leaves_out_what_a_quicker_one_nearly_equals():
    rows = [(4.0, 0.2), (1.0, 1.0), (2.0, 0.98), (3.0, 0.96), (5.0, 0.5)]
    curve = curve_of(candidates(rows))
    assert [type(step) for step in curve] == 3 * [tuple]
    assert curve == [(1.0, 1.0, Settings("analytic", 1)), (3.0, 0.96, Settings("analytic", 3)), (4.0, 0.2, curve[2][2])]


@pytest.mark.parametrize("settled", [False, True])
def test_what_was_traced_for_a_plan_goes_with_it(settled):
    relighter, light = Relighter(corner(8)[0], tolerance=0.1), Environment.load("noon")
    gc.collect()
    gc.disable()
    try:
        plan = relighter.plan_for(light)
        if settled:
            relighter.shading(light)
        held = [weakref.ref(each) for each in (plan, plan.choice, relighter.precomputed, relighter.occluder, relighter)]
        del plan, relighter
        assert [each() for each in held] == 5 * [None]
    finally:
        gc.enable()


@pytest.mark.parametrize("wish", [{}, {"tolerance": 0.05}, {"budget_s": 60.0}, {"tolerance": 0.05, "rays": 16}])
def test_rays_that_were_requested_are_traced_where_no_shadow_needs_them(wish):
    relighter = Relighter(sphere(), LightingOptions.of("raytraced", **wish).planned())
    plan = relighter.plan_for(Environment.load("overcast"))
    assert plan.settings.method == "raytraced"
    assert plan.settings.rays == wish.get("rays", plan.settings.rays) > 0
    assert plan.error < 0.05


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("scene,traced", [(sphere(), False), (corner(8)[0], True)])
@pytest.mark.parametrize("method", ["auto", "raytraced"])
def test_a_chunk_without_vertices_changes_no_plan(scene, traced, method):
    nothing = Mesh(np.zeros((0, 3), "f4"), np.zeros((0, 3), "f4"), np.zeros((0, 3), "i4"), np.zeros((0, 3), "u1"))
    options = LightingOptions.of(method, tolerance=0.05)
    plans = [
        Relighter(Scene(chunks), options).plan_for(Environment.load("overcast"))
        for chunks in ([*scene.chunks, nothing], [nothing, *scene.chunks], scene.chunks)
    ]
    assert {plan.settings.rays > 0 for plan in plans} == {traced or method == "raytraced"}
    assert [plan.error for plan in plans] == pytest.approx(3 * [plans[-1].error], rel=0.2)  # other rows of the sample
