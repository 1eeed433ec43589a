"""Rendered RGBD recordings with known ground truth."""
