"""Lamps that are changed in a session: the light that settles is a relight's, and undo shows it to the bit."""

import json
from threading import Event
from types import SimpleNamespace

import numpy as np
import pytest
from inline_worker import InlineWorker
from lamp_sessions import at_once, open_session, relit, warm
from viewer_scenes import ball_on_plate

from relight.engine.light_mix import LightBeside
from relight.lamps.asked import AskedLamp, Brightness, LampScale
from relight.lamps.shapes import SphereLamp
from relight.viewer.lamps import DARK, LampBench, LampBoard
from relight.viewer.lighting import SPARE
from relight.viewer.request import LampSource, SessionRequest
from relight.viewer.session import Session
from splat2mesh.base.errors import InputError

LAMP = "1.2,0.5,1.2 radius=.1 brightness=+2EV"


@pytest.fixture(scope="module")
def scene():
    return ball_on_plate()


@pytest.fixture
def opened(scene):
    """Open the session of a request; all are closed in the end."""
    sessions = []

    def open_one(env="captured", **wishes):
        sessions.append(open_session(scene, env, **wishes))
        sessions[-1].finish()
        return sessions[-1]

    yield open_one
    for session in sessions:
        session.close()


# What settles


@pytest.mark.parametrize("env", ["captured", "noon"])
def test_the_light_that_settles_is_that_of_the_saved_lamps(scene, opened, tmp_path, env):
    session = opened(env, placed=(LAMP,), captured=0.5)
    first = session.radiance()
    session.bench.prepare()
    added = session.lamps.add("-1.2,0.6,0.3 color=blue")
    session.lamps.move(1, (0.9, 0.8, -1.1))
    session.lamps.change(added, color="3000K", stops=1.0)
    session.lamps.dim(0.2)
    session.finish()
    session.lamps.save(tmp_path / "lamps.json")
    expected = relit(scene, env, tmp_path / "lamps.json", 0.2)
    if env == "captured":
        assert np.array_equal(session.radiance(), expected)
    else:  # sums of a few float32 terms, in two orders
        assert np.allclose(session.radiance(), expected, rtol=1e-5, atol=1e-6 * expected.max())
    assert np.abs(session.radiance() - first).max() > 0.1 * first.max()
    assert json.loads((tmp_path / "lamps.json").read_text())["about"].endswith("--captured 0.2 --lamp lamps.json")


def test_a_session_without_lamps_gets_some(scene, opened, tmp_path):
    session = opened("noon")
    alone = session.radiance()
    number = session.lamps.add(LAMP)
    session.finish()
    session.lamps.save(tmp_path / "lamps.json")
    expected = relit(scene, "noon", tmp_path / "lamps.json", 0.0)
    assert np.allclose(session.radiance(), expected, rtol=1e-5, atol=1e-6 * expected.max())
    session.change(albedo="white")  # for which no lamps are known
    session.finish()
    assert session.mixture is None
    session.change(albedo="captured")
    session.lamps.remove(number)
    session.finish()
    assert np.allclose(session.radiance(), alone, rtol=1e-6)
    session.timeline.undo(), session.timeline.undo()
    session.finish()
    assert np.array_equal(session.radiance(), alone)


def test_undo_and_redo_show_the_same_bits_at_once(opened):
    session = opened(placed=(LAMP,), captured=0.5)
    steps = [
        lambda: session.lamps.add("0,1.5,0"),
        lambda: session.lamps.move(2, (0.3, 1.2, 0.4)),
        lambda: session.lamps.change(2, color="red"),
        lambda: session.lamps.change(1, brightness="0EV"),
        lambda: session.lamps.dim(0.0),
        lambda: session.lamps.remove(1),
    ]
    seen = [session.radiance()]
    for step in steps:
        step()
        session.finish()
        seen.append(session.radiance())
        assert not np.array_equal(seen[-1], seen[-2])
    assert len(steps) < SPARE
    for expected in reversed(seen[:-1]):
        assert session.timeline.undo() and session.complete
        assert np.array_equal(session.radiance(), expected)
    assert not session.timeline.undo()
    for expected in seen[1:]:
        assert session.timeline.redo() and session.complete
        assert np.array_equal(session.radiance(), expected)
    assert not session.timeline.redo()


def test_light_that_was_forgotten_is_found_again_to_the_bit(opened):
    session = opened(placed=(LAMP,), captured=0.5)
    number = session.lamps.add("0,1.5,0")
    session.finish()
    expected = session.radiance()
    for step in range(SPARE + 1):
        session.lamps.move(number, (0.1 * step, 1.2, 0.4))
        session.finish()
    while session.timeline._at > 1:
        session.timeline.undo()
    assert not session.complete
    session.finish()
    assert np.array_equal(session.radiance(), expected)


