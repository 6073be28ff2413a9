"""The one product that a new light costs: radiance = max(transfer . light + other light, 0) x albedo, memory-bound.

A transfer (V, K) is kept in blocks of 128 vertices, coefficient after coefficient: every load and every sum is then a
whole vector, where rows of 9 numbers leave most of it unused. Each vertex is summed over k in one order, in a lane of
its own: the bits depend neither on the number of threads nor on the part of the vertices that is asked for.
Against copying as many bytes in the same run, one product takes 1 to 2.5 times as long (docs/live.md).
"""

import math
import os
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, overload

from splat2mesh.base.errors import InputError

BLOCK = 128
"""Vertices side by side: three sums of 512 bytes stay in the first cache. 32 is slower by half."""

PARALLEL_NUMBERS = 2**20
"""Numbers of transfer from which a second thread pays for being woken, which takes some 20 us."""

AHEAD = 2
FETCHED_BYTES = 2**13
"""Blocks that are fetched ahead, where one is no larger than this: a million vertices in 3 bands take a tenth to a
fifth less. Larger blocks the processor foresees by itself, and they take a tenth more."""

HALF_LIMIT = 65504.0  # the largest float16
_LANES = 16  # interleaved at once; a vector of AVX-512, two of AVX2

_pool = None


class Product:
    """A transfer, (V, K), ready to be multiplied by lights.

    count, coefficients: V and K. half: whether it is stored as float16. nbytes: memory of it.
    """

    def __init__(
        self,
        transfer,  # (V, K) float
        half=False,  # store float16: half the memory; each number within 2^-11 of itself, sums in float32
    ):
        """Raises InputError unless the transfer is (V, K) with K from 1 up, or where float16 cannot hold it."""
        transfer = np.asarray(transfer, np.float32)
        if transfer.ndim != 2 or transfer.shape[1] == 0:
            raise InputError(f"the transfer must have shape (V, K), found {transfer.shape}")
        if half and not (np.abs(transfer) <= HALF_LIMIT).all():
            raise InputError(f"a transfer beyond {HALF_LIMIT} or not finite cannot be stored as float16: use float32")
        self.count, self.coefficients = transfer.shape
        self.half = bool(half)
        blocks = math.ceil(self.count / BLOCK)
        self._blocks = np.zeros((blocks, self.coefficients, BLOCK), np.float16 if half else np.float32)
        full = self.count // BLOCK
        whole = transfer[: full * BLOCK].reshape(full, BLOCK, self.coefficients)
        self._blocks[:full] = whole.transpose(0, 2, 1)
        if full < blocks:
            self._blocks[full, :, : self.count - full * BLOCK] = transfer[full * BLOCK :].T

    @property
    def nbytes(self):
        return self._blocks.nbytes

    @property
    def transfer(self):
        """The transfer as rows again: (V, K) float32, a copy."""
        rows = self._blocks.transpose(0, 2, 1).reshape(-1, self.coefficients)
        return np.ascontiguousarray(rows[: self.count], np.float32)

    def write(self, rows, transfer):
        """Replace rows, (N,) integers, by a transfer (N, K). Raises InputError for rows that are not there."""
        rows, transfer = np.asarray(rows), np.asarray(transfer, np.float32)
        if transfer.shape != (len(rows), self.coefficients):
            expected = f"({len(rows)}, {self.coefficients})"
            raise InputError(f"the new rows must have shape {expected}, found {transfer.shape}")
        if len(rows) and not (0 <= rows.min() and rows.max() < self.count):
            raise InputError(f"rows must be from 0 to {self.count - 1}, found {rows.min()} to {rows.max()}")
        if self.half and not (np.abs(transfer) <= HALF_LIMIT).all():
            raise InputError(f"a transfer beyond {HALF_LIMIT} or not finite cannot be stored as float16: use float32")
        self._blocks[rows // BLOCK, :, rows % BLOCK] = transfer

    def radiance(
        self,
        light,  # (K, 3) float
        out=None,  # (N, 3) float32, contiguous, written; made without
        albedo=None,  # (N, 3), of the same vertices as `out`
        other=None,  # (N, 3), light added before what is negative becomes 0, such as suns
        begin=0,
        end=None,  # vertices begin..end; all of them without
        threads=None,  # at most; as many as there are cores without
    ):
        """max(transfer . light + other, 0) x albedo of the vertices begin..end: (N, 3) float32, which is `out`.

        Raises InputError for arrays that do not fit.
        """
        end = self.count if end is None else end
        if not 0 <= begin <= end <= self.count:
            raise InputError(f"vertices must be a part of 0..{self.count}, found {begin}..{end}")
        shape = (end - begin, 3)
        if np.shape(light) != (self.coefficients, 3):
            raise InputError(f"the light must have shape ({self.coefficients}, 3), found {np.shape(light)}")
        out = np.zeros(shape, np.float32) if out is None else out
        if out.shape != shape or out.dtype != np.float32 or not out.flags.c_contiguous:
            raise InputError(f"the output must be contiguous float32 of shape {shape}, found {out.dtype} {out.shape}")
        factors = [self._factor(name, array, shape) for name, array in (("other light", other), ("albedo", albedo))]
        light = np.ascontiguousarray(np.asarray(light, np.float32).T)
        blocks = self._blocks.view(np.uint16) if self.half else self._blocks
        numbers = (end - begin) * self.coefficients
        cores = 1 if numbers < PARALLEL_NUMBERS else (os.cpu_count() or 1) if threads is None else threads
        cuts = [begin + round((end - begin) * i / cores / BLOCK) * BLOCK for i in range(cores)] + [end]
        parts = [(min(a, end), min(b, end), begin) for a, b in pairwise(cuts)]
        pending = [_workers().submit(_multiply, *part, blocks, light, *factors, out.reshape(-1)) for part in parts[1:]]
        _multiply(*parts[0], blocks, light, *factors, out.reshape(-1))
        for done in pending:
            done.result()
        return out

    @staticmethod
    def _factor(name, array, shape):
        """An (N, 3) array as flat float32; an empty one for None."""
        if array is None:
            return np.zeros(0, np.float32)
        if np.shape(array) != shape:
            raise InputError(f"the {name} must have shape {shape}, found {np.shape(array)}")
        return np.ascontiguousarray(array, np.float32).reshape(-1)


def _workers():
    """Threads that stay: to start one takes longer than a product of 100,000 vertices."""
    global _pool
    if _pool is None:
        _pool = ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="product")
    return _pool


