"""Placed lamps and captured light in a session: the same light as a relight of the same request writes."""

import numpy as np
import pytest
from inline_worker import InlineWorker
from viewer_scenes import ball_on_plate

from relight import LightingOptions, RelightRequest
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.viewer.session import Session

LAMP = "1.2,0.5,1.2 radius=.1 brightness=+2EV"


@pytest.mark.parametrize(
    ("env", "wishes"),
    [
        ("captured", {"captured": 0.1, "placed": (LAMP,)}),
        ("noon", {"env_scale": 0.05, "placed": (LAMP,)}),
        ("overcast", {"captured": 0.5}),
    ],
)
def test_a_session_shows_what_a_relight_gives(env, wishes):
    options = LightingOptions(tolerance=0.05, **wishes)
    job = Job(RelightRequest(ball_on_plate(), env, options, angles_deg=(0.0,), caching="none"))
    expected = next(iter(job.shaded()))
    session = Session(session_of(job), InlineWorker)
    session.finish()
    shown, wanted = session.radiance() * session.exposure(), expected.shading.radiance * expected.exposure
    # Sums of a few float32 terms, in two orders.
    assert np.allclose(shown, wanted, rtol=1e-5, atol=1e-6 * wanted.max())
    assert wanted.max() > 0.0 and session.sky_exposure() == pytest.approx(expected.exposure * expected.backdrop)
