import numpy as np
import pytest

import relight.transfer.apply as module
from relight.transfer.apply import BLOCK, PARALLEL_NUMBERS, BlockTransfer
from splat2mesh.base.errors import InputError


def arrays(count, coefficients, seed=0):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(count, coefficients)).astype(np.float32), rng.normal(size=(coefficients, 3))


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16, 25, 36, 49, 64, 81, 100, 13])
@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK, 3 * BLOCK + 77])
def test_the_product_is_that_of_float64(count, coefficients):
    transfer, light = arrays(count, coefficients)
    light32 = light.astype(np.float32).astype(np.float64)
    exact = np.maximum(transfer.astype(np.float64) @ light32, 0.0)
    # A sum of K products in float32, in any order, is off by at most K roundings of the sum of their sizes.
    bound = coefficients * np.finfo(np.float32).eps * (np.abs(transfer) @ np.abs(light32))
    blocks = BlockTransfer(transfer)
    assert (np.abs(blocks.apply(light) - exact) <= bound).all()


def test_other_light_counts_before_what_is_negative_becomes_0():
    transfer, light = arrays(1000, 9)
    other = np.random.default_rng(1).normal(size=(1000, 3)).astype(np.float32)
    blocks = BlockTransfer(transfer)
    expected = np.maximum(transfer.astype(np.float64) @ light + other, 0)
    np.testing.assert_allclose(blocks.apply(light, other), expected, atol=1e-5)
    np.testing.assert_array_equal(blocks.apply(light, 0 * other), blocks.apply(light))


def test_bits_do_not_depend_on_threads(monkeypatch):
    count = PARALLEL_NUMBERS // 9 + 1000  # so many that threads share them
    transfer, light = arrays(count, 9)
    other = np.random.default_rng(2).normal(size=(count, 3)).astype(np.float32)
    blocks, found = BlockTransfer(transfer), []
    for threads in (1, 2, 3, 7):
        monkeypatch.setattr(module, "cores", lambda threads=threads: threads)
        found.append(blocks.apply(light, other))
    for each in found[1:]:
        np.testing.assert_array_equal(each, found[0])


def test_written_rows_are_as_if_they_had_always_been_there():
    transfer, light = arrays(1000, 16)
    new, _ = arrays(300, 16, seed=3)
    rows = np.random.default_rng(4).permutation(1000)[:300]
    blocks, changed = BlockTransfer(transfer), transfer.copy()
    blocks.write(rows, new)
    changed[rows] = new
    np.testing.assert_array_equal(blocks.apply(light), BlockTransfer(changed).apply(light))
    blocks.write(np.zeros(0, int), np.zeros((0, 16)))


def test_what_does_not_fit_is_refused():
    transfer, light = arrays(300, 9)
    blocks = BlockTransfer(transfer)
    for call, message in (
        (lambda: BlockTransfer(transfer[0]), r"shape \(V, K\)"),
        (lambda: BlockTransfer(transfer[:, :0]), r"shape \(V, K\)"),
        (lambda: blocks.apply(light[:4]), r"light must have shape \(9, 3\)"),
        (lambda: blocks.apply(light, np.ones(3)), "other light must have shape"),
        (lambda: blocks.write([300], transfer[:1]), "from 0 to 299"),
        (lambda: blocks.write([3, 4], transfer[:1]), "must have shape"),
    ):
        with pytest.raises(InputError, match=message):
            call()
