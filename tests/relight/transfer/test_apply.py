from itertools import pairwise

import numpy as np
import pytest

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
    np.testing.assert_array_equal(blocks.transfer, transfer)
    # The last block is filled up.
    assert blocks.nbytes == -(-count // BLOCK) * BLOCK * coefficients * 4


def test_albedo_and_other_light_come_in_their_order():
    transfer, light = arrays(1000, 9)
    rng = np.random.default_rng(1)
    albedo, other = rng.random((1000, 3)).astype(np.float32), rng.normal(size=(1000, 3)).astype(np.float32)
    blocks = BlockTransfer(transfer)
    plain = transfer.astype(np.float64) @ light
    for given, expected in (
        ({"albedo": albedo}, np.maximum(plain, 0) * albedo),
        ({"other": other}, np.maximum(plain + other, 0)),
        ({"albedo": albedo, "other": other}, np.maximum(plain + other, 0) * albedo),
    ):
        np.testing.assert_allclose(blocks.apply(light, **given), expected, atol=1e-5)
    np.testing.assert_array_equal(blocks.apply(light, other=0 * other, albedo=0 * albedo + 1), blocks.apply(light))


def test_bits_depend_neither_on_threads_nor_on_parts():
    count = PARALLEL_NUMBERS // 9 + 1000  # so many that threads share them
    transfer, light = arrays(count, 9)
    rng = np.random.default_rng(2)
    albedo, other = rng.random((count, 3)).astype(np.float32), rng.normal(size=(count, 3)).astype(np.float32)
    blocks = BlockTransfer(transfer)
    whole = blocks.apply(light, albedo=albedo, other=other, threads=1)
    for threads in (2, 3, 7):
        parallel = blocks.apply(light, albedo=albedo, other=other, threads=threads)
        np.testing.assert_array_equal(parallel, whole)
    cuts = [0, 1, 5, BLOCK, BLOCK + 1, 4 * BLOCK, 50_001, count]
    out = np.full_like(whole, np.nan)
    for begin, end in pairwise(cuts):
        part = slice(begin, end)
        given = {"albedo": albedo[part], "other": other[part], "begin": begin, "end": end}
        assert blocks.apply(light, out[part], **given) is not None
    np.testing.assert_array_equal(out, whole)
    assert blocks.apply(light, begin=7, end=7).shape == (0, 3)


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
        (lambda: blocks.apply(light, np.zeros((300, 3))), "contiguous float32"),
        (lambda: blocks.apply(light, np.zeros((300, 6), np.float32)[:, ::2]), "contiguous float32"),
        (lambda: blocks.apply(light, albedo=np.ones((299, 3))), "albedo must have shape"),
        (lambda: blocks.apply(light, other=np.ones(3)), "other light must have shape"),
        (lambda: blocks.apply(light, begin=10, end=301), r"part of 0..300"),
        (lambda: blocks.apply(light, begin=-1), r"part of 0..300"),
        (lambda: blocks.write([300], transfer[:1]), "from 0 to 299"),
        (lambda: blocks.write([3, 4], transfer[:1]), "must have shape"),
    ):
        with pytest.raises(InputError, match=message):
            call()
