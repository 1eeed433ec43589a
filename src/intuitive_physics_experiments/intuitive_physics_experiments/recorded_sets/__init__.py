"""Motions recorded by others, as observations."""
