"""Loops on all cores: every item once, whatever the number of threads, from any thread, and errors come out."""

import threading
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
    monkeypatch.setattr(threads, "all_cores", lambda: cores)
    seen, calls = np.zeros(count, int), []
    add(count, seen, 3)
    assert (seen == 3).all()

    def kernel(begin, end):
        seen[begin:end] += 1
        calls.append((begin, end))

    threads.in_slices(kernel, count)
    assert (seen == 4).all()
    assert len(calls) == max(min(cores, count), 1)


def test_many_threads_may_loop_at_once(monkeypatch):
    monkeypatch.setattr(threads, "all_cores", lambda: 3)
    arrays = [np.zeros(100, int) for _ in range(50)]
    with ThreadPoolExecutor(20) as pool:
        list(pool.map(lambda array: add(100, array, 1), arrays))
    assert (np.array(arrays) == 1).all()


def test_results_come_in_order_on_any_number_of_threads():
    for workers in (None, 1, 7):
        assert list(threads.in_order(pow, range(50), [2] * 50, workers=workers)) == [n * n for n in range(50)]


def test_a_thread_of_the_pool_never_waits_for_another(monkeypatch):
    """Kernels inside of what runs on all threads: with a pool that waits for itself this would never end."""
    monkeypatch.setattr(threads, "all_cores", lambda: 7)

    def work(item):
        out = np.zeros(4096)
        names = set()

        def kernel(begin, end):
            names.add(threading.current_thread().name)
            out[begin:end] = item

        threads.in_slices(kernel, len(out))
        threads.over(kernel, [(0, 5), (5, len(out))])
        threads.in_batches(lambda part: kernel(part.start, part.stop), len(out), 100)
        return out.sum(), len(names), threads.cores()

    assert threads.cores() == 7
    for item, result in enumerate(threads.in_order(work, range(32))):
        assert result == (item * 4096, 1, 1)


@pytest.mark.parametrize("failing", [0, 30])
def test_an_error_in_any_part_comes_out(failing, monkeypatch):
    monkeypatch.setattr(threads, "all_cores", lambda: 3)

    def fail(begin, end):
        if failing in (begin, end):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        threads.shared(fail)(30)
