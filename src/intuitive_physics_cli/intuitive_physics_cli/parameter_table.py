"""Learned parameters as text for people."""

from __future__ import annotations

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import (
    PAIR_COEFFICIENTS,
    StaticParameters,
    material_pairs,
    parameter_names,
)
from intuitive_physics.parameter_space import ParameterSpace, parameter_vector
from intuitive_physics_cli.terminal import format_table

NEAR_BOUND = 0.01
"""Share of a parameter's range that counts as its end."""


def parameter_table(learned: LearnedParameters) -> str:
    """Return a table of the identified parameters, and lines: the others, and how balls spin."""
    names = parameter_names(learned.materials)
    values = parameter_vector(learned.parameters)
    defaults = parameter_vector(StaticParameters.uniform(learned.materials))
    notes = parameter_notes(learned)
    rows = [
        [
            name,
            f"{values[i]:.4g}",
            f"{learned.standard_deviations[i]:.2g}",
            f"{defaults[i]:.4g}",
            notes[i],
        ]
        for i, name in enumerate(names)
        if learned.identified[i]
    ]
    table = format_table(["identified parameter", "learned", "± σ", "default", ""], rows)
    lines = [table]
    if unknown := unidentified(learned):
        lines.append(f"not identified: {'; '.join(unknown)}")
    if thrown := initial_spins(learned):
        lines.append(f"initial spins: {'; '.join(thrown)}")
    return "\n".join(lines)


def initial_spins(learned: LearnedParameters) -> list[str]:
    """Return how the balls of each material are thrown, where that is known."""
    return [
        f"{material} {spread.deviation:.2g} ± {spread.deviation * spread.relative_error:.1g} rad/s "
        f"on each axis (from about {spread.count:.0f} throws)"
        for material, spread in learned.initial_spins.by_material.items()
    ]


def parameter_notes(learned: LearnedParameters) -> list[str]:
    """Return a note for each parameter that its standard deviation does not fully describe.

    A parameter on a default bound points to an effect that the model lacks, or to bounds that are
    too narrow. One with a one-sided interval fits equally well between two values.
    """
    unit = ParameterSpace(learned.materials).to_unit(learned.parameters)
    notes = []
    for name, place, (low, high) in zip(
        parameter_names(learned.materials), unit, learned.intervals, strict=True
    ):
        if place < NEAR_BOUND:
            notes.append("on its lower bound")
        # The upper end of dynamic friction is the pair's static friction.
        elif place > 1.0 - NEAR_BOUND and not name.startswith("dynamic_friction"):
            notes.append("on its upper bound")
        else:
            notes.append("" if np.isnan(low) else f"one-sided: {low:.2g} to {high:.2g}")
    return notes


def unidentified(learned: LearnedParameters) -> list[str]:
    """Return the parameters that are not identifiable; a pair with none that is, is one entry."""
    identified = dict(zip(parameter_names(learned.materials), learned.identified, strict=True))
    densities = [name for name in learned.materials if not identified[f"density[{name}]"]]
    lines = [f"density of {', '.join(densities)}"] if densities else []
    for pair in material_pairs(learned.materials):
        missing = [
            kind for kind in PAIR_COEFFICIENTS if not identified[f"{kind}[{', '.join(pair)}]"]
        ]
        if len(missing) == len(PAIR_COEFFICIENTS):
            lines.append(f"all of [{', '.join(pair)}]")
        elif missing:
            lines.append(f"{', '.join(missing)} of [{', '.join(pair)}]")
    return lines
