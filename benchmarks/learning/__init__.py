"""Learners on the synthetic sets of the paper, beside the true parameters and other engines."""
