"""Whether the present estimate of θ_s is published, and the version that is.

What confirms what is published is published at once. What lies farther from it becomes its
challenger: both stay as they are while later observations are predicted by both, before anything
is learned from them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.parameter_posterior import (
    LARGEST_DEVIATION,
    UNIFORM_PRECISION,
)
from intuitive_physics.parameter_space import parameter_vector, parameters_of_vector
from intuitive_physics_learner.joint_estimation.joint_fit import LARGEST_VOTE
from intuitive_physics_learner.joint_estimation.profiles import (
    ends_in_si_units,
    interval_ends,
    is_one_sided,
    mean_square_moves,
)
from intuitive_physics_learner.joint_estimation.widened_uncertainty import (
    agreed_deviations,
    jackknife_variances,
    widened_information,
)
from intuitive_physics_learner.methods import JOINT_METHOD
from intuitive_physics_learner.online.lone_fit import LoneFit
from intuitive_physics_learner.online.online_state import OnlineState
from intuitive_physics_learner.search.gaussian import Gaussian

BEYOND = 0.5
"""Time beyond the fit horizon up to which predictions are compared, s: where an error shows
first."""

SURPRISING_MOVE = 1.0
"""Move of a parameter in standard deviations of what is published, beyond which later observations
must have been predicted better by it."""

FEWEST_COMPARED = 3
"""Number of these observations at least."""

STRAYED = 3.0
"""Move of a parameter in its standard deviations from a challenger, beyond which it is not what
these observations were predicted by."""

SMALLEST_MOVE = 0.1
"""Move of a parameter in its standard deviations that is worth a new version; set by hand."""

SMALLEST_NARROWING = 0.05
"""Part by which a standard deviation must change to be worth a new version; set by hand."""


def count_prediction(state: OnlineState, fit: LoneFit) -> None:
    """Add how much better the challenger predicts on from a fit than what is published."""
    if state.challenger is None:
        return
    horizon = fit.observation_fit.horizon + BEYOND
    challenger, published = (
        fit.log_evidence(horizon, information.bounded(state.centre))
        for information in (state.challenger, state.published_information)
    )
    state.score += float(np.clip(challenger - published, -LARGEST_VOTE, LARGEST_VOTE))
    state.compared += 1


def is_to_be_published(state: OnlineState) -> bool:
    """Whether the estimate says something new; where it has moved far, whether it has won."""
    if state.published is None or not state.posterior.precision.any():
        return bool(state.posterior.precision.any())
    if has_moved_far(state):
        near = state.challenger is not None and not _is_away(state, state.challenger, STRAYED)
        judged = state.compared >= FEWEST_COMPARED
        if near and (state.score > 0.0 or not judged):
            return judged
        state.begin_trial()
        return False
    published = state.published_information.bounded(state.centre)
    new = bool(_differs(state, published).any()) or _has_new_spins(state, state.published)
    if not new:
        state.end_trial()
    return new


def publish(state: OnlineState, cost: float) -> None:
    """Publish the estimate; `cost` is its J in m over the window."""
    state.published = next_version(state, cost)
    state.published_information = _widened(state, _deviations(state))
    state.end_trial()


def has_moved_far(state: OnlineState) -> bool:
    """Whether the estimate is farther from what is published than data that confirm it lead to."""
    return _is_away(state, state.published_information, SURPRISING_MOVE)


def next_version(state: OnlineState, cost: float) -> LearnedParameters:
    """Return the estimate as the next version of θ_s."""
    space, held, names = state.space, state.held, state.materials
    published = state.published or LearnedParameters.defaults(names)
    widths = _at_least(state, state.ends)
    information = _widened(state, widths).precision
    slopes = space.slopes(state.unit)
    covariance = np.linalg.inv(information + UNIFORM_PRECISION * np.eye(widths.size))
    covariance[held], covariance[:, held] = 0.0, 0.0
    deviations = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    one_sided = is_one_sided(state.free, widths) & ~held
    ends = interval_ends(state.unit, state.free, widths, one_sided)
    intervals = ends_in_si_units(space, state.unit, ends, np.arange(widths.size))
    known = published.whole_posterior().within(space.bounds)
    # A published interval stays as long as nothing has changed what is known of its parameter.
    new = _differs(state, Gaussian.of(known, held).bounded(state.centre))
    new |= np.isnan(known.intervals[:, 0])
    values, before = parameter_vector(state.parameters), parameter_vector(published.parameters)
    parameters = parameters_of_vector(names, np.where(new, values, before))
    identified = np.where(new, held | (widths < LARGEST_DEVIATION), published.identified)
    deviations = np.where(new, deviations, published.standard_deviations)
    posterior = known.renewed(new, space.to_unit(parameters), information, ends)
    if published.given is not None:
        posterior = published.given.imposed_on(posterior, parameters)
    return LearnedParameters(
        parameters=parameters,
        standard_deviations=np.where(held, 0.0, np.where(identified, deviations, np.nan)),
        identified=identified,
        version=published.version + 1,
        cost=cost,
        observation_count=state.used,
        method=JOINT_METHOD,
        intervals=np.where(new[:, None], intervals, published.intervals),
        posterior=posterior,
        given=published.given,
        initial_spins=state.initial_spins(),
    )


def _differs(state: OnlineState, before: Gaussian) -> NDArray[np.bool_]:
    """Which parameters (n,) are known otherwise than before, by more than is worth telling."""
    deviations = _deviations(state)
    moved = _distance(state, before) > SMALLEST_MOVE * deviations
    return moved | (np.abs(deviations / before.deviations - 1.0) > SMALLEST_NARROWING)


def _widened(state: OnlineState, widths: NDArray[np.float64]) -> Gaussian:
    """Return what is known, with wider standard deviations (n,), in widths."""
    mean, factors = state.prior.mean, widths / state.prior.deviations
    information = widened_information(state.posterior.precision, factors, widths)
    # Its mean is the same once the bounds count.
    pull = information @ mean + UNIFORM_PRECISION * (mean - state.centre)
    return Gaussian(information, pull)


def _deviations(state: OnlineState) -> NDArray[np.float64]:
    """Standard deviations (n,) about the estimate, widths, also of one-sided intervals."""
    return _at_least(state, np.sqrt(mean_square_moves(state.free, state.ends)))


def _at_least(state: OnlineState, least: NDArray[np.float64]) -> NDArray[np.float64]:
    """Standard deviations (n,), widths, that are at least as large as given ones (n,).

    At least those by slopes, and those by leaving out each observation of the window; with the
    spread of fits from several starts, and of what part of the observations said.
    """
    left_out = jackknife_variances(
        state.posterior,
        state.centre,
        [member.likelihood for member in state.window],
        np.array([member.weight for member in state.window]),
    )
    by_fit = np.maximum(state.prior.deviations, least) ** 2
    variances = np.maximum(by_fit, left_out) + state.spread
    widths = _agreed(state, np.sqrt(variances))
    return np.minimum(widths, UNIFORM_PRECISION**-0.5)


def _agreed(state: OnlineState, widths: NDArray[np.float64]) -> NDArray[np.float64]:
    """Widen standard deviations (n,) by how far the estimate is from an earlier one.

    From that of the last refit with at most half of the present observations: it is a fit to those,
    as `joint_search` makes one of half of them.
    """
    count = state.used - state.begun
    halves = [each for each in state.refitted if 2 * (each.used - state.begun) <= count]
    if not halves:
        return widths
    last = halves[-1]
    agreed = agreed_deviations(
        state.unit,
        widths,
        Gaussian.about(last.unit, np.diag(last.deviations**-2.0)),
        [np.arange(len(state.materials)), *state.families.values()],
        state.free,
        share=(last.used - state.begun) / count,
        balanced=False,
    )
    # What was known before all observations is as certain as it was.
    before = state.ground.bounded(state.centre).deviations
    return np.minimum(agreed, np.maximum(widths, before))


def _is_away(state: OnlineState, information: Gaussian, deviations: float) -> bool:
    """Whether the estimate is farther than some standard deviations from what something says."""
    prior = information.bounded(state.centre)
    return bool((_distance(state, prior) > deviations * prior.deviations).any())


def _distance(state: OnlineState, prior: Gaussian) -> NDArray[np.float64]:
    """Distance (n,) of the estimate from a mean, which may lie outside the bounds, in widths."""
    return np.abs(state.unit - np.clip(prior.mean, 0.0, 1.0))


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
