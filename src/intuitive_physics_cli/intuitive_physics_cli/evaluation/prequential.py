"""Predictions that were made before their observation was learned from.

Prequential: of each observation, in the order of time, only those before it are known (Dawid:
Statistical theory, the prequential approach, J. R. Statist. Soc. A 147, 1984).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.observation import Observation, observation_materials
from intuitive_physics.simulation import Simulator
from intuitive_physics_cli.evaluation.first_part import after_first_parts
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase, predict_cases
from intuitive_physics_learner.learning_session import LearningOptions, learn
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

GROWTH = 2
"""Factor by which the observations have to grow in number until θ_s is learned again."""


def predict_before_learning(
    observations: Sequence[Observation],
    options: LearningOptions,
    simulator: Simulator,
    rng: np.random.Generator,
    sample_count: int = 100,
    on_progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[PredictionCase], int]:
    """Predict each observation after its first part, with what was learned from those before it.

    θ_s is learned from the first observation, the first two, four, eight and so on, and predicts
    all up to the next time; before the first, nothing is known of it. The posterior of θ_s and the
    covariance of the states are drawn from, as the predictor does.

    Parameters
    ----------
    options : how to learn
    on_progress : called with the observations done and the observations in all

    Returns
    -------
    cases : of all objects of all observations, in the order of time
    left_out : observations that could not be predicted, as in `FirstParts`
    """
    ordered = sorted(observations, key=lambda seen: seen.start_time)
    materials = observation_materials(ordered)
    learned = LearnedParameters.defaults(materials)
    cases: list[PredictionCase] = []
    left_out, first = 0, 0
    while first < len(ordered):
        if first > 0:
            known = learn(ordered[:first], simulator, options, previous=learned).learned
            learned = known.extended(materials)
        parts = after_first_parts(ordered[first : max(GROWTH * first, 1)])
        cases += predict_cases(
            parts.observations, UncertainParameters(learned), simulator, rng, sample_count
        )
        left_out += parts.left_out
        first = max(GROWTH * first, 1)
        on_progress(min(first, len(ordered)), len(ordered))
    return cases, left_out
