"""Runs our perception over a rendered bag and holds every frame against the truth."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.perception_score import NEAR, Ball, Score, matched
from benchmarks.perception_truth import TrueBall, TrueRecording
from intuitive_physics.observation import ObservedObject
from intuitive_physics.shapes import Sphere