@intrinsic
def _interleave(typing_context, sums, at, out, base, floor):
    """out[base + 3 i + c] = max(sums[c, at + i], floor) for 16 i and 3 c, in whole vectors."""

    def generate(context, builder, signature, arguments):
        def pointer(argument, index):
            array = context.make_array(signature.args[argument])(context, builder, arguments[argument])
            return builder.gep(array.data, [index])

        vector, word = ir.VectorType(ir.FloatType(), _LANES), ir.IntType(32)

        def shuffled(first, second, lanes):
            return builder.shuffle_vector(first, second, ir.Constant(ir.VectorType(word, len(lanes)), lanes))

        one = builder.insert_element(ir.Constant(vector, ir.Undefined), arguments[4], ir.Constant(word, 0))
        floors, planes = shuffled(one, one, [0] * _LANES), []
        for c in range(3):
            start = builder.add(arguments[1], ir.Constant(ir.IntType(64), c * BLOCK))
            plane = builder.load(builder.bitcast(pointer(0, start), vector.as_pointer()), align=4)
            planes.append(builder.select(builder.fcmp_ordered(">", plane, floors), plane, floors))
        pair = shuffled(planes[0], planes[1], list(range(2 * _LANES)))
        rest = shuffled(planes[2], planes[2], list(range(2 * _LANES)))
        lanes = [c * _LANES + i for i in range(_LANES) for c in range(3)]
        woven = shuffled(pair, rest, lanes)
        target = builder.bitcast(pointer(2, arguments[3]), ir.VectorType(ir.FloatType(), 3 * _LANES).as_pointer())
        builder.store(woven, target, align=4)
        return context.get_dummy_value()

    return types.void(sums, types.int64, out, types.int64, types.float32), generate


