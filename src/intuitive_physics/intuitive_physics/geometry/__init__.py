"""Rotations, polygons and distances, each once for arrays and once for kernels."""
