"""Learned static parameters θ_s: with the uncertainty of each value, and how they were learned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.limits import check_limit
from intuitive_physics.materials import (
    StaticParameters,
    parameter_names,
    parameter_places,
)
from intuitive_physics.parameter_posterior import ParameterPosterior, checked_intervals
from intuitive_physics.parameter_space import Bounds
from intuitive_physics.prior_knowledge import GivenKnowledge
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins
from intuitive_physics.validation import set_fields

FORMAT = "intuitive_physics/learned_parameters/2"
"""Format of files, which every file names."""

Known = TypeVar("Known", ParameterPosterior, GivenKnowledge)
"""Knowledge of the parameters of some materials."""


@dataclass(frozen=True, eq=False)
class LearnedParameters:
    """One version of θ_s.

    Parameters
    ----------
    parameters : θ_s
    standard_deviations : (|θ_s|,) in the order of `parameter_names(parameters.materials)`, each in
        its parameter's own SI unit, never negative; NaN where it is not known
    identified : (|θ_s|,) bool, same order: whether the observations determine this parameter; the
        value of one that they do not determine was not learned, whatever the search ended at
    version : grows with every improvement; 0 before anything was learned
    cost : J in m over the observations it was learned from (Eq. 8); NaN when there were none
    observation_count : number of those observations
    method : name of the update rule that found it, "" for version 0
    intervals : (|θ_s|, 2) in each parameter's SI unit: lower and upper end of the interval of
        values whose J is as small, for parameters with a one-sided interval, which the observations
        bound less to one side than the standard deviation says; NaN for all others
    posterior : of all parameters together; None: what the fields above say of each by itself
    given : what a user gave apart from the observations, for every search; None: nothing
    initial_spins : how balls of its materials are thrown; without any nothing is known of that
    """

    parameters: StaticParameters
    standard_deviations: NDArray[np.float64]
    identified: NDArray[np.bool_]
    version: int
    cost: float
    observation_count: int
    method: str
    intervals: NDArray[np.float64]
    posterior: ParameterPosterior | None
    given: GivenKnowledge | None
    initial_spins: InitialSpins

    def __init__(
        self,
        parameters: StaticParameters,
        standard_deviations: ArrayLike,
        identified: ArrayLike,
        version: int,
        cost: float,
        observation_count: int,
        method: str,
        intervals: ArrayLike | None = None,
        posterior: ParameterPosterior | None = None,
        given: GivenKnowledge | None = None,
        initial_spins: InitialSpins | None = None,
    ) -> None:
        size = len(parameter_names(parameters.materials))
        deviations = _vector(standard_deviations, "standard deviations", size, np.float64)
        if (deviations < 0.0).any() or np.isinf(deviations).any():
            raise InvalidInputError(
                f"standard deviations reach from {np.nanmin(deviations):g} to "
                f"{np.nanmax(deviations):g}; expected finite numbers ≥ 0, or NaN where not known"
            )
        spins = initial_spins or InitialSpins()
        spins.check_materials(parameters.materials)
        set_fields(
            self,
            parameters=parameters,
            standard_deviations=deviations,
            identified=_vector(identified, "identified", size, np.bool_),
            version=_count(version, "version"),
            cost=_cost(cost),
            observation_count=_count(observation_count, "observation count"),
            method=str(method),
            intervals=checked_intervals(intervals, size),
            posterior=_of_materials(posterior, parameters.materials),
            given=_of_materials(given, parameters.materials),
            initial_spins=spins,
        )

    @staticmethod
    def defaults(materials: Sequence[str]) -> LearnedParameters:
        """Version 0: default values, nothing identified."""
        size = len(parameter_names(materials))
        return LearnedParameters(
            StaticParameters.uniform(materials),
            np.full(size, np.nan),
            np.zeros(size, dtype=bool),
            version=0,
            cost=float("nan"),
            observation_count=0,
            method="",
        )

    @property
    def materials(self) -> tuple[str, ...]:
        """Names, in the order of `parameters.materials`."""
        return self.parameters.materials

    def whole_posterior(self, bounds: Mapping[str, Bounds] | None = None) -> ParameterPosterior:
        """Return what is known of all parameters together.

        Parameters
        ----------
        bounds : by kind of parameter, of what has no posterior of its own; what is left out has its
            default
        """
        return self.posterior or ParameterPosterior.from_marginals(
            self.parameters, self.standard_deviations, self.identified, self.intervals, bounds
        )

    def extended(self, materials: Sequence[str]) -> LearnedParameters:
        """Return the same for other materials: new ones have defaults that are not identified."""
        if tuple(materials) == self.materials:
            return self
        old, new = parameter_places(self.materials, materials)
        size = len(parameter_names(materials))
        deviations = np.full(size, np.nan)
        identified = np.zeros(size, dtype=bool)
        deviations[new] = self.standard_deviations[old]
        identified[new] = self.identified[old]
        intervals = np.full((size, 2), np.nan)
        intervals[new] = self.intervals[old]
        return replace(
            self,
            parameters=self.parameters.extended(materials),
            standard_deviations=deviations,
            identified=identified,
            intervals=intervals,
            posterior=None if self.posterior is None else self.posterior.extended(materials),
            given=None if self.given is None else self.given.extended(materials),
            initial_spins=self.initial_spins.among(materials),
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain data (numbers, strings, None for NaN) for JSON or YAML."""
        names = parameter_names(self.materials)
        return {
            "format": FORMAT,
            "version": self.version,
            "method": self.method,
            "cost": _none_for_nan(self.cost),
            "observation_count": self.observation_count,
            "materials": list(self.materials),
            "parameters": self.parameters.to_dict(),
            "standard_deviations": {
                name: _none_for_nan(float(sigma))
                for name, sigma in zip(names, self.standard_deviations, strict=True)
            },
            "identified": [name for name, yes in zip(names, self.identified, strict=True) if yes],
            "intervals": {
                name: ends.tolist()
                for name, ends in zip(names, self.intervals, strict=True)
                if not np.isnan(ends).any()
            },
            "posterior": None if self.posterior is None else self.posterior.to_dict(),
            "given": None if self.given is None else self.given.to_dict(),
            "initial_spins": self.initial_spins.to_dict(),
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> LearnedParameters:
        """Read what `to_dict` wrote.

        Raises
        ------
        InvalidInputError
            When a field is missing, of another format, or not what it must be.
        """
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            got = data.get("format") if isinstance(data, Mapping) else type(data).__name__
            raise InvalidInputError(
                f"learned parameters have the format {got!r}; expected {FORMAT!r}"
            )
        try:
            check_limit("most_materials", len(data["materials"]), "materials")
            parameters = _in_order(data["parameters"], data["materials"])
            names = parameter_names(parameters.materials)
            deviations = [_nan_for_none(data["standard_deviations"][name]) for name in names]
            known, ends = set(data["identified"]), dict(data.get("intervals", {}))
            posterior, given = data.get("posterior"), data.get("given")
            unknown = sorted((known | set(ends)) - set(names))
            if unknown:
                raise InvalidInputError(
                    f"{unknown[0]!r} is said to be identified; expected names of parameters of "
                    f"the materials {', '.join(parameters.materials)}"
                )
            return LearnedParameters(
                parameters,
                standard_deviations=deviations,
                identified=[name in known for name in names],
                version=data["version"],
                cost=_nan_for_none(data["cost"]),
                observation_count=data["observation_count"],
                method=data["method"],
                intervals=[ends.get(name, [np.nan, np.nan]) for name in names],
                posterior=None if posterior is None else ParameterPosterior.from_dict(posterior),
                given=None if given is None else GivenKnowledge.from_dict(given),
                initial_spins=InitialSpins.from_dict(data.get("initial_spins", {})),
            )
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"learned parameters cannot be read ({error}); expected version, method, cost, "
                "observation_count, materials, parameters, standard_deviations, identified"
            ) from None


