"""Work beside other work: the same results and errors as without, once, and over when its context is."""

import threading

import pytest

from splat2mesh.base import beside
from splat2mesh.base.beside import Beside


@pytest.fixture(params=[1, 2])
def cores(request, monkeypatch):
    monkeypatch.setattr(beside, "all_cores", lambda: request.param)
    return request.param


def test_the_result_is_that_of_the_function_which_runs_once(cores):
    calls = []
    work = Beside(lambda: calls.append(1) or len(calls))
    assert [work.result(), work.result()] == [1, 1]


def test_an_error_is_raised_when_the_result_is_asked_for_each_time(cores):
    work = Beside(lambda: 1 // 0)
    for _ in range(2):
        with pytest.raises(ZeroDivisionError):
            work.result()


def test_whoever_asks_for_work_that_has_not_begun_does_it_and_waits_for_no_other(monkeypatch):
    monkeypatch.setattr(beside, "all_cores", lambda: 2)
    held = threading.Event()
    first = Beside(lambda: held.wait(60))
    second = Beside(threading.current_thread)
    assert second.result() is threading.current_thread()
    held.set()
    assert first.result()


def test_begun_work_is_over_when_its_context_is_and_other_work_is_not_begun_at_all(monkeypatch):
    monkeypatch.setattr(beside, "all_cores", lambda: 2)
    begun, go, done = threading.Event(), threading.Event(), []

    def work():
        begun.set()
        go.wait(60)
        done.append("first")

    with pytest.raises(KeyError), Beside(work), Beside(lambda: done.append("second")):
        begun.wait(60)
        threading.Timer(0.05, go.set).start()
        raise KeyError("of other work")
    assert done == ["first"]
