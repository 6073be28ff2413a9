"""The plan of the first bounce: none for even light, more rays for a pool of light, and errors as predicted."""

import numpy as np
import pytest
import trimesh

from relight.planning.lamp_plan import plan_first_bounce
from relight.transfer.bounces import Interreflection
from relight.transfer.first_bounce import first_bounce
from relight.transfer.occluder import Occluder


@pytest.fixture(scope="module")
def ball():
    ball = trimesh.creation.icosphere(4)
    vertices = np.array(ball.vertices, np.float32)
    return Occluder(vertices, -vertices, np.array(ball.faces[:, ::-1], np.int32))


def pool(ball, part):
    """Light on the lowest part of a ball alone."""
    low = np.quantile(ball.origins[:, 1], part)
    return np.repeat((ball.origins[:, 1] <= low).astype(np.float32)[:, None], 3, axis=1)


def test_even_light_needs_no_more_rays(ball):
    plan = plan_first_bounce(ball, np.ones_like(ball.origins), Interreflection(ball, 16), 0 * ball.origins, 0.02)
    assert plan.rays == 0 and plan.within and plan.error < 1e-3


def test_the_smaller_the_pool_the_more_rays(ball):
    matrix = Interreflection(ball, 16)
    found = [plan_first_bounce(ball, pool(ball, part), matrix, 0 * ball.origins, 0.05).rays for part in (0.5, 0.05)]
    assert found[0] < found[1]


def test_other_light_hides_the_noise(ball):
    sent, matrix = pool(ball, 0.02), Interreflection(ball, 16)
    alone = plan_first_bounce(ball, sent, matrix, 0 * ball.origins, 0.02)
    beside = plan_first_bounce(ball, sent, matrix, 10 + 0 * ball.origins, 0.02)
    assert alone.rays > beside.rays == 0


@pytest.mark.slow
def test_the_error_is_as_predicted(ball):
    """Over all vertices against 4,096 rays; the sample of 1,024 of 2,562 leaves some percent of it."""
    sent = pool(ball, 0.05)
    plan = plan_first_bounce(ball, sent, Interreflection(ball, 16), 0 * ball.origins, 0.05)
    true = first_bounce(ball, sent, 4096, seed=9)
    off = np.sqrt(np.square(first_bounce(ball, sent, plan.rays) - true).mean() / np.square(true).mean())
    assert off == pytest.approx(plan.error, rel=0.25)
    assert plan.error == plan.curve[-1][1] and plan.as_dict()["rays"] == plan.rays
