"""Shared parts of all nodes: message conversions, and the way from start to clean shutdown."""
