"""What to throw next: the candidates that are expected to tell most."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.design.expected_information import (
    expected_posteriors,
    gaussian_covariance,
)
from intuitive_physics_learner.design.questions import Question
from intuitive_physics_learner.design.settings import DesignSettings
from intuitive_physics_learner.design.throws import Throw, ThrowOptions, ViewingConditions


@dataclass(frozen=True, eq=False)
class Suggestion:
    """One throw, and what it is expected to tell.

    Parameters
    ----------
    throw : objects and initial states
    gain : expected information on what is asked, nat
    asked : (r,) names of what is asked: parameters, or parts of a query's answer
    before : (r,) standard deviation of each at present, in its SI unit
    after : (r,) the same after the throw, root mean square over the draws
    """

    throw: Throw
    gain: float
    asked: tuple[str, ...]
    before: NDArray[np.float64]
    after: NDArray[np.float64]


def suggest(
    options: ThrowOptions,
    posterior: ParameterPosterior,
    question: Question,
    viewing: ViewingConditions,
    simulator: Simulator,
    rng: np.random.Generator,
    *,
    count: int = 1,
    settings: DesignSettings | None = None,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Suggestion]:
    """Return the throws that are expected to tell most, the best first.

    The gain of a throw is the mean over draws of θ_s of

        ½ ln (det (Σ + ρ²) / det (Σ' + ρ²))     for parameters (D-optimality), or
        ½ ln (tr Σ / tr Σ')                     for a query's answer (c-optimality),

    Σ and Σ' being the covariance of what is asked before and after it. The first is the expected
    information of Lindley (1956), where all is linear and normal, on parameters that are of
    interest up to a resolution ρ.

    Parameters
    ----------
    options : what can be thrown
    posterior : of θ_s, of all materials of the options and of the question
    question : what is asked
    viewing : how the throw will be observed
    simulator : of throws and queries
    rng : of all randomness
    count : of throws to return at most
    settings : how candidates are drawn and judged
    cancelled : looked at between batches of simulations

    Raises
    ------
    InvalidInputError
        When no valid throw lies within the ranges.
    LearningCancelledError
        When `cancelled` returned True.
    """
    how = settings or DesignSettings()
    directions = question.directions(posterior, simulator, how, rng)
    throws = options.draw(how.candidates, rng)
    covariance = gaussian_covariance(posterior)
    gains = np.zeros(len(throws))
    after = np.zeros((len(throws), len(directions)))
    for part in expected_posteriors(
        throws, posterior, viewing, simulator, how, rng, cancelled=cancelled
    ):
        reduction = part.reduction(covariance, directions)
        gains[part.throws] = question.information(reduction).mean(axis=0)
        after[part.throws] = np.sqrt(reduction.variances.mean(axis=0))
    best = np.argsort(-gains, kind="stable")[:count]
    names, units = zip(*question.functions(posterior), strict=True)
    before = np.sqrt(np.diag(reduction.before)) * units
    return [Suggestion(throws[i], float(gains[i]), names, before, after[i] * units) for i in best]