# What shows at once


def test_a_change_shows_before_it_settles(opened):
    session = opened(placed=(LAMP,), captured=0.1)
    warm(session)
    before = session.radiance()
    for act, share in (
        (lambda: session.lamps.add("-1.2,0.6,0.3 radius=.02 brightness=+3EV"), 0.4),  # all but bounces, soft shadows
        (lambda: session.lamps.change(1, stops=1.0), 0.4),
        (lambda: session.lamps.dim(0.7), 1e-3),
    ):
        act()
        assert not session.complete and session.waiting_for == "the light of the lamps"
        quick = at_once(session)
        assert not session.complete and True not in session.bench._running  # too early: the hand may still move
        session.finish()
        full = session.radiance()
        assert np.linalg.norm(quick - full) < share * np.linalg.norm(before - full)
        before = full


# A scene by hand: each lamp lights all vertices by its intensity, and bounces bring as much again


class Counted:
    """A LampSource by hand. traced: the numbers of lamps of what was traced, one after another."""

    def __init__(self, hold=None, broken=""):
        self.traced, self.glimpsed, self._hold, self._broken = [], 0, hold, broken

    def source(self, asked=(), captured=1.0):
        nothing = np.zeros((2, 3), np.float32)

        def beside(level, factor, placed):
            radiance = nothing + np.float32(factor) + (0.0 if placed is None else placed.radiance)
            return LightBeside(radiance, radiance, 1.0, 1.0, 1.0, False)

        def light_of(lamps, factor):
            return Tracer(self, [np.array(each.shape.intensity) * each.brightness.value * each.color for each in lamps])

        parts = {"asked_lamps": asked, "captured_factor": captured, "scale": LampScale(1.0, 1.0)}
        return LampSource(SimpleNamespace(light_of=light_of, beside=beside, **parts), lambda: 1.0)

    def direct(self, lights):
        self.traced.append(len(lights))
        if self._hold is not None:
            self._hold.wait()
        if self._broken:
            raise InputError(self._broken)
        return np.full((2, 3), sum(lights), np.float32) if lights else np.zeros((2, 3), np.float32)


class Tracer:
    def __init__(self, counted, lights):
        self._counted, self._lights = counted, lights
        self.emitters = SimpleNamespace(color=np.reshape(lights, (-1, 3)))

    def glimpse(self):
        self._counted.glimpsed += 1
        return np.full((2, 3), 0.9 * sum(self._lights), np.float32) if self._lights else np.zeros((2, 3), np.float32)

    def direct_of(self, *lamps, advance=lambda count: None):
        advance(1)
        found = self._counted.direct([self._lights[lamp] for lamp in lamps])
        advance(1)
        return found

    def without_bounces(self, direct):
        return LightBeside(direct, direct, 1.0, 1.0, 1.0, False)

    def with_bounces(self, direct):
        return LightBeside(2.0 * direct, 2.0 * direct, 1.0, 1.0, 1.0, False)


def point(x=0.0, light=(1.0, 1.0, 1.0), value=1.0):
    return AskedLamp(SphereLamp((x, 0.0, 0.0), intensity=light), Brightness(value, "picture"))


def bench_of(counted, *lamps, captured=0.0):
    source = counted.source(lamps, captured)
    board = LampBoard(lamps, captured)
    lit = Tracer(counted, [np.array(each.shape.intensity) for each in lamps])
    first = lit.with_bounces(np.full((2, 3), sum(lit._lights), np.float32)) if lamps else None
    bench = LampBench(source, board, source.mixture(captured, first))
    bench.prepare()
    while not bench.ready:
        pass
    counted.glimpsed = 0
    return bench, board


def settle(bench):
    while bench._running or not (bench.settled or bench.failure):
        bench.poll(True)


def quick(bench, board):
    while bench.shown.state != board.state:
        bench.poll(False)
    return bench.mixture().radiance


def test_only_what_changes_is_traced_at_once(tmp_path):
    counted = Counted()
    bench, board = bench_of(counted, point(1.0), point(2.0), point(3.0))
    board.move(2, (5.0, 0.0, 0.0))
    assert np.allclose(quick(bench, board), 6.0) and counted.glimpsed == 2  # where it was, and where it is
    assert not counted.traced
    settle(bench)
    assert counted.traced == [3] and np.allclose(bench.mixture().radiance, 6.0)
    board.put(2, point(5.0, value=3.0))
    assert np.allclose(quick(bench, board), 6.0 + 0.9 * 2.0) and counted.glimpsed == 3
    settle(bench)
    assert np.allclose(bench.mixture().radiance, 10.0)
    bench.close()


