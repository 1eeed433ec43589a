"""Compile the kernels ahead of time, so that no frame ever waits for them."""

from __future__ import annotations


