"""The check of bounced light after the work: its error as it is, and more rays where it is too large."""

import numpy as np
import pytest
import trimesh
from plan_scenes import corner, difference, kitchen_sky, truth

from relight import Environment, Relighter
from relight.planning import costs
from relight.planning.bounce_check import MOST_ROUNDS, BouncesToCheck, bounced_error, more_rays
from relight.planning.sample import Sample
from relight.transfer.bounces import Interreflection, with_bounces
from relight.transfer.first_bounce import first_bounce
from relight.transfer.occluder import Occluder

ALBEDO = np.float32(0.5)


@pytest.fixture(scope="module")
def ball():
    ball = trimesh.creation.icosphere(4)
    vertices = np.array(ball.vertices, np.float32)
    return Occluder(vertices, -vertices, np.array(ball.faces[:, ::-1], np.int32))


@pytest.fixture(scope="module")
def sample(ball):
    return Sample(ball, [len(ball.origins)], 1500, 16)


def pool(ball, part):
    """Light on the lowest part of a ball alone."""
    low = np.quantile(ball.origins[:, 1], part)
    return np.repeat((ball.origins[:, 1] <= low).astype(np.float32)[:, None], 3, axis=1)


def lit(ball, direct, rays):
    return with_bounces(direct, np.full_like(direct, ALBEDO), Interreflection(ball, rays), 1e-6, 64)[0]


def test_even_light_has_no_error(ball, sample):
    direct = np.ones_like(ball.origins)
    assert bounced_error(sample, ALBEDO, direct, lit(ball, direct, 8), 0) < 1e-4


def test_bounces_left_out_are_an_error(ball, sample):
    # All light is 1 + .5 + .25 .. times the direct, and of what is there half is sent on and missing.
    direct = np.ones_like(ball.origins)
    assert bounced_error(sample, ALBEDO, direct, ALBEDO * direct, 0) == pytest.approx(0.5, abs=1e-3)


@pytest.mark.parametrize("rays", [8, 64])
def test_the_error_is_that_of_many_rays(ball, sample, rays):
    """Against 4,096 rays from the same vertices; the noise of 2 x 32 rays over 1,500 vertices leaves some percent."""
    direct = pool(ball, 0.1)
    radiance = lit(ball, direct, rays)
    off = radiance - ALBEDO * (direct + first_bounce(ball, radiance, 4096, seed=9))
    expected = np.linalg.norm(off) / np.linalg.norm(radiance)
    assert bounced_error(sample, ALBEDO, direct, radiance, 0) == pytest.approx(expected, rel=0.2)


def test_what_is_a_volume_is_not_judged(ball, sample):
    direct = np.ones_like(ball.origins)
    solid = sample.solid
    try:
        sample.solid = np.zeros_like(solid)
        assert bounced_error(sample, ALBEDO, direct, direct, 0) == 0.0
    finally:
        sample.solid = solid


@pytest.mark.parametrize(
    "others,found,more",
    [
        (0.0, [(16, 0.01)], None),  # within the tolerance
        (0.0, [(16, 0.0101)], 32),
        (0.0, [(16, 0.0101 * 0.042 / 0.0246)], 64),  # by the law 32 rays leave a little more than the tolerance
        (0.008, [(16, 0.0059)], None),
        (0.008, [(16, 0.0061)], 32),
        (0.03, [(16, 0.0049)], None),  # others fill the tolerance: half of it is left to bounced light
        (0.03, [(16, 0.0051)], 32),
        (0.0, [(512, 1.0)], None),  # there are no more
        (0.0, [(2048, 1.0)], None),  # nor in a matrix that is kept
        (0.0, [(16, 1.0)], None),  # no number suffices
        (0.0, [(16, 0.02), (64, 0.02)], None),  # what did not fall is no noise
        (0.0, [(16, 0.024), (32, 0.015)], 128),  # .006 is none; of the rest 128 rays leave .007
    ],
)
def test_more_rays_by_the_law_and_what_was_found(others, found, more):
    assert more_rays(BouncesToCheck(others, found), 0.01) == more


def test_rounds_end():
    assert more_rays(BouncesToCheck(0.0, (MOST_ROUNDS + 1) * [(16, 0.011)]), 0.01) is None


# -- in a plan


@pytest.fixture(scope="module")
def coloured():
    scene, part = corner(32)
    return scene, np.float32([[0.8, 0.8, 0.8], [0.8, 0.1, 0.1], [0.1, 0.7, 0.1]])[part]


def planned(coloured, light, monkeypatch, **wish):
    """(bounce rays as planned, Shading, Plan) by a law that promises a twentieth of the noise."""
    monkeypatch.setattr(costs, "BOUNCE_NOISE", {rays: noise / 20 for rays, noise in costs.BOUNCE_NOISE.items()})
    relighter = Relighter(coloured[0], **wish)
    first = relighter.plan_for(light, coloured[1]).settings
    shading = relighter.shading(light, coloured[1])
    return first.bounce_rays, shading, relighter.plan_for(light, coloured[1])


def test_rays_are_added_where_the_law_was_wrong(coloured, monkeypatch):
    light = Environment(kitchen_sky().radiance, "kitchen")
    rays, shading, plan = planned(coloured, light, monkeypatch, tolerance=0.02)
    assert rays < shading.settings.bounce_rays == plan.settings.bounce_rays
    rows = {effect: decision for effect, _, decision in plan.contributions}
    assert rows["bounces"] == f"{shading.settings.bounce_rays} rays" and plan.checked <= 0.02
    assert difference(shading.radiance, truth(coloured[0], light, coloured[1])) <= 0.022  # sampled


def test_a_budget_is_not_exceeded(coloured, monkeypatch):
    light = Environment(kitchen_sky().radiance, "kitchen")
    rays, shading, plan = planned(coloured, light, monkeypatch, budget_s=0.02)
    assert rays == shading.settings.bounce_rays and plan.checked > 0.0
