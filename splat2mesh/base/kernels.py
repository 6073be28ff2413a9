"""The options with which Numba compiles nearly all kernels.

Numba compiles its own functions, such as `np.zeros`, again for kernels with other options. Nothing calls a kernel from
C, so none gets the function for that.
"""

import numba

kernel = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
"""Decorator: compile a function on its first call, cache the machine code, and release the GIL. A
division by zero gives infinity or NaN, of integers 0."""
