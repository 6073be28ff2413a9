"""The check of bounced light after the work: its error as it is, and more rays where it is too large."""

import copy

import numpy as np
import pytest
import trimesh
from plan_scenes import corner, difference, kitchen_sky, truth

from relight import Environment, Relighter
from relight.planning import costs
from relight.planning.bounce_check import BounceErrors, bounce_errors, more_rays
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
    return Sample(ball, 1500, 16)


def pool(ball, part):
    """Light on the lowest part of a ball alone."""
    low = np.quantile(ball.origins[:, 1], part)
    return np.repeat((ball.origins[:, 1] <= low).astype(np.float32)[:, None], 3, axis=1)


def lit(ball, direct, rays):
    """(exit radiance, hidden share) by so many bounce rays, none of the sky seen."""
    matrix = Interreflection(ball, rays)
    return with_bounces(direct, np.full_like(direct, ALBEDO), matrix, 1e-6, 64)[0], matrix.hidden


def test_even_light_has_no_error(ball, sample):
    direct = np.ones_like(ball.origins)
    assert max(bounce_errors(sample, ALBEDO, direct, *lit(ball, direct, 8), 0)) < 1e-4


def test_bounces_left_out_are_an_error(ball, sample):
    # Half of the light that is there is sent on, and missing.
    direct, hidden = np.ones_like(ball.origins), np.ones(len(ball.origins), np.float32)
    found = bounce_errors(sample, ALBEDO, direct, ALBEDO * direct, hidden, 0)
    assert found == pytest.approx((0.5, 0.5), abs=1e-3)


@pytest.mark.parametrize("rays", [8, 64])
def test_the_error_is_that_of_many_rays(ball, sample, rays):
    """Against 4,096 rays from the same vertices; the noise of 2 x 32 rays over 1,500 vertices leaves some percent."""
    direct = pool(ball, 0.1)
    radiance, hidden = lit(ball, direct, rays)
    off = radiance - ALBEDO * (direct + first_bounce(ball, radiance, 4096, seed=9))
    expected = np.linalg.norm(off) / np.linalg.norm(radiance)
    found = bounce_errors(sample, ALBEDO, direct, radiance, hidden, 0)
    assert found == pytest.approx((expected, expected), rel=0.2)


def test_more_rays_do_not_mend_what_scales_them(ball, sample):
    """Nine tenths of the light: a tenth is missing, and none of it is noise. A volume may well hide as much."""
    direct, hidden = np.ones_like(ball.origins), np.full(len(ball.origins), 0.9, np.float32)
    radiance = ALBEDO * direct / (1.0 - ALBEDO * 0.9)
    found = bounce_errors(sample, ALBEDO, direct, radiance, hidden, 0)
    assert found == pytest.approx((0.05, 0.0), abs=1e-4)
    leaves = copy.copy(sample)
    leaves.solid = np.full_like(sample.solid, 0.5)
    assert bounce_errors(leaves, ALBEDO, direct, radiance, hidden, 0) == pytest.approx((0.0, 0.0), abs=1e-4)


@pytest.mark.parametrize(
    "others,rays,whole,noise,more",
    [
        (0.0, 16, 0.01, 0.01, None),  # within the tolerance
        (0.0, 16, 0.0101, 0.0101, 32),
        (0.0, 16, 0.0101 * 0.042 / 0.0246, 0.02, 64),  # by the law 32 rays leave a little more than the tolerance
        (0.008, 16, 0.0059, 0.0059, None),
        (0.008, 16, 0.0061, 0.0061, 32),
        (0.03, 16, 0.0049, 0.0049, None),  # others fill the tolerance: half of it is left to bounced light
        (0.03, 16, 0.0051, 0.0051, 32),
        (0.0, 512, 1.0, 1.0, None),  # there are no more
        (0.0, 2048, 1.0, 1.0, None),  # nor in a matrix that is kept
        (0.0, 16, 1.0, 1.0, None),  # no number suffices
        (0.0, 16, 0.02, 0.016, None),  # what is left without noise is too much
        (0.0, 16, 0.015, 0.012, 128),  # .009 is no noise; of the other .012, 64 rays leave .005, 128 .0036
    ],
)
def test_more_rays_by_the_law_and_what_was_found(others, rays, whole, noise, more):
    assert more_rays(rays, BounceErrors(whole, noise), others, 0.01) == more


# -- the vertices that are compared


def test_bright_vertices_are_among_those_compared(ball, sample):
    """Ten of 2,562 have all of the light and are all taken, so nothing of it is left to chance."""
    light, bright = np.zeros(len(ball.origins)), np.random.default_rng(1).choice(len(ball.origins), 10, replace=False)
    light[bright] = np.linspace(1.0, 2.0, 10)
    every = sample.wider(len(ball.origins))
    found = every.lit(200, np.square(light[every.rows]))
    assert len(np.unique(found.rows)) == len(found.rows) <= 200 and set(bright) <= set(found.rows)
    np.testing.assert_array_equal(found.normals, ball.normals[found.rows])
    assert found.mean_square(light[found.rows, None]) == pytest.approx(np.square(light).mean(), rel=1e-9)
    assert found.weights.sum() == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("level", [0.0, 2.0])
def test_even_light_or_none_takes_even_vertices(ball, sample, level):
    every = sample.wider(len(ball.origins))
    found = every.lit(200, np.full(len(every.rows), level))
    np.testing.assert_allclose(found.weights, 1.0 / 200)
    assert len(np.unique(found.rows)) == len(found.rows) == 200


# -- in a plan


@pytest.fixture(scope="module")
def coloured():
    scene, part = corner(32)
    return scene, np.float32([[0.8, 0.8, 0.8], [0.8, 0.1, 0.1], [0.1, 0.7, 0.1]])[part]


def planned(coloured, light, monkeypatch, **wish):
    """(bounce rays as planned, Shading, Plan) by a law that promises a twentieth of the noise."""
    law = costs.bounce_noise
    monkeypatch.setattr(costs, "bounce_noise", lambda rays: law(rays) / 20)
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
