"""How Numba compiles what is written for it here."""

from __future__ import annotations

from numba import njit

# Without Numba's run-time, arrays among the arguments are not counted as references, which costs
# two atomic operations a call and kept short functions two to five times slower. A kernel can
# then allocate no array: it is given its scratch. NumPy's error model divides without a branch.
_options = {"_nrt": False, "error_model": "numpy", "nogil": True}

kernel = njit(cache=True, **_options)
"""Decorate a function that other kernels call, or that Python calls without the GIL."""

inlined = njit(forceinline=True, fastmath={"contract", "reassoc", "nsz"}, **_options)
"""Decorate a short function that the compiler is to write into each of its callers.

Its sums may be taken in another order and fused with products: same to rounding, and shorter
chains of operations that wait for one another. NaN and infinity keep their meaning.
"""
