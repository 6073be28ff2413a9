"""Loops on all cores: every item once, whatever the number of threads, from any thread, and errors come out."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from splat2mesh.base import threads


@threads.shared
def add(begin, end, array, step):
    array[begin:end] += step


@pytest.mark.parametrize("count", [0, 1, 2, 3, 10_001])
@pytest.mark.parametrize("cores", [1, 2, 7])
def test_every_item_is_met_once(count, cores, monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: cores)
    seen = np.zeros(count, int)
    add(count, seen, 3)
    assert (seen == 3).all()


def test_many_threads_may_loop_at_once(monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: 3)
    arrays = [np.zeros(100, int) for _ in range(50)]
    with ThreadPoolExecutor(20) as pool:
        list(pool.map(lambda array: add(100, array, 1), arrays))
    assert (np.array(arrays) == 1).all()


def test_an_error_in_any_part_comes_out(monkeypatch):
    monkeypatch.setattr(threads, "cores", lambda: 3)

    def fail(begin, end):
        if end == 30:
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        threads.shared(fail)(30)
