"""Synthetic and recorded data, the depth renderer, bags, evaluation and reports."""
