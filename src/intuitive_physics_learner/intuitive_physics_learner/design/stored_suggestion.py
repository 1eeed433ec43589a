"""Suggestions from a learner's database: what was seen and learned there, and what is asked."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.simulation import Simulator
from intuitive_physics_learner.design.questions import AboutMotion, AboutParameters, Question
from intuitive_physics_learner.design.suggestion import Suggestion, suggest
from intuitive_physics_learner.design.throws import ThrowOptions, ViewingConditions
from intuitive_physics_learner.store import ObservationStore
from intuitive_physics_learner.store.observation_entries import USED

MOST_OBSERVATIONS = 500
"""Newest stored observations at most from which ranges, noise and view are read, so that a
suggestion takes as long after years as after a day; set by hand."""

VIEW_MARGIN = 0.1
"""Margin of the region in view around all observed positions, a part of its largest extent: few
tracks reach its edges; set by hand."""


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
    *,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[Suggestion]:
    """Return the most informative throws, the best first.

    Objects, environment, noise, rate and view are those of the newest stored observations, the view
    with all places from which may be thrown; what is known of θ_s is the newest version.

    Parameters
    ----------
    store : of observations and θ_s
    simulator : of throws and queries
    request : what is asked
    cancelled : polled between batches of simulations

    Raises
    ------
    NoObservationsError
        When nothing was observed yet.
    InvalidInputError, UnknownNameError
        When the request does not fit what was observed.
    LearningCancelledError
        When `cancelled` returned True.
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
        cancelled=cancelled,
    )
