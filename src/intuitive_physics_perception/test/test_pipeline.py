"""Frames in; environment, states and observations out."""

from __future__ import annotations