def _of_materials(known: Known | None, materials: tuple[str, ...]) -> Known | None:
    if known is not None and known.materials != materials:
        raise InvalidInputError(
            f"what is known is of the materials {', '.join(known.materials)}; expected "
            f"{', '.join(materials)}, as the parameters"
        )
    return known


def _in_order(data: Mapping[str, Any], materials: Sequence[str]) -> StaticParameters:
    # A writer that sorts keys (YAML's default) must not change the order of the parameters.
    if sorted(materials) != sorted(data["density"]):
        raise InvalidInputError(
            f"learned parameters have densities of {sorted(data['density'])}; "
            f"expected those of the materials {sorted(materials)}"
        )
    return StaticParameters.from_dict(
        {**data, "density": {name: data["density"][name] for name in materials}}
    )


def _vector(value: ArrayLike, name: str, size: int, kind: type) -> NDArray[Any]:
    try:
        array: NDArray[Any] = np.array(value, dtype=kind)
    except (TypeError, ValueError):
        raise InvalidInputError(
            f"{name} is {value!r:.80}; expected {size} values, one for each parameter"
        ) from None
    if array.shape != (size,):
        raise InvalidInputError(
            f"{name} has shape {array.shape}; expected ({size},), one for each parameter"
        )
    return array


def _count(value: Any, name: str) -> int:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 0:
        raise InvalidInputError(f"{name} is {value!r}; expected a whole number ≥ 0")
    return int(value)


def _cost(value: Any) -> float:
    try:
        cost = float(value)
    except (TypeError, ValueError):
        raise InvalidInputError(f"cost is {value!r}; expected metres") from None
    if cost < 0.0 or np.isinf(cost):
        raise InvalidInputError(f"cost is {cost:g} m; expected a finite number ≥ 0, or NaN")
    return cost


def _none_for_nan(value: float) -> float | None:
    return None if np.isnan(value) else value


def _nan_for_none(value: float | None) -> float:
    return float("nan") if value is None else value
