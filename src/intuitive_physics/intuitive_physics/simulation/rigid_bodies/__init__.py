"""Rigid bodies as kernels see them: records of a world, poses, and where two bodies touch."""