@intrinsic
def _fetch(typing_context, blocks, at):
    """Have the cache line of entry `at` fetched: eight short rows read side by side are not foreseen."""

    def generate(context, builder, signature, arguments):
        array = context.make_array(signature.args[0])(context, builder, arguments[0])
        address = builder.bitcast(builder.gep(array.data, [arguments[1]]), ir.IntType(8).as_pointer())
        word = ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [address.type, word, word, word])
        prefetch = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0")
        builder.call(prefetch, [address, word(0), word(3), word(1)])
        return context.get_dummy_value()

    return types.void(blocks, types.int64), generate


def _number(stored):
    """A float32 from what is stored: itself, or the bits of a float16."""


@overload(_number)
def _number_of(stored):
    if stored == types.uint16:

        def from_half(stored):
            # Exponent and fraction into their places; a power of two puts the bias right, also of denormal numbers.
            bits = np.uint32(stored & np.uint16(0x7FFF)) << np.uint32(13)
            sign = np.uint32(stored & np.uint16(0x8000)) << np.uint32(16)
            return np.uint32(np.uint32(bits) | np.uint32(sign)).view(np.float32) * np.float32(2.0**112)

        return from_half
    return lambda stored: stored


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def _multiply(begin, end, first, blocks, light, other, albedo, out):
    """Vertices begin..end into the flat `out`; its first vertex is `first`, as are those of other and albedo."""
    sums, woven, zero = np.zeros((3, BLOCK), np.float32), np.zeros(3 * BLOCK, np.float32), np.float32(0)
    block_size, line_size = blocks.shape[1] * BLOCK, 64 // blocks.itemsize
    fetched = block_size * blocks.itemsize <= FETCHED_BYTES
    floor = zero if len(other) == 0 else np.float32(-np.inf)
    for b in range(begin // BLOCK, (end + BLOCK - 1) // BLOCK):
        block, ahead = blocks[b], (b + AHEAD) * block_size
        if fetched and ahead + block_size <= blocks.size:
            for line in range(0, block_size, line_size):
                _fetch(blocks, ahead + line)
        for i in range(BLOCK):
            sums[0, i], sums[1, i], sums[2, i] = zero, zero, zero
        for k in range(len(block) % 8):  # 0, 1 or 4 where the coefficients are those of whole bands
            r0, g0, b0 = light[0, k], light[1, k], light[2, k]
            for i in range(BLOCK):
                t0 = _number(block[k, i])
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
                t0, t1 = _number(block[k, i]), _number(block[k + 1, i])
                t2, t3 = _number(block[k + 2, i]), _number(block[k + 3, i])
                t4, t5 = _number(block[k + 4, i]), _number(block[k + 5, i])
                t6, t7 = _number(block[k + 6, i]), _number(block[k + 7, i])
                sums[0, i] += t0 * r0 + t1 * r1 + t2 * r2 + t3 * r3 + t4 * r4 + t5 * r5 + t6 * r6 + t7 * r7
                sums[1, i] += t0 * g0 + t1 * g1 + t2 * g2 + t3 * g3 + t4 * g4 + t5 * g5 + t6 * g6 + t7 * g7
                sums[2, i] += t0 * b0 + t1 * b1 + t2 * b2 + t3 * b3 + t4 * b4 + t5 * b5 + t6 * b6 + t7 * b7
        low, high = max(begin - b * BLOCK, 0), min(end - b * BLOCK, BLOCK)
        whole = low == 0 and high == BLOCK
        target, at = (out, 3 * (b * BLOCK - first)) if whole else (woven, 0)
        for i in range(0, BLOCK, _LANES):
            _interleave(sums, i, target, at + 3 * i, floor)
        start = 3 * (b * BLOCK + low - first)
        if not whole:
            out[start : start + 3 * (high - low)] = woven[3 * low : 3 * high]
        written = out[start : start + 3 * (high - low)]
        if len(other) > 0:
            added = other[start : start + len(written)]
            for j in range(len(written)):
                value = written[j] + added[j]
                written[j] = value if value > zero else zero
        if len(albedo) > 0:
            colors = albedo[start : start + len(written)]
            for j in range(len(written)):
                written[j] *= colors[j]
