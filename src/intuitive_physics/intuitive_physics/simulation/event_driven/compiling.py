"""How Numba compiles the kernels of this engine."""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, nogil=True, _nrt=False)
"""Decorate a function that Python or other kernels call, without the GIL."""

inlined = njit(inline="always")
"""Decorate a function that is written into its callers, before types are inferred."""
