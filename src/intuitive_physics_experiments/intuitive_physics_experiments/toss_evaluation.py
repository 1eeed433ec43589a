"""Fit friction and restitution to a part of recorded tosses, simulate the others."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import DEFAULT_COEFFICIENTS, StaticParameters
from intuitive_physics.parameter_space import Bounds
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics.validation import finite_array
from intuitive_physics_experiments.cube_tosses import CUBE_MATERIAL, MATERIALS, TABLE_MATERIAL, CubeToss
from intuitive_physics_experiments.evaluation import split
from intuitive_physics_experiments.toss_errors import TossBatch, TossErrors
from intuitive_physics_experiments.tumbling_flight import tumbling_flight
from intuitive_physics_learner.learning_session import LearningOptions
from intuitive_physics_learner.search import ParameterSearch, SearchProgress, SearchResult
from intuitive_physics_learner.update_rules import make_update_rule

POPULATION = 8
"""Candidates in a generation of CMA-ES; two parameters need fewer than Table I has."""
