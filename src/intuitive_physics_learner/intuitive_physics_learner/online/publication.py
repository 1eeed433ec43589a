"""Whether the present estimate of θ_s is published, and the version that is."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.parameter_posterior import (
    LARGEST_DEVIATION,
    UNIFORM_PRECISION,
    ParameterPosterior,
)
from intuitive_physics_learner.methods import JOINT_METHOD
from intuitive_physics_learner.online.information import jackknife_variances
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.search.identifiability import widened_information

SURPRISING_MOVE = 4.0
"""Move of a parameter in standard deviations of what is published, beyond which it needs the
evidence of a later observation: a chance of 6e-5."""

SMALLEST_MOVE = 0.1
"""Move of a parameter in its standard deviations that is worth a new version; set by hand."""

SMALLEST_NARROWING = 0.05
"""Part by which a standard deviation must change to be worth a new version; set by hand."""


def should_publish(state: OnlineState) -> bool:
    """Whether the estimate says something new, and predicted no worse than what is published."""
    if not state.posterior.matrix.any() or not _is_new(state):
        return False
    proven = state.published is None or state.compared > 0 or not _is_surprising(state)
    return proven and state.score >= 0.0


def next_version(state: OnlineState, cost: float) -> LearnedParameters:
    """Return the estimate as the next version of θ_s; `cost` is its J over the window."""
    space, held, published = state.space, state.held, state.published
    parameters, factors = state.parameters, _widening(state)
    widths = np.maximum(factors * state.prior.deviations, _jackknife_deviations(state))
    information = widened_information(state.posterior.matrix, factors, widths)
    posterior = ParameterPosterior.from_information(
        state.materials, space.to_unit(parameters), information, space.bounds
    )
    given = None if published is None else published.given
    if given is not None:
        posterior = given.imposed_on(posterior, parameters)
    identified = held | (widths < LARGEST_DEVIATION)
    slopes = space.slopes(state.unit)
    covariance = np.linalg.inv(information + UNIFORM_PRECISION * np.eye(widths.size))
    covariance[held], covariance[:, held] = 0.0, 0.0
    deviations = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    return LearnedParameters(
        parameters=parameters,
        standard_deviations=np.where(held, 0.0, np.where(identified, deviations, np.nan)),
        identified=identified,
        version=(0 if published is None else published.version) + 1,
        cost=cost,
        observation_count=state.processed - state.set_aside,
        method=JOINT_METHOD,
        posterior=posterior,
        given=given,
        initial_spins=state.initial_spins(),
    )


def _widening(state: OnlineState) -> NDArray[np.float64]:
    """Factors (n,) by which the stated standard deviations are too small, at least 1.

    A posterior mean is a martingale: the variance of a move is that by which the posterior
    narrows. An estimate that moves more than this was less certain than it was stated to be.
    """
    return np.sqrt(np.maximum((1.0 + state.moves) / (1.0 + state.narrowings), 1.0))


def _jackknife_deviations(state: OnlineState) -> NDArray[np.float64]:
    """Standard deviations (n,), widths, by leaving out each observation of the window."""
    variances = jackknife_variances(
        state.posterior,
        state.centre,
        [member.likelihood for member in state.window],
        np.array([member.weight for member in state.window]),
    )
    return np.sqrt(np.minimum(variances, 1.0 / UNIFORM_PRECISION))


def _is_surprising(state: OnlineState) -> bool:
    """Whether the estimate is farther from what is published than that allows."""
    published = state.published_information.prior(state.centre)
    away = np.abs(state.unit - published.mean)
    return bool((away > SURPRISING_MOVE * published.deviations).any())


def _is_new(state: OnlineState) -> bool:
    if state.published is None:
        return True
    published = state.published_information.prior(state.centre)
    deviations = state.prior.deviations
    moved = np.abs(state.unit - published.mean) > SMALLEST_MOVE * deviations
    changed = np.abs(deviations / published.deviations - 1.0) > SMALLEST_NARROWING
    return bool((moved | changed).any()) or _has_new_spins(state, state.published)


def _has_new_spins(state: OnlineState, published: LearnedParameters) -> bool:
    """Whether how balls are thrown is worth a new version, as the parameters are."""
    before = published.initial_spins.by_material
    for material, present in state.initial_spins().by_material.items():
        if material not in before:
            return True
        old, error = before[material], present.relative_error
        moved = abs(np.log(present.deviation / old.deviation)) > SMALLEST_MOVE * error
        if moved or abs(error / old.relative_error - 1.0) > SMALLEST_NARROWING:
            return True
    return False
