"""The one product that a new light costs: radiance = max(transfer . light + other light, 0), memory-bound.

A transfer (V, K) is kept in blocks of 128 vertices, coefficient after coefficient: every load and every sum is then a
whole vector, where rows of 9 numbers leave most of it unused. Each vertex is summed over k in one order, in its
own lane: the bits do not depend on the number of threads.
Against copying as many bytes in the same run, one product takes 1 to 2.5 times as long (docs/dynamic.md).
"""

import math
from itertools import pairwise

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from splat2mesh.base.arrays import Floats
from splat2mesh.base.errors import InputError
from splat2mesh.base.threads import cores, over

from .checks import check_shape

BLOCK = 128
"""Vertices side by side: three sums of 512 bytes stay in the first cache. 32 is slower by half."""

PARALLEL_NUMBERS = 2**20
"""Numbers of transfer from which a second thread pays for being woken, which takes some 20 us."""


class BlockTransfer:
    """A transfer, (V, K), ready to be applied to lights.

    count, coefficients: V and K.
    """

    def __init__(
        self,
        transfer: ArrayLike,  # (V, K) float
    ) -> None:
        """Raises InputError unless the transfer is (V, K) with K from 1 up."""
        transfer = np.asarray(transfer, np.float32)
        if transfer.ndim != 2 or transfer.shape[1] == 0:
            raise InputError(f"the transfer must have shape (V, K), found {transfer.shape}")
        self.count, self.coefficients = transfer.shape
        blocks = math.ceil(self.count / BLOCK)
        self._blocks = np.zeros((blocks, self.coefficients, BLOCK), np.float32)
        full = self.count // BLOCK
        whole = transfer[: full * BLOCK].reshape(full, BLOCK, self.coefficients)
        self._blocks[:full] = whole.transpose(0, 2, 1)
        if full < blocks:
            self._blocks[full, :, : self.count - full * BLOCK] = transfer[full * BLOCK :].T

    def write(self, rows: ArrayLike, transfer: ArrayLike) -> None:
        """Replace rows, (N,) integers, by a transfer (N, K). Raises InputError for rows that are not there."""
        rows, transfer = np.asarray(rows), np.asarray(transfer, np.float32)
        check_shape("the new rows", transfer, (len(rows), self.coefficients))
        if len(rows) and not (0 <= rows.min() and rows.max() < self.count):
            raise InputError(f"rows must be from 0 to {self.count - 1}, found {rows.min()} to {rows.max()}")
        self._blocks[rows // BLOCK, :, rows % BLOCK] = transfer

    def apply(
        self,
        light: Floats,  # (K, 3) float
        other: Floats | None = None,  # (V, 3), light added before what is negative becomes 0, such as suns
    ) -> NDArray[np.float32]:
        """max(transfer . light + other, 0), (V, 3) float32. Raises InputError for arrays that do not fit."""
        check_shape("the light", light, (self.coefficients, 3))
        out, added = np.zeros((self.count, 3), np.float32), np.zeros(0, np.float32)
        if other is not None:
            check_shape("the other light", other, out.shape)
            added = np.ascontiguousarray(other, np.float32).reshape(-1)
        light = np.ascontiguousarray(np.asarray(light, np.float32).T)
        parts = 1 if self.count * self.coefficients < PARALLEL_NUMBERS else cores()
        cuts = [min(round(self.count * i / parts / BLOCK) * BLOCK, self.count) for i in range(parts)] + [self.count]
        over(_multiply, pairwise(cuts), self._blocks, light, added, out.reshape(-1))
        return out


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _multiply(
    begin: int,
    end: int,
    blocks: NDArray[np.float32],
    light: NDArray[np.float32],
    other: NDArray[np.float32],
    out: NDArray[np.float32],
) -> None:
    """Vertices begin..end, whole blocks but for the last, into the flat `out`."""
    sums, zero = np.zeros((3, BLOCK), np.float32), np.float32(0)
    floor = zero if len(other) == 0 else np.float32(-np.inf)
    for b in range(begin // BLOCK, (end + BLOCK - 1) // BLOCK):
        block = blocks[b]
        for i in range(BLOCK):
            sums[0, i], sums[1, i], sums[2, i] = zero, zero, zero
        for k in range(len(block) % 8):  # 0, 1 or 4 where the coefficients are those of whole bands
            r0, g0, b0 = light[0, k], light[1, k], light[2, k]
            for i in range(BLOCK):
                t0 = block[k, i]
                sums[0, i] += t0 * r0
                sums[1, i] += t0 * g0
                sums[2, i] += t0 * b0
        for k in range(len(block) % 8, len(block), 8):
            r0, r1, r2, r3 = light[0, k], light[0, k + 1], light[0, k + 2], light[0, k + 3]
            g0, g1, g2, g3 = light[1, k], light[1, k + 1], light[1, k + 2], light[1, k + 3]
            b0, b1, b2, b3 = light[2, k], light[2, k + 1], light[2, k + 2], light[2, k + 3]
            r4, r5, r6, r7 = light[0, k + 4], light[0, k + 5], light[0, k + 6], light[0, k + 7]
            g4, g5, g6, g7 = light[1, k + 4], light[1, k + 5], light[1, k + 6], light[1, k + 7]
            b4, b5, b6, b7 = light[2, k + 4], light[2, k + 5], light[2, k + 6], light[2, k + 7]
            for i in range(BLOCK):
                t0, t1 = block[k, i], block[k + 1, i]
                t2, t3 = block[k + 2, i], block[k + 3, i]
                t4, t5 = block[k + 4, i], block[k + 5, i]
                t6, t7 = block[k + 6, i], block[k + 7, i]
                sums[0, i] += t0 * r0 + t1 * r1 + t2 * r2 + t3 * r3 + t4 * r4 + t5 * r5 + t6 * r6 + t7 * r7
                sums[1, i] += t0 * g0 + t1 * g1 + t2 * g2 + t3 * g3 + t4 * g4 + t5 * g5 + t6 * g6 + t7 * g7
                sums[2, i] += t0 * b0 + t1 * b1 + t2 * b2 + t3 * b3 + t4 * b4 + t5 * b5 + t6 * b6 + t7 * b7
        start, count = 3 * b * BLOCK, min(end - b * BLOCK, BLOCK)
        written = out[start : start + 3 * count]
        for i in range(count):
            red, green, blue = sums[0, i], sums[1, i], sums[2, i]
            written[3 * i] = red if red > floor else floor
            written[3 * i + 1] = green if green > floor else floor
            written[3 * i + 2] = blue if blue > floor else floor
        if len(other) > 0:
            added = other[start : start + len(written)]
            for j in range(len(written)):
                value = written[j] + added[j]
                written[j] = value if value > zero else zero
