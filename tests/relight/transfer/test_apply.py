from itertools import pairwise

import numpy as np
import pytest

from relight.transfer.apply import BLOCK, PARALLEL_NUMBERS, Product
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
    product = Product(transfer)
    assert (np.abs(product.radiance(light) - exact) <= bound).all()
    np.testing.assert_array_equal(product.transfer, transfer)
    halves = Product(transfer, half=True)
    stored = halves.transfer
    np.testing.assert_array_equal(stored, transfer.astype(np.float16).astype(np.float32))
    exact = np.maximum(stored.astype(np.float64) @ light32, 0.0)
    assert (np.abs(halves.radiance(light) - exact) <= bound + 1e-7).all()
    # Of four blocks: the last is filled up.
    assert halves.nbytes * 2 == product.nbytes == -(-count // BLOCK) * BLOCK * coefficients * 4


def test_every_float16_is_read_as_numpy_reads_it():
    every = np.arange(2**16, dtype=np.uint16).view(np.float16)
    every = every[np.isfinite(every)].astype(np.float32)[:, None]
    both = np.concatenate([every, np.ones_like(every)], axis=1)
    product = Product(both, half=True)
    # The product with one colour 1 and the constant large enough to stay positive: nothing is clipped.
    radiance = product.radiance(np.array([[1.0, -1.0, 2.0], [0.0, 0.0, 0.0]]))
    np.testing.assert_array_equal(radiance[:, 0], np.maximum(every[:, 0], 0.0))
    np.testing.assert_array_equal(radiance[:, 1], np.maximum(-every[:, 0], 0.0))
    np.testing.assert_array_equal(radiance[:, 2], np.maximum(2.0 * every[:, 0], 0.0))


def test_albedo_and_other_light_come_in_their_order():
    transfer, light = arrays(1000, 9)
    rng = np.random.default_rng(1)
    albedo, other = rng.random((1000, 3)).astype(np.float32), rng.normal(size=(1000, 3)).astype(np.float32)
    product = Product(transfer)
    plain = transfer.astype(np.float64) @ light
    for given, expected in (
        ({"albedo": albedo}, np.maximum(plain, 0) * albedo),
        ({"other": other}, np.maximum(plain + other, 0)),
        ({"albedo": albedo, "other": other}, np.maximum(plain + other, 0) * albedo),
    ):
        np.testing.assert_allclose(product.radiance(light, **given), expected, atol=1e-5)
    np.testing.assert_array_equal(
        product.radiance(light, other=0 * other, albedo=0 * albedo + 1), product.radiance(light)
    )


def test_bits_depend_neither_on_threads_nor_on_parts():
    count = PARALLEL_NUMBERS // 9 + 1000  # so many that threads share them
    transfer, light = arrays(count, 9)
    rng = np.random.default_rng(2)
    albedo, other = rng.random((count, 3)).astype(np.float32), rng.normal(size=(count, 3)).astype(np.float32)
    for half in (False, True):
        product = Product(transfer, half)
        whole = product.radiance(light, albedo=albedo, other=other, threads=1)
        for threads in (2, 3, 7):
            parallel = product.radiance(light, albedo=albedo, other=other, threads=threads)
            np.testing.assert_array_equal(parallel, whole)
        cuts = [0, 1, 5, BLOCK, BLOCK + 1, 4 * BLOCK, 50_001, count]
        out = np.full_like(whole, np.nan)
        for begin, end in pairwise(cuts):
            part = slice(begin, end)
            given = {"albedo": albedo[part], "other": other[part], "begin": begin, "end": end}
            assert product.radiance(light, out[part], **given) is not None
        np.testing.assert_array_equal(out, whole)
        assert product.radiance(light, begin=7, end=7).shape == (0, 3)


def test_written_rows_are_as_if_they_had_always_been_there():
    transfer, light = arrays(1000, 16)
    new, _ = arrays(300, 16, seed=3)
    rows = np.random.default_rng(4).permutation(1000)[:300]
    for half in (False, True):
        product, changed = Product(transfer, half), transfer.copy()
        product.write(rows, new)
        changed[rows] = new
        np.testing.assert_array_equal(product.radiance(light), Product(changed, half).radiance(light))
    product.write(np.zeros(0, int), np.zeros((0, 16)))


def test_what_does_not_fit_is_refused():
    transfer, light = arrays(300, 9)
    product = Product(transfer)
    for call, message in (
        (lambda: Product(transfer[0]), r"shape \(V, K\)"),
        (lambda: Product(transfer[:, :0]), r"shape \(V, K\)"),
        (lambda: Product(transfer * 1e5, half=True), "float16"),
        (lambda: Product(np.full((2, 9), np.nan), half=True), "float16"),
        (lambda: product.radiance(light[:4]), r"light must have shape \(9, 3\)"),
        (lambda: product.radiance(light, np.zeros((300, 3))), "contiguous float32"),
        (lambda: product.radiance(light, np.zeros((300, 6), np.float32)[:, ::2]), "contiguous float32"),
        (lambda: product.radiance(light, albedo=np.ones((299, 3))), "albedo must have shape"),
        (lambda: product.radiance(light, other=np.ones(3)), "other light must have shape"),
        (lambda: product.radiance(light, begin=10, end=301), r"part of 0..300"),
        (lambda: product.radiance(light, begin=-1), r"part of 0..300"),
        (lambda: product.write([300], transfer[:1]), "from 0 to 299"),
        (lambda: product.write([3, 4], transfer[:1]), "must have shape"),
        (lambda: Product(transfer, half=True).write([0], transfer[:1] * 1e6), "float16"),
    ):
        with pytest.raises(InputError, match=message):
            call()
