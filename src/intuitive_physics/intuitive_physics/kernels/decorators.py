"""How Numba compiles what is written for it here.

This is the one place for options that Numba does not document; `test_kernels.py` fails with a clear
word when a version of Numba no longer has one of them.

- `_nrt` (private): without Numba's run-time, arrays among the arguments are not counted as
  references, which costs two atomic operations a call and kept short functions two to five times
  slower. A kernel can then allocate no array: its caller gives it the memory.
- `get_call_template` (private, patched): Numba compiles a function once more for each number that
  is written out in a call of it, and there is no option against it.
- `no_cpython_wrapper`, `no_cfunc_wrapper` (undocumented): the wrappers that only calls from outside
  need take a quarter of the time of compiling.
- `pipeline_class` (documented as a way to change passes): what `part_library` has to choose where
  code is written to, which makes compiling two to three times faster.
- `forceinline` (documented): the compiler writes the function into its callers.
- `_cache` (private): what loads and saves the versions of an entry, for which Numba has its own.
- `error_model="numpy"` (documented): a division by zero gives infinity, without a branch.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit, types

from intuitive_physics.kernels.cache import KernelCache, keeps
from intuitive_physics.kernels.part_library import EntryCompiler, PartCompiler

COMMON_OPTIONS: dict[str, Any] = {"error_model": "numpy", "nogil": True}
"""Options of every kernel."""

WITHOUT_RUNTIME: dict[str, Any] = {"_nrt": False}
"""Options of kernels that allocate no array."""

AS_ENTRY: dict[str, Any] = {"pipeline_class": EntryCompiler}
"""Options of kernels that Python calls."""

AS_PART: dict[str, Any] = {
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "pipeline_class": PartCompiler,
}
"""Options of kernels that only other kernels call."""

REORDERING = frozenset({"contract", "reassoc", "nsz"})
"""Liberties with rounding that keep the meaning of NaN and infinity."""


def entry(function: Callable) -> Any:
    """Decorate a kernel that Python calls; its code is kept in the cache."""
    return _kept(_compiled(function, **AS_ENTRY, **WITHOUT_RUNTIME))


def kernel(function: Callable) -> Any:
    """Decorate a function that only other kernels call; the cached entry holds its code too."""
    return _compiled(function, **WITHOUT_RUNTIME, **AS_PART)


def inlined(function: Callable) -> Any:
    """Decorate a short function that the compiler is to write into each of its callers."""
    return _compiled(function, forceinline=True, **WITHOUT_RUNTIME, **AS_PART)


def fast_inlined(function: Callable) -> Any:
    """Decorate such a function where sums may be taken in another order and fused with products.

    The result is the same to rounding, from shorter chains of operations that wait for one
    another. NaN and infinity keep their meaning.
    """
    return _compiled(
        function,
        forceinline=True,
        fastmath=set(REORDERING),
        **WITHOUT_RUNTIME,
        **AS_PART,
    )


def allocating_entry(function: Callable) -> Any:
    """Decorate a kernel that Python calls and that makes new arrays; kept in the cache."""
    return _kept(_compiled(function, **AS_ENTRY))


def allocating_kernel(function: Callable) -> Any:
    """Decorate a function that only other kernels call and that makes new arrays."""
    return _compiled(function, **AS_PART)


def _kept(dispatcher: Any) -> Any:
    """Give a kernel its cache, where its sources can be followed."""
    if keeps(dispatcher.py_func):
        dispatcher._cache = KernelCache(dispatcher.py_func)
    return dispatcher


def _compiled(function: Callable, **options: Any) -> Any:
    return _once_for_all_numbers(njit(**COMMON_OPTIONS, **options)(function))


def _once_for_all_numbers(dispatcher: Any) -> Any:
    """Keep Numba from compiling a function once more for each number written in a call of it."""
    resolve = dispatcher.get_call_template

    def resolve_without_values(arguments: tuple, keywords: dict) -> Any:
        return resolve(tuple(types.unliteral(one) for one in arguments), keywords)

    dispatcher.get_call_template = resolve_without_values
    return dispatcher
