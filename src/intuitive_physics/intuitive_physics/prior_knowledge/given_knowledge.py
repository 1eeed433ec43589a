"""Knowledge of θ_s from the user: priors with a standard deviation, and values that are held."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters, parameter_names, parameter_places
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.truncated_gaussian import compressed
from intuitive_physics.validation import set_fields


@dataclass(frozen=True, eq=False)
class GivenKnowledge:
    """Knowledge of θ_s apart from all observations, which every search honours.

    Parameters
    ----------
    prior : of the parameters that were given with a standard deviation; of all others nothing is
        known. Its mean has the held values.
    fixed : (|θ_s|,) bool in the order of `parameter_names(prior.materials)`: parameters whose
        values are held and never searched

    Raises
    ------
    InvalidInputError
        When `fixed` has not one element for each parameter.
    """

    prior: ParameterPosterior
    fixed: NDArray[np.bool_]

    def __init__(self, prior: ParameterPosterior, fixed: ArrayLike) -> None:
        held = np.array(fixed, dtype=bool)
        size = prior.mean.size
        if held.shape != (size,):
            raise InvalidInputError(
                f"held parameters have shape {held.shape}; expected ({size},), one for each "
                "parameter of the prior"
            )
        if (held & prior.factor.any(axis=0)).any():
            # What is known of others given the held values, which lie at the mean.
            factor = compressed(np.where(held, 0.0, prior.factor))
            prior = ParameterPosterior(
                prior.materials, prior.mean, factor, prior.bounds, prior.intervals
            )
        set_fields(self, prior=prior, fixed=held)

    @property
    def materials(self) -> tuple[str, ...]:
        """Names, in the order of the parameters."""
        return self.prior.materials

    def extended(self, materials: Sequence[str]) -> GivenKnowledge:
        """Return the same for other materials: of new ones nothing was given."""
        old, new = parameter_places(self.materials, materials)
        prior = self.prior.extended(materials)
        fixed = np.zeros(prior.mean.size, dtype=bool)
        fixed[new] = self.fixed[old]
        return GivenKnowledge(prior, fixed)

    def imposed_on(
        self, posterior: ParameterPosterior, parameters: StaticParameters
    ) -> ParameterPosterior:
        """Return a posterior in which the held values are known exactly.

        Parameters
        ----------
        posterior : of θ_s over the same materials, whose bounds contain the held values
        parameters : θ_s with the held values, at the mean of the posterior
        """
        if not self.fixed.any():
            return posterior
        exact = ParameterPosterior.from_marginals(
            parameters,
            np.zeros(self.fixed.size),
            self.fixed,
            np.full((self.fixed.size, 2), np.nan),
            posterior.bounds,
        )
        return posterior.combined(exact.factor)

    def to_dict(self) -> dict[str, Any]:
        """Return plain data (numbers, strings, lists) for JSON or YAML."""
        names = parameter_names(self.materials)
        return {
            "prior": self.prior.to_dict(),
            "fixed": [name for name, held in zip(names, self.fixed, strict=True) if held],
        }

    @staticmethod
    def from_dict(data: Mapping[str, Any]) -> GivenKnowledge:
        """Read what `to_dict` wrote.

        Raises
        ------
        InvalidInputError
            When a field is missing or not what it must be.
        """
        try:
            prior, held = ParameterPosterior.from_dict(data["prior"]), set(data["fixed"])
        except (KeyError, TypeError) as error:
            raise InvalidInputError(
                f"what was given of θ_s cannot be read ({error}); expected prior and fixed"
            ) from None
        names = parameter_names(prior.materials)
        unknown = sorted(held - set(names), key=str)
        if unknown:
            raise InvalidInputError(
                f"{unknown[0]!r} is said to be held; expected names of parameters of the "
                f"materials {', '.join(prior.materials)}"
            )
        return GivenKnowledge(prior, [name in held for name in names])
