"""What the demo saw, learned and predicted: all that its report shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase


@dataclass(frozen=True, eq=False)
class ExampleFrame:
    """One depth frame and what perception found in it.

    Parameters
    ----------
    depth : (height, width) uint16 millimetres, 0 where there is no reading
    camera_matrix : (3, 3) pixels
    rotation, translation : (3, 3) and (3,) m, p_environment = rotation p_sensor + translation
    environment : perceived Ω_e
    plane_outlines : for each plane, (n, 3) m in the environment's frame, what was seen of it
    sphere_center : (3,) m in the environment's frame
    sphere_radius : m
    track : (n, 3) m in the environment's frame, where the ball was seen in its whole throw
    """

    depth: NDArray[np.uint16]
    camera_matrix: NDArray[np.float64]
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    environment: Environment
    plane_outlines: tuple[NDArray[np.float64], ...]
    sphere_center: NDArray[np.float64]
    sphere_radius: float
    track: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LearningOutcome:
    """What was learned.

    Parameters
    ----------
    true : θ_s the balls obeyed, over the materials of `learned` at least
    learned : θ_s with uncertainty
    cost_history : (iterations,) m, lowest J after each iteration
    default_cost : m, J of the default parameters on the same observations
    oracle_cost : m, J of the true parameters on them: noise that no learner can remove
    """

    true: StaticParameters
    learned: LearnedParameters
    cost_history: NDArray[np.float64]
    default_cost: float
    oracle_cost: float


@dataclass(frozen=True)
class ThrowErrors:
    """How well one throw was seen and explained.

    Parameters
    ----------
    name : shown in the table
    material : name
    radius : m, true
    points : how often the ball was seen
    perception_rmse : m, seen against true positions
    learned_distance : m, D̄ of the learned parameters
    oracle_distance : m, D̄ of the true parameters
    default_distance : m, D̄ of the default parameters
    """

    name: str
    material: str
    radius: float
    points: int
    perception_rmse: float
    learned_distance: float
    oracle_distance: float
    default_distance: float


@dataclass(frozen=True, eq=False)
class PredictionOutcome:
    """A throw that was predicted before it happened.

    Parameters
    ----------
    environment : the one it was predicted in
    material : of the ball
    radius : m
    times : (n_times,) s after the state that was predicted from
    samples : (n_samples, n_times, 3) m
    mean : (n_times, 3) m
    observed_times : (n,) s on the same clock; may begin before 0
    observed : (n, 3) m, where the ball was seen
    true : (n_times, 3) m, where it truly was at `times`
    """

    environment: Environment
    material: str
    radius: float
    times: NDArray[np.float64]
    samples: NDArray[np.float64]
    mean: NDArray[np.float64]
    observed_times: NDArray[np.float64]
    observed: NDArray[np.float64]
    true: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DemoResult:
    """Everything the report shows.

    Parameters
    ----------
    example : one frame
    learning : what was learned
    throws : one entry a throw
    prediction : the throw that was predicted
    cases : the throws that were learned from, each predicted from its initial state
    point_noise : m, standard deviation on each axis of where a ball was seen
    summary : the numbers the demo ends with, by name
    about : how it was made (seed, versions, times …), shown as text
    """

    example: ExampleFrame
    learning: LearningOutcome
    throws: tuple[ThrowErrors, ...]
    prediction: PredictionOutcome
    cases: tuple[PredictionCase, ...] = ()
    point_noise: float = 0.0
    summary: Mapping[str, float] = field(default_factory=dict)
    about: Mapping[str, str] = field(default_factory=dict)
