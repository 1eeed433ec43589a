"""Kernels: functions that Numba compiles, how they reach memory, and their warm-up."""

from intuitive_physics.kernels.decorators import (
    allocating_entry,
    allocating_kernel,
    entry,
    fast_inlined,
    inlined,
    kernel,
)

__all__ = [
    "allocating_entry",
    "allocating_kernel",
    "entry",
    "fast_inlined",
    "inlined",
    "kernel",
]
