"""Suggestions for the next throw: the candidates that are expected to be most informative."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.design.expected_information import expected_posteriors
from intuitive_physics_learner.design.questions import Question
from intuitive_physics_learner.design.throws import Throw, ThrowOptions, ViewingConditions
from intuitive_physics_learner.search.gaussian import Gaussian

CANDIDATES = 96
"""Throws spread over the ranges that are compared first; the best of 96 random ones is within the
best 5 % with probability 0.99."""

DRAWS = 8
"""Draws of θ_s from the posterior that the expected information is averaged over; set by hand."""

EXECUTION_ERROR = 0.05
"""Standard deviation by which a throw misses what was suggested, a part of the width of each range:
a suggestion must not depend on a perfect throw; set by hand."""

REFINED, NEIGHBOURS, REFINEMENTS = 6, 8, (0.15, 0.05)
"""Best throws that are refined, as many as are suggested at least; throws near each of them that
are compared next; and standard deviations, parts of the ranges' widths, by which these differ from
them, round after round; set by hand."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """One throw, and its expected information.

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
    candidates: int = CANDIDATES,
    draws: int = DRAWS,
    execution_error: float = EXECUTION_ERROR,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Suggestion]:
    """Return the most informative throws, the best first.

    The gain of a throw is

        ½ ln (det (Σ + ρ²) / det (Σ' + ρ²))     for parameters (D-optimality), or
        ½ ln (tr Σ / tr Σ')                     for a query's answer (c-optimality),

    Σ being the present covariance of what is asked and Σ' the one expected after the throw, a mean
    over draws of θ_s. Where all is linear and normal, the first is the expected information of
    Lindley (1956) on parameters that are of interest up to a resolution ρ.

    Throws are spread over the ranges first; the best of them are then refined, each into the best
    of its neighbours, and stay apart.

    Parameters
    ----------
    options : what can be thrown
    posterior : of θ_s, of all materials of the options and of the question
    question : what is asked
    viewing : how the throw will be observed
    simulator : of throws and queries
    rng : of all randomness
    count : of throws to return at most
    candidates, draws, execution_error : as the constants that are their defaults
    cancelled : polled between batches of simulations

    Raises
    ------
    InvalidInputError
        When no valid throw lies within the ranges.
    LearningCancelledError
        When `cancelled` returned True.
    """
    directions = question.directions(posterior, simulator, rng)
    covariance = Gaussian.of(posterior, bounded=True).covariance
    units = posterior.draw(draws, rng)
    names, scales = zip(*question.functions(posterior), strict=True)

    def judged(throws: list[Throw]) -> list[Suggestion]:
        """Judge throws, in their order."""
        suggestions: dict[int, Suggestion] = {}
        for part in expected_posteriors(
            throws, posterior, units, viewing, simulator, execution_error, rng, cancelled=cancelled
        ):
            reduction = part.reduction(covariance, directions)
            gains = question.information(reduction)
            before = np.sqrt(np.diag(reduction.before)) * scales
            after = np.sqrt(reduction.variances) * scales
            for i, gain, left in zip(part.throws, gains, after, strict=True):
                suggestions[int(i)] = Suggestion(throws[i], float(gain), names, before, left)
        return [suggestions[i] for i in range(len(throws))]

    families = _best(judged(options.draw(candidates, rng)), max(count, REFINED))
    for spread in REFINEMENTS:
        near = [best.throw.nearby(NEIGHBOURS, spread, rng) for best in families]
        each = [k for k, throws in enumerate(near) for _ in throws]
        for k, tried in zip(
            each, judged([throw for throws in near for throw in throws]), strict=True
        ):
            if tried.gain > families[k].gain:
                families[k] = tried
    return _best(families, count)


def _best(suggestions: list[Suggestion], count: int) -> list[Suggestion]:
    return sorted(suggestions, key=lambda each: -each.gain)[:count]
