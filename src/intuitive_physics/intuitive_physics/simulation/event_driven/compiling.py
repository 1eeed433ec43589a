"""How Numba compiles the kernels of this engine."""

from __future__ import annotations

from typing import Any

from numba import njit

# Without Numba's run-time no array is counted as a reference, and none can be allocated.
_OPTIONS: dict[str, Any] = {"cache": True, "nogil": True, "_nrt": False}

entry: Any = njit(**_OPTIONS)
"""Decorate a function that Python or other kernels call, without the GIL."""

kernel: Any = njit(nogil=True, _nrt=False, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Decorate a function that only other kernels call."""

inlined: Any = njit(inline="always")
"""Decorate a function that is written into its callers, before types are inferred."""
