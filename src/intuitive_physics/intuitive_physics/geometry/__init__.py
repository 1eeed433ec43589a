"""Rotations, polygons and distances, each once: as arrays and as kernels."""
