"""Static parameters that a user gives: a start, a prior with σ, or values that are held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError, UnknownNameError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names, parameter_places
from intuitive_physics.parameter_posterior import ParameterPosterior, widened_bounds
from intuitive_physics.parameter_space import DEFAULT_BOUNDS, Bounds, parameter_vector
from intuitive_physics.prior_knowledge.given_knowledge import GivenKnowledge
from intuitive_physics_learner.search.parameter_axes import parameters_of_vector

START, PRIOR, FIXED = "start", "prior", "fixed"

GIVEN_AS = (PRIOR, FIXED, START)
"""What given values can be to searches: normal distributions about the values with their standard
deviations, where there are such; values that are held; points to begin from. The first is the
default."""


def check_within_bounds(
    parameters: StaticParameters,
    chosen: NDArray[np.bool_],
    bounds: Mapping[str, Bounds] | None = None,
) -> None:
    """Make sure that values lie within the bounds of a search.

    Parameters
    ----------
    parameters : θ_s
    chosen : (|θ_s|,) bool, which values to look at
    bounds : by kind of parameter; what is left out has its default

    Raises
    ------
    InvalidInputError
        When one lies outside.
    """
    limits = {**DEFAULT_BOUNDS, **(bounds or {})}
    names, values = parameter_names(parameters.materials), parameter_vector(parameters)
    for index in np.flatnonzero(chosen):
        own, value = limits[names[index].split("[")[0]], values[index]
        if not own.lower <= value <= own.upper:
            raise InvalidInputError(
                f"{names[index]} is {value:g}; expected {own.lower:g} to {own.upper:g}, its "
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
    given : the values, with standard deviations where they are priors. A value that is neither
        identified nor has a standard deviation above zero is a start, whatever `as_what` says
        but `FIXED`.
    as_what : one of `GIVEN_AS`
    names : of the parameters that are given, as `parameter_names`, a pair's materials in any order;
        all others stay as they are in `newest`. None: all of `given`, and nothing stays.
    newest : version that is there; None: none
    bounds : that the values must lie within, by kind; what is left out has its default

    Raises
    ------
    UnknownNameError
        When `as_what` or a name is not known.
    InvalidInputError
        When a value lies outside its bounds, or the standard deviation of a prior is zero.
    """
    if as_what not in GIVEN_AS:
        raise UnknownNameError(
            f"given values are {as_what!r}; expected one of {', '.join(GIVEN_AS)}"
        )
    own = np.ones(given.identified.size, dtype=bool)
    base = given
    if names:
        own = _chosen(given, names)
        base = newest or LearnedParameters.defaults(given.materials)
        base = base.extended(tuple(dict.fromkeys((*base.materials, *given.materials))))
    check_within_bounds(given.parameters, own, bounds)
    old, new = parameter_places(given.materials, base.materials)
    values = parameter_vector(base.parameters)
    deviations, identified = base.standard_deviations.copy(), base.identified.copy()
    intervals = base.intervals.copy()
    old, new = old[own[old]], new[own[old]]
    values[new] = parameter_vector(given.parameters)[old]
    deviations[new], identified[new] = _knowledge(given, as_what)[:, old]
    intervals[new] = np.nan if as_what == FIXED else given.intervals[old]
    merged = LearnedParameters(
        parameters_of_vector(base.materials, values),
        deviations,
        identified,
        base.version,
        base.cost,
        base.observation_count,
        base.method,
        intervals,
    )
    chosen = np.zeros(values.size, dtype=bool)
    chosen[new] = True
    whole = None if names else given.posterior
    return _with_knowledge(merged, base, chosen, as_what, whole, bounds)


def _chosen(given: LearnedParameters, names: Sequence[str]) -> NDArray[np.bool_]:
    """Which parameters (|θ_s|,) have the names."""
    place = {_unordered(name): i for i, name in enumerate(parameter_names(given.materials))}
    chosen = np.zeros(len(place), dtype=bool)
    for name in names:
        if _unordered(name) not in place:
            raise UnknownNameError(
                f"parameter is {name!r}; expected one of the given materials, such as "
                f"{next(iter(parameter_names(given.materials)))!r} or "
                f"{parameter_names(given.materials)[-1]!r}"
            )
        chosen[place[_unordered(name)]] = True
    return chosen


def _unordered(name: str) -> tuple[str, tuple[str, ...]]:
    kind, _, rest = name.partition("[")
    if not rest.endswith("]"):
        return name, ()
    materials = rest[:-1].split(",") if kind != "density" else [rest[:-1]]
    return kind, tuple(sorted(material.strip() for material in materials))


def _knowledge(given: LearnedParameters, as_what: str) -> NDArray[np.float64]:
    """Standard deviations and whether identified, (2, |θ_s|), of values that are given so."""
    deviations = given.standard_deviations
    if as_what == FIXED:
        return np.stack([np.zeros(deviations.size), np.ones(deviations.size)])
    zero = np.flatnonzero(given.identified & (deviations == 0.0))
    if as_what == PRIOR and zero.size:
        raise InvalidInputError(
            f"{parameter_names(given.materials)[zero[0]]} has the standard deviation 0; expected "
            "one above 0 for a prior: a value that is known exactly is given as one that is held"
        )
    known = deviations > 0.0
    return np.stack(
        [
            np.where(known | given.identified, deviations, np.nan),
            known if as_what == PRIOR else given.identified,
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
    """Return a version with its posterior, and with what was given of it.

    Parameters
    ----------
    merged : the version, its values and standard deviations
    base : what stays of all that is not chosen
    chosen : (|θ_s|,) bool, which parameters are given
    as_what : one of `GIVEN_AS`
    whole : what is given of all parameters together; None: the standard deviations
    bounds : by kind
    """
    wide = widened_bounds(bounds or {}, merged.parameters)
    own = ParameterPosterior.from_marginals(
        merged.parameters,
        merged.standard_deviations,
        merged.identified & chosen,
        merged.intervals,
        wide,
    )
    if whole is not None and as_what != FIXED:
        own = whole.within(wide)
    nothing = np.zeros_like(own.information)
    known = base.given
    fixed = np.zeros(chosen.size, dtype=bool) if known is None else known.fixed & ~chosen
    stays = prior = ParameterPosterior(merged.materials, own.mean, own.factor[:0], wide)
    if not chosen.all():
        stays = base.whole_posterior(bounds).within(wide)
        stays = stays.renewed(chosen, own.mean, nothing, own.intervals)
        if known is not None:
            prior = known.prior.within(wide)
            mean = np.where(chosen, own.mean, prior.mean)
            prior = prior.renewed(chosen, mean, nothing, own.intervals)
    if as_what == PRIOR:
        prior = prior.combined(own.factor)
    knowledge = GivenKnowledge(prior, fixed | (chosen & (as_what == FIXED)))
    posterior = ParameterPosterior(
        merged.materials, own.mean, stays.combined(own.factor).factor, wide, stays.intervals
    )
    return LearnedParameters(
        merged.parameters,
        merged.standard_deviations,
        merged.identified,
        merged.version,
        merged.cost,
        merged.observation_count,
        merged.method,
        merged.intervals,
        knowledge.imposed_on(posterior, merged.parameters),
        knowledge if knowledge.fixed.any() or knowledge.prior.factor.size else None,
    )
