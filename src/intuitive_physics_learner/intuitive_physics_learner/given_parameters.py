"""Static parameters that a user gives: a start, a prior with σ, or values that are held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import (
    StaticParameters,
    parameter_key,
    parameter_names,
    parameter_places,
)
from intuitive_physics.parameter_posterior import (
    UNIFORM_PRECISION,
    ParameterPosterior,
    widened_bounds,
)
from intuitive_physics.parameter_space import (
    DEFAULT_BOUNDS,
    Bounds,
    parameter_vector,
    parameters_of_vector,
)
from intuitive_physics.prior_knowledge import GivenKnowledge
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins

PRIOR = "prior"
"""Normal distributions about the values with their standard deviations, where there are such."""

FIXED = "fixed"
"""Values that are held."""

START = "start"
"""Points to begin from."""

GIVEN_AS = (PRIOR, FIXED, START)
"""Uses of given values in searches."""

LARGEST_DIFFERENCE = 1e-6
"""Width by which values and the mean of their posterior may differ by rounding."""


def check_within_bounds(
    parameters: StaticParameters, chosen: NDArray[np.bool_], bounds: Mapping[str, Bounds] | None
) -> None:
    """Make sure that the values that are `chosen` (|θ_s|,) bool lie within the bounds."""
    limits = {**DEFAULT_BOUNDS, **(bounds or {})}
    names, values = parameter_names(parameters.materials), parameter_vector(parameters)
    for index in np.flatnonzero(chosen):
        limit, value = limits[names[index].split("[")[0]], values[index]
        if not limit.lower <= value <= limit.upper:
            raise InvalidInputError(
                f"{names[index]} is {value:g}; expected {limit.lower:g} to {limit.upper:g}, its "
                "bounds in a search: give another value or wider bounds"
            )


def given_parameters(
    given: LearnedParameters,
    as_what: str = PRIOR,
    names: Sequence[str] = (),
    *,
    newest: LearnedParameters | None = None,
    bounds: Mapping[str, Bounds] | None = None,
) -> LearnedParameters:
    """Return the version of θ_s that a user's values make.

    Parameters
    ----------
    given : the values, with standard deviations where they are priors
    as_what : one of `GIVEN_AS`. Of priors, one that is identified with a standard deviation of
        zero is held, and one without a standard deviation is a start.
    names : of the parameters that are given, as `parameter_names`, a pair's materials in any order;
        all others stay as they are in `newest`. None: all of `given`, and nothing stays but what is
        known of initial spins and not given.
    newest : version that is there; None: none
    bounds : that the values must lie within, by kind; what is left out has that of the posterior
        that is given, else its default

    Raises
    ------
    UnknownNameError
        When `as_what` or a name is not known.
    InvalidInputError
        When a value lies outside its bounds, or all are given with a posterior of other values.
    """
    if as_what not in GIVEN_AS:
        raise UnknownNameError(
            f"given values are {as_what!r}; expected one of {', '.join(GIVEN_AS)}"
        )
    if given.posterior is not None:
        bounds = {**given.posterior.bounds, **(bounds or {})}
    selection = np.ones(given.identified.size, dtype=bool)
    base = given
    if names:
        indices = parameter_indices(names, parameter_names(given.materials))
        selection = np.isin(np.arange(selection.size), indices)
        base = newest or LearnedParameters.defaults(given.materials)
        base = base.extended(tuple(dict.fromkeys((*base.materials, *given.materials))))
    check_within_bounds(given.parameters, selection, bounds)
    old, new = parameter_places(given.materials, base.materials)
    values = parameter_vector(base.parameters)
    deviations, identified = base.standard_deviations.copy(), base.identified.copy()
    intervals = base.intervals.copy()
    old, new = old[selection[old]], new[selection[old]]
    values[new] = parameter_vector(given.parameters)[old]
    deviations[new], identified[new] = _knowledge(given, as_what)[:, old]
    intervals[new] = np.nan if as_what == FIXED else given.intervals[old]
    merged = replace(
        base,
        parameters=parameters_of_vector(base.materials, values),
        standard_deviations=deviations,
        identified=identified,
        intervals=intervals,
        posterior=None,
        given=None,
        initial_spins=_spins(given, newest, names).among(base.materials),
    )
    chosen = np.zeros(values.size, dtype=bool)
    chosen[new] = True
    whole = None
    if not names and given.posterior is not None:
        whole = _checked_posterior(given.posterior, given.parameters)
    return _with_knowledge(merged, base, chosen, as_what, whole, bounds)


def _spins(
    given: LearnedParameters, newest: LearnedParameters | None, names: Sequence[str]
) -> InitialSpins:
    """How balls are thrown: no parameter of θ_s, so single ones leave it as it is."""
    spins = InitialSpins() if newest is None else newest.initial_spins
    return spins if names else spins.updated(given.initial_spins)


def _checked_posterior(
    posterior: ParameterPosterior, parameters: StaticParameters
) -> ParameterPosterior:
    """Make sure that a posterior is of the values that are given with it."""
    expected = posterior.space.to_unit(parameters)
    informative = posterior.factor.any(axis=0)
    other = np.flatnonzero(informative & (np.abs(expected - posterior.mean) > LARGEST_DIFFERENCE))
    if other.size:
        raise InvalidInputError(
            f"{parameter_names(parameters.materials)[other[0]]} is at {expected[other[0]]:g} of "
            f"its range and its posterior at {posterior.mean[other[0]]:g}; expected the same: "
            "values that are changed by hand come with standard deviations and no posterior"
        )
    return posterior


def parameter_indices(names: Sequence[str], all_names: Sequence[str]) -> list[int]:
    """Return the place of each name among all, with a pair's materials in any order.

    Raises `UnknownNameError` when there is no parameter of a name.
    """
    places = {parameter_key(name): k for k, name in enumerate(all_names)}
    for name in names:
        if parameter_key(name.strip()) not in places:
            raise UnknownNameError(
                f"parameter is {name!r}; expected one of the materials there are, such as "
                f"{all_names[0]!r} or {all_names[-1]!r}"
            )
    return [places[parameter_key(name.strip())] for name in names]


def _knowledge(given: LearnedParameters, as_what: str) -> NDArray[np.float64]:
    """Standard deviations and whether identified, (2, |θ_s|), of values that are given so."""
    deviations = given.standard_deviations
    if as_what == FIXED:
        return np.stack([np.zeros(deviations.size), np.ones(deviations.size)])
    stated = deviations > 0.0
    return np.stack(
        [
            np.where(stated | given.identified, deviations, np.nan),
            stated | given.identified if as_what == PRIOR else given.identified,
        ]
    )


def _with_knowledge(
    merged: LearnedParameters,
    base: LearnedParameters,
    chosen: NDArray[np.bool_],
    as_what: str,
    whole: ParameterPosterior | None,
    bounds: Mapping[str, Bounds] | None,
) -> LearnedParameters:
    """Return a version with its posterior, and with what was given of it, `chosen` (|θ_s|,)."""
    wide = widened_bounds(bounds or {}, merged.parameters)
    marginals = ParameterPosterior.from_marginals(
        merged.parameters,
        merged.standard_deviations,
        merged.identified & chosen,
        merged.intervals,
        wide,
    )
    if whole is not None and as_what != FIXED:
        marginals = whole.within(wide)
    nothing = np.zeros_like(marginals.information)
    earlier = base.given
    fixed = np.zeros(chosen.size, dtype=bool) if earlier is None else earlier.fixed & ~chosen
    prior = ParameterPosterior(merged.materials, marginals.mean, marginals.factor[:0], wide)
    stays = ParameterPosterior(
        merged.materials, marginals.mean, marginals.factor[:0], wide, marginals.intervals
    )
    if not chosen.all():
        stays = base.whole_posterior(bounds).within(wide)
        stays = stays.renewed(chosen, marginals.mean, nothing, marginals.intervals)
        if earlier is not None:
            prior = earlier.prior.within(wide)
            mean = np.where(chosen, marginals.mean, prior.mean)
            prior = prior.renewed(chosen, mean, nothing, marginals.intervals)
    held = chosen & (as_what == FIXED)
    if as_what == PRIOR:
        prior = prior.combined(_without_intervals(marginals, merged).factor)
        held = chosen & merged.identified & (merged.standard_deviations == 0.0)
    knowledge = GivenKnowledge(prior, fixed | held)
    posterior = ParameterPosterior(
        merged.materials,
        marginals.mean,
        stays.combined(marginals.factor).factor,
        wide,
        stays.intervals,
    )
    posterior = knowledge.imposed_on(posterior, merged.parameters)
    return replace(
        merged,
        posterior=posterior if posterior.factor.size else None,
        given=knowledge if knowledge.fixed.any() or knowledge.prior.factor.size else None,
    )


def _without_intervals(
    posterior: ParameterPosterior, learned: LearnedParameters
) -> ParameterPosterior:
    """Return a posterior in which one-sided intervals are standard deviations that contain them."""
    sided = ~np.isnan(posterior.intervals[:, 0])
    if not sided.any():
        return posterior
    lengths = np.diff(learned.intervals, axis=1)[:, 0]
    wide = ParameterPosterior.from_marginals(
        learned.parameters,
        np.hypot(learned.standard_deviations, lengths / np.sqrt(UNIFORM_PRECISION)),
        sided & learned.identified,
        np.full_like(learned.intervals, np.nan),
        posterior.bounds,
    )
    return posterior.renewed(sided, posterior.mean, wide.information, wide.intervals)
