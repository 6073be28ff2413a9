import threading

import numpy as np
import pytest

from relight.transfer import threads


@pytest.mark.parametrize("count", [0, 1, threads.MIN_SHARED - 1, threads.MIN_SHARED, 10_001])
def test_slices_cover_every_vertex_once(count):
    seen = np.zeros(count, int)

    def kernel(begin, end, array, step):
        array[begin:end] += step

    threads.in_slices(kernel, count, seen, 3)
    assert (seen == 3).all()


def test_results_come_in_order_on_any_number_of_threads():
    for workers in (None, 1, 7):
        assert list(threads.in_order(pow, range(50), [2] * 50, workers=workers)) == [n * n for n in range(50)]


def test_a_thread_of_the_pool_never_waits_for_another():
    """Kernels inside of what runs on all threads: with a pool that waits for itself this would never end."""

    def work(item):
        out = np.zeros(threads.MIN_SHARED * 2)
        names = set()

        def kernel(begin, end):
            names.add(threading.current_thread().name)
            out[begin:end] = item

        threads.in_slices(kernel, len(out))
        threads.over(kernel, [(0, 5), (5, len(out))])
        return out.sum(), len(names), threads.cores()

    for workers in (None, 7):
        for item, (total, names, cores) in enumerate(threads.in_order(work, range(32), workers=workers)):
            assert (total, names) == (item * threads.MIN_SHARED * 2, 1) or threads.cores() == 1
            assert cores == 1


def test_what_a_kernel_raises_arrives():
    def kernel(begin, end):
        if begin:
            raise ValueError("second")

    with pytest.raises(ValueError, match="second"):
        threads.over(kernel, [(0, 1), (1, 2)])
