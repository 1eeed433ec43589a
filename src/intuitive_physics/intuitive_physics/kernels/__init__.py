"""Kernels: functions that Numba compiles, how they reach memory, and their warm-up."""

from intuitive_physics.kernels.decorators import entry, fast_inlined, inlined, kernel

__all__ = ["entry", "fast_inlined", "inlined", "kernel"]
