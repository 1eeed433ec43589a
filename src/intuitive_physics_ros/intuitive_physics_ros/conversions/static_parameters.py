"""`StaticParameters` messages and θ_s with its uncertainty; `ParameterBounds` messages."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from intuitive_physics_msgs.msg import PairCoefficients, ParameterBounds
from intuitive_physics_msgs.msg import StaticParameters as StaticParametersMessage
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.limits import check_limit
from intuitive_physics.materials import (
    PAIR_COEFFICIENTS,
    StaticParameters,
    material_pairs,
    pair_count,
    parameter_count,
)
from intuitive_physics.messages.fields import flat_array, float64_field, in_field
from intuitive_physics.parameter_posterior import ParameterPosterior
from intuitive_physics.parameter_space import DEFAULT_BOUNDS, Bounds, parameter_vector
from intuitive_physics.prior_knowledge.initial_spins import InitialSpins, SpinSpread
from intuitive_physics.validation import name_string

SCALES = {ParameterBounds.LINEAR: "linear", ParameterBounds.LOGARITHMIC: "logarithmic"}
"""Names of the scales by their code in a message."""

SPIN_FIELDS = {
    "spin_deviations": "deviation",
    "spin_counts": "count",
    "stated_spin_deviations": "stated",
}
"""Fields of a message with the fields of a `SpinSpread`, in the order of these."""


def static_parameters_to_message(
    learned: LearnedParameters, *, stamp: Time | None = None
) -> StaticParametersMessage:
    """Return a version of θ_s as a message.

    Parameters
    ----------
    learned : what to send; `LearnedParameters.defaults` for defaults
    stamp : when it was learned
    """
    m = len(learned.materials)
    values = parameter_vector(learned.parameters)[m:].reshape(-1, 4)
    deviations = learned.standard_deviations[m:].reshape(-1, 4)
    identified = learned.identified[m:].reshape(-1, 4)
    ends = learned.intervals[m:].reshape(-1, 4, 2)
    return StaticParametersMessage(
        header=Header(stamp=stamp or Time()),
        version=learned.version,
        materials=list(learned.materials),
        densities=float64_field(learned.parameters.density),
        density_standard_deviations=float64_field(learned.standard_deviations[:m]),
        density_lower_ends=float64_field(learned.intervals[:m, 0]),
        density_upper_ends=float64_field(learned.intervals[:m, 1]),
        density_identified=learned.identified[:m].tolist(),
        pairs=[
            PairCoefficients(
                material_a=a,
                material_b=b,
                **dict(zip(PAIR_COEFFICIENTS, values[i].tolist(), strict=True)),
                standard_deviations=deviations[i].copy(),
                lower_ends=ends[i, :, 0].copy(),
                upper_ends=ends[i, :, 1].copy(),
                identified=identified[i].tolist(),
            )
            for i, (a, b) in enumerate(material_pairs(learned.materials))
        ],
        cost=learned.cost,
        observation_count=learned.observation_count,
        method=learned.method,
        **_spin_fields(learned),
        **_posterior_fields(learned.posterior),
    )


def _spin_fields(learned: LearnedParameters) -> dict[str, Any]:
    spread_of = learned.initial_spins.by_material
    if not spread_of:
        return {}
    spreads = [spread_of.get(name) for name in learned.materials]
    return {
        field: float64_field([getattr(spread, name, np.nan) for spread in spreads])
        for field, name in SPIN_FIELDS.items()
    }


def _posterior_fields(posterior: ParameterPosterior | None) -> dict[str, Any]:
    if posterior is None:
        return {}
    return {
        "posterior_mean": float64_field(posterior.mean),
        "posterior_rank": len(posterior.factor),
        "posterior_factor": float64_field(posterior.factor),
        "posterior_bounds": bounds_to_messages(posterior.bounds),
        "posterior_lower_ends": float64_field(posterior.intervals[:, 0]),
        "posterior_upper_ends": float64_field(posterior.intervals[:, 1]),
    }


def static_parameters_from_message(message: StaticParametersMessage) -> LearnedParameters:
    """Return the version of θ_s that a message carries; its pairs may come in any order.

    Raises
    ------
    InvalidInputError
        When a list has not one element for each material, a pair is missing, stands twice or has
        an unknown material, or a value lies outside its range.
    """
    m = len(message.materials)
    # Before anything that grows with the number of pairs.
    check_limit("most_materials", m, "materials")
    materials = [name_string(name, "material") for name in message.materials]
    if len(set(materials)) != m:
        raise InvalidInputError(f"materials are {materials}; expected each name once")
    with in_field("densities"):
        density = flat_array(message.densities, (m,))
    pairs = _pairs_in_order(materials, message)
    coefficients = np.empty((len(PAIR_COEFFICIENTS), m, m))
    for (a, b), pair in zip(material_pairs(materials), pairs, strict=True):
        i, j = materials.index(a), materials.index(b)
        values = [getattr(pair, name) for name in PAIR_COEFFICIENTS]
        coefficients[:, i, j] = coefficients[:, j, i] = values
    deviations = _one_each(message.density_standard_deviations, "density_standard_deviations", m)
    identified = _one_each(message.density_identified, "density_identified", m)
    return LearnedParameters(
        StaticParameters(materials, density, coefficients),
        np.concatenate([deviations, *(pair.standard_deviations for pair in pairs)]),
        np.concatenate([identified, *(pair.identified for pair in pairs)]).astype(bool),
        version=message.version,
        cost=message.cost,
        observation_count=message.observation_count,
        method=message.method,
        intervals=_intervals(message, pairs),
        posterior=_posterior(message),
        initial_spins=_initial_spins(message),
    )


def _initial_spins(message: StaticParametersMessage) -> InitialSpins:
    m = len(message.materials)
    if not any(len(getattr(message, field)) for field in SPIN_FIELDS):
        return InitialSpins()
    columns = [_one_each(getattr(message, field), field, m) for field in SPIN_FIELDS]
    spreads = {}
    rows = np.stack(columns, axis=1).tolist()
    for material, numbers in zip(message.materials, rows, strict=True):
        if not np.isnan(numbers).all():
            with in_field(f"initial spins of {material}"):
                spreads[material] = SpinSpread(*numbers)
    return InitialSpins(spreads)


def _posterior(message: StaticParametersMessage) -> ParameterPosterior | None:
    if not len(message.posterior_mean):
        return None
    n = parameter_count(len(message.materials))
    with in_field("posterior_mean"):
        mean = flat_array(message.posterior_mean, (n,))
    with in_field("posterior_factor"):
        factor = flat_array(message.posterior_factor, (message.posterior_rank, n))
    with in_field("posterior_bounds"):
        bounds = bounds_from_messages(message.posterior_bounds)
    ends = [
        _one_each(getattr(message, field), field, n, "parameter")
        for field in ("posterior_lower_ends", "posterior_upper_ends")
    ]
    return ParameterPosterior(message.materials, mean, factor, bounds, np.stack(ends, axis=1))


def _intervals(
    message: StaticParametersMessage, pairs: list[PairCoefficients]
) -> NDArray[np.float64]:
    """Ends (|θ_s|, 2), NaN where a message has none."""
    m = len(message.materials)
    ends = []
    for side in ("lower", "upper"):
        field = f"density_{side}_ends"
        densities = list(getattr(message, field)) or [np.nan] * m
        by_pair = [getattr(pair, f"{side}_ends") for pair in pairs]
        ends.append(np.concatenate([_one_each(densities, field, m), *by_pair]))
    intervals = np.stack(ends, axis=1)
    # A message that nobody filled in has zeros.
    intervals[intervals[:, 0] == intervals[:, 1]] = np.nan
    return intervals


def _pairs_in_order(
    materials: list[str], message: StaticParametersMessage
) -> list[PairCoefficients]:
    by_pair = {frozenset((pair.material_a, pair.material_b)): pair for pair in message.pairs}
    expected = [frozenset(pair) for pair in material_pairs(materials)]
    missing = [sorted(pair) for pair in expected if pair not in by_pair]
    with in_field("pairs"):
        if missing:
            raise InvalidInputError(f"lack the pair of {missing[0]}; expected every unordered pair")
        if len(message.pairs) != pair_count(len(materials)):
            raise InvalidInputError(
                f"are {len(message.pairs)}; expected {pair_count(len(materials))}: each unordered "
                f"pair of {materials} once"
            )
    return [by_pair[pair] for pair in expected]


def _one_each(
    values: Sequence[float], field: str, count: int, each: str = "material"
) -> NDArray[np.float64]:
    with in_field(field):
        if len(values) != count:
            raise InvalidInputError(
                f"has {len(values)} elements; expected {count}, one for each {each}"
            )
    return np.array(values, dtype=np.float64)


def bounds_to_messages(bounds: Mapping[str, Bounds]) -> list[ParameterBounds]:
    """Return bounds by kind of parameter as messages."""
    codes = {scale: code for code, scale in SCALES.items()}
    return [
        ParameterBounds(kind=kind, lower=float(b.lower), upper=float(b.upper), scale=codes[b.scale])
        for kind, b in bounds.items()
    ]


def bounds_from_messages(messages: Sequence[ParameterBounds]) -> dict[str, Bounds]:
    """Return bounds by kind of parameter; an invalid or repeated kind is an InvalidInputError."""
    bounds: dict[str, Bounds] = {}
    for i, message in enumerate(messages):
        with in_field(f"bounds[{i}]"):
            if message.kind not in DEFAULT_BOUNDS or message.kind in bounds:
                raise InvalidInputError(
                    f"kind is {message.kind!r}; expected one of {', '.join(DEFAULT_BOUNDS)}, "
                    "each once"
                )
            if message.scale not in SCALES:
                raise InvalidInputError(
                    f"scale is {message.scale}; expected {ParameterBounds.LINEAR} (linear) "
                    f"or {ParameterBounds.LOGARITHMIC} (logarithmic)"
                )
            bounds[message.kind] = Bounds(message.lower, message.upper, SCALES[message.scale])
    return bounds
