"""Benchmarks: this project beside its peers, measured in one interleaved run."""