def test_a_lamp_that_goes_out_leaves_no_light_and_is_not_in_a_wall():
    counted = Counted()
    bench, board = bench_of(counted, point(1.0, value=4.0))
    for value, expected in ((0.0, 0.0), (2.0, 4.0)):
        board.put(1, point(1.0, value=value))
        assert (quick(bench, board) >= 0.0).all()
        settle(bench)
        assert np.allclose(bench.mixture().radiance, expected) and not bench.message
    bench.close()


def test_what_comes_too_late_is_dropped():
    hold = Event()
    counted = Counted(hold)
    source = counted.source((), 0.0)
    board = LampBoard((), 0.0)
    bench = LampBench(source, board, None)
    number = board.add(point(1.0, value=1.0))
    bench.poll(True)
    while not counted.traced:
        pass
    board.put(number, point(2.0, value=5.0))  # while the first is being traced
    bench.poll(False)
    hold.set()
    settle(bench)
    assert np.allclose(bench.mixture().radiance, 10.0)
    board.timeline.undo()
    assert not bench.settled  # the first was never finished
    settle(bench)
    assert np.allclose(bench.mixture().radiance, 2.0)
    bench.close()


def test_lamps_that_light_nothing_are_reported():
    counted = Counted()
    counted.direct = lambda lights: np.zeros((2, 3), np.float32)
    bench, board = bench_of(counted)
    board.add(point(1.0))
    settle(bench)
    assert bench.message == DARK
    board.timeline.undo()
    assert bench.message == ""
    bench.close()


def test_light_that_cannot_be_found_is_reported_until_something_changes():
    counted = Counted(broken="it is too dark")
    source = counted.source((), 0.0)
    board = LampBoard((), 0.0)
    bench = LampBench(source, board, None)
    board.add(point(1.0))
    settle(bench)
    assert bench.failure == bench.message == "it is too dark" and not bench.settled
    board.timeline.undo()
    assert bench.failure == "" and bench.settled
    bench.close()


# Hard cases


@pytest.mark.parametrize(
    "lamp",
    [
        "0,0.1,0 radius=.01",  # within the ball
        "0,0.9,0",  # in its surface
        "1.2,0.5,1.2 radius=0",
        "1e6,0,0",
        "0,-50,0 radius=40",  # all of the scene in its light
        "1.2,0.5,1.2 brightness=+20EV",
        "1.2,0.5,1.2 brightness=-40EV",
        "rectangle:0,-1.3,0 normal=0,1,0 width=1 height=1",  # within the plate
        "tube:-9,0.9,0 to=9,0.9,0",
    ],
)
def test_lamps_anywhere_give_finite_light_that_settles_as_a_relight(scene, opened, tmp_path, lamp):
    session = opened(captured=0.1)
    warm(session)
    session.lamps.add(lamp)
    assert np.isfinite(at_once(session)).all()
    session.finish()
    session.lamps.save(tmp_path / "lamps.json")
    assert np.isfinite(session.radiance()).all() and (session.radiance() >= 0.0).all()
    with pytest.warns() if session.bench.message else np.errstate():
        expected = relit(scene, "captured", tmp_path / "lamps.json", 0.1)
    assert np.array_equal(session.radiance(), expected)


def test_unusable_lamps_are_refused(scene, opened, tmp_path):
    session = opened(captured=0.5)
    for act in (
        lambda: session.lamps.add("lamp"),
        lambda: session.lamps.add(7),
        lambda: session.lamps.add("1.2,0.5,1.2 brightness=+40EV"),
        lambda: session.lamps.move(3, (0.0, 0.0, 0.0)),
        lambda: session.lamps.dim(np.nan),
        lambda: session.lamps.save(tmp_path / "lamps.json"),
    ):
        with pytest.raises(InputError):
            act()
    number = session.lamps.add(LAMP)
    for changes in ({"color": "guessed"}, {"brightness": "bright"}, {"stops": np.inf}, {"stops": 39.0}, {"name": ""}):
        with pytest.raises(InputError):
            session.lamps.change(number, **changes)
    assert session.timeline._at == 1
    plain = Session(SessionRequest.of(scene, "noon", tolerance=0.05), InlineWorker)
    assert plain.lamps is None
    plain.close()
