"""How Numba compiles kernels, for nearly all of them alike.

Numba compiles its own functions, such as `np.zeros`, again for kernels with other options. Nothing calls a kernel from
C, so none gets the function for that. Both together spare `relight` 6% of the seconds that it compiles.
"""

import numba

kernel = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
"""Decorator: compile a function when it is first called, keep what comes of it, and let other threads run beside it. A
division by zero gives infinity or NaN, of integers 0."""
