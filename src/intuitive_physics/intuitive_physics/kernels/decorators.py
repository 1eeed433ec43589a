"""How Numba compiles what is written for it here."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit, types

# Without Numba's run-time, arrays among the arguments are not counted as references, which costs
# two atomic operations a call and kept short functions two to five times slower. A kernel can
# then allocate no array: it is given its scratch. NumPy's error model divides without a branch.
_OPTIONS: dict[str, Any] = {"_nrt": False, "error_model": "numpy", "nogil": True}


_INNER: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
"""What a function needs only when it is called from outside takes a quarter of the compiling."""


def entry(function: Callable) -> Any:
    """Decorate a kernel that Python calls, without the GIL, and that is kept in the cache."""
    return _once_for_all_numbers(njit(cache=True, **_OPTIONS)(function))


def kernel(function: Callable) -> Any:
    """Decorate a function that only other kernels call; the cached entry holds its code too."""
    return _once_for_all_numbers(njit(**_OPTIONS, **_INNER)(function))


def inlined(function: Callable) -> Any:
    """Decorate a short function that the compiler is to write into each of its callers."""
    return _once_for_all_numbers(njit(forceinline=True, **_OPTIONS, **_INNER)(function))


def fast_inlined(function: Callable) -> Any:
    """Decorate such a function where sums may be taken in another order and fused with products.

    The result is the same to rounding, from shorter chains of operations that wait for one
    another. NaN and infinity keep their meaning.
    """
    fast = {"contract", "reassoc", "nsz"}
    compiled = njit(forceinline=True, fastmath=fast, **_OPTIONS, **_INNER)(function)
    return _once_for_all_numbers(compiled)


def _once_for_all_numbers(dispatcher: Any) -> Any:
    """Keep Numba from compiling a function once more for each number written in a call of it."""
    resolve = dispatcher.get_call_template

    def resolve_without_values(arguments: tuple, keywords: dict) -> Any:
        return resolve(tuple(types.unliteral(one) for one in arguments), keywords)

    dispatcher.get_call_template = resolve_without_values
    return dispatcher
