"""Suggestions for the next throw: the candidates that are expected to be most informative.

They are made of options, or of what was seen and learned by a learner's database.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.design.expected_information import expected_reductions
from intuitive_physics_learner.design.questions import AboutMotion, AboutParameters, Question
from intuitive_physics_learner.design.throws import Throw, ThrowOptions, ViewingConditions
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.store.observation_entries import USED

CANDIDATES = 96
"""Throws spread over the ranges that are compared first; the best of 96 random ones is within the
best 5 % with probability 0.99."""

DRAWS = 8
"""Draws of θ_s from the posterior that the expected information is averaged over; set by hand."""

EXECUTION_ERROR = 0.05
"""Standard deviation by which a throw misses what was suggested, a part of the width of each range:
a suggestion must not depend on a perfect throw; set by hand."""

REFINED = 6
"""Best throws that are refined, as many as are suggested at least; set by hand."""

NEIGHBOURS = 8
"""Throws near each of them in each round of refinement; set by hand."""

REFINEMENTS = (0.15, 0.05)
"""Standard deviations, parts of the ranges' widths, by which throws that are compared next differ
from the best so far, round after round; set by hand."""

MOST_OBSERVATIONS = 500
"""Newest stored observations at most from which ranges, noise and view are read, so that a
suggestion takes as long after years as after a day; set by hand."""

VIEW_MARGIN = 0.1
"""Margin of the region in view around all observed positions, a part of its largest extent: few
tracks reach its edges; set by hand."""


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
    simulator : of throws and queries, by whose flag they are cancelled
    rng : of all randomness
    count : of throws to return at most
    candidates, draws, execution_error : as the constants that are their defaults

    Raises
    ------
    InvalidInputError
        When no valid throw lies within the ranges.
    SimulationStoppedError
        When the simulator's flag was set.
    """
    directions = question.directions(posterior, simulator, rng)
    units = posterior.draw(draws, rng)
    names, scales = zip(*question.functions(posterior), strict=True)

    def judged(throws: list[Throw]) -> list[Suggestion]:
        """Judge throws, in their order."""
        suggestions: dict[int, Suggestion] = {}
        for members, reduction in expected_reductions(
            throws, posterior, directions, units, viewing, simulator, execution_error, rng
        ):
            gains = question.information(reduction)
            before = np.sqrt(np.diag(reduction.before)) * scales
            after = np.sqrt(reduction.variances) * scales
            for i, gain, left in zip(members, gains, after, strict=True):
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


@dataclass(frozen=True, eq=False)
class SuggestionRequest:
    """A request for throws, to a learner's database.

    Parameters
    ----------
    about : names of parameters; none, and no query: all that any throw can depend on
    query : whose answer is asked instead; None: parameters are
    object : id or material that an object of each throw must have; None: any
    position : (3, 2) m, range on each axis; None: as seen so far
    linear_velocity : (3, 2) m/s, likewise
    angular_velocity : (3, 2) rad/s, likewise
    count : of suggestions
    seed : of all randomness
    """

    about: tuple[str, ...] = ()
    query: AboutMotion | None = None
    object: str | None = None
    position: NDArray[np.float64] | None = None
    linear_velocity: NDArray[np.float64] | None = None
    angular_velocity: NDArray[np.float64] | None = None
    count: int = 5
    seed: int = 0

    def question(self, options: ThrowOptions, posterior: ParameterPosterior) -> Question:
        """Return what is asked, of throws and a posterior over all materials."""
        if self.query is not None:
            return self.query
        if self.about:
            return AboutParameters(self.about)
        influential = options.influential(posterior.materials)
        names = zip(posterior.space.names, influential, strict=True)
        return AboutParameters(tuple(name for name, matters in names if matters))


def suggest_from_store(
    store: ObservationStore,
    simulator: Simulator,
    request: SuggestionRequest,
) -> list[Suggestion]:
    """Return the most informative throws, the best first.

    Objects, environment, noise, rate and view are those of the newest stored observations, the view
    with all places from which may be thrown; what is known of θ_s is the newest version.

    Parameters
    ----------
    store : of observations and θ_s
    simulator : of throws and queries, by whose flag they are cancelled
    request : what is asked

    Raises
    ------
    NoObservationsError
        When nothing was observed yet.
    InvalidInputError, UnknownNameError
        When the request does not fit what was observed.
    SimulationStoppedError
        When the simulator's flag was set.
    StorageError
        When the database cannot be read.
    """
    newest = store.entries(statuses=(USED,), limit=MOST_OBSERVATIONS, newest=True)
    observations = store.observations([entry.id for entry in newest]) if newest else []
    options = ThrowOptions.of_observations(observations, request.object).between(
        request.position, request.linear_velocity, request.angular_velocity
    )
    learned = store.newest_parameters() or LearnedParameters.defaults(options.materials)
    asked = () if request.query is None else request.query.scene.materials
    used = {*options.materials, *asked}
    if request.about:
        used |= set(learned.materials)
    # In the order of all known materials, so that pairs keep their names.
    names = tuple(dict.fromkeys((*learned.materials, *options.materials, *asked)))
    materials = tuple(name for name in names if name in used)
    posterior = learned.whole_posterior().extended(materials)
    viewing = ViewingConditions.of_observations(observations, VIEW_MARGIN)
    return suggest(
        options,
        posterior,
        request.question(options, posterior),
        viewing.with_starts(options),
        simulator,
        np.random.default_rng(request.seed),
        count=request.count,
    )
