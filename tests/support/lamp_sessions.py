"""Sessions whose lamps can be changed, and the relight that they are compared with."""

from inline_worker import InlineWorker
from viewer_scenes import Clock

from relight import LightingOptions, RelightRequest
from relight.jobs.job import Job
from relight.jobs.session import session_of
from relight.viewer.session import Session


def job_of(scene, env, **wishes):
    options = LightingOptions(tolerance=0.05, **wishes)
    return Job(RelightRequest(scene, env, options, angles_deg=(0.0,), caching="none"))


def open_session(scene, env="captured", **wishes):
    """The Session of a request, for which no time passes."""
    return Session(session_of(job_of(scene, env, **wishes)), InlineWorker, Clock())


def warm(session):
    """All is there that the first change needs."""
    session.bench.prepare()
    while not session.bench.ready:
        session.poll()


def at_once(session):
    """The quick light of a change, which shows before the exact one."""
    bench = session.bench
    while bench.shown.state != session.lamps.state:
        bench.poll(False)
    return session.radiance()


def relit(scene, env, path, captured):
    """What `relight --lamp` gives of a file."""
    placed = (str(path),) if path is not None else ()
    return next(iter(job_of(scene, env, captured=captured, placed=placed).shaded())).shading.radiance
