"""Pixels of runs, packed and unpacked."""

import numpy as np
import pytest

from relight.splats.packed_pixels import packed, unpacked
from splat2mesh.base.errors import InputError


def runs(count=200):
    """Counts of some runs and their pixels, ascending in each."""
    rng = np.random.default_rng(3)
    parts = [np.sort(rng.choice(256, rng.integers(1, 257), replace=False)) for _ in range(count)]
    return np.array([len(part) for part in parts], np.uint16), np.concatenate(parts).astype(np.uint8)


def test_what_was_packed_comes_back():
    counts, pixels = runs()
    again = unpacked(*packed(counts, pixels))
    np.testing.assert_array_equal(again[0], counts)
    np.testing.assert_array_equal(again[1], pixels)
    assert again[0].dtype == counts.dtype and again[1].dtype == pixels.dtype


def test_no_run_is_packed_as_nothing():
    empty = packed(np.zeros(0, np.uint16), np.zeros(0, np.uint8))
    assert [len(each) for each in (*empty, *unpacked(*empty))] == [0, 0, 0, 0]


def test_a_patch_takes_fewer_bytes_than_its_pixels():
    patch = (16 * np.arange(4, 12)[:, None] + np.arange(3, 13)).ravel().astype(np.uint8)
    rows, masks = packed(np.array([len(patch)], np.uint16), patch)
    assert rows.nbytes + masks.nbytes < len(patch) / 2


def test_what_cannot_have_been_packed_is_refused():
    rows, masks = packed(*runs())
    with pytest.raises(InputError, match="fit together"):
        unpacked(rows, masks[:-1])
    with pytest.raises(InputError, match="another kind"):
        unpacked(rows.astype(np.int32), masks)
