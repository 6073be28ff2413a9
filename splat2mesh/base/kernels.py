"""The options with which Numba compiles nearly all kernels.

Numba compiles its own functions, such as `np.zeros`, again for kernels with other options. Nothing calls a kernel from
C, so none gets the function for that. Both together spare `relight` 6% of the seconds that it compiles.
"""

import sys
from importlib import import_module
from types import ModuleType
from typing import Any

import numba

kernel = numba.njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True)
"""Decorator: compile a function on its first call, cache the machine code, and release the GIL. A
division by zero gives infinity or NaN, of integers 0."""

_BLAS = "scipy.linalg.cython_blas"


def without_blas() -> None:
    """Keep Numba, before the first kernel, from importing SciPy's linear algebra, which no kernel here uses. For a
    command: .15 s of its imports."""
    modules: dict[str, ModuleType | Any] = sys.modules
    if _BLAS in modules or "numba.np.arraymath" in modules:
        return
    modules[_BLAS] = None
    try:
        import_module("numba.np.arraymath")
    finally:
        del modules[_BLAS]


def without_c_functions() -> None:
    """Have Numba compile its own functions, too, without the function for calls from C. For a command: 7% of the
    seconds that it compiles. Where a version of Numba keeps its options otherwise, nothing changes."""
    try:
        from numba.core import extending
        from numba.core.typing.templates import _OverloadFunctionTemplate

        known: list[dict[str, Any]] = [vars(extending)["_overload_default_jit_options"]]
        known += [template._jit_options for template in _OverloadFunctionTemplate.__subclasses__()]
    except (ImportError, AttributeError, KeyError):
        return
    for options in known:
        options.setdefault("no_cfunc_wrapper", True)
