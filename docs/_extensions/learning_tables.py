"""Tables of the learning page: bounds of the search, and the settings of the update rules."""

from __future__ import annotations

import inspect
from pathlib import Path

from markdown_table import code, table

from intuitive_physics.materials import DEFAULT_COEFFICIENTS, DEFAULT_DENSITY, PAIR_COEFFICIENTS
from intuitive_physics.parameter_space import DEFAULT_BOUNDS
from intuitive_physics_learner.search.update_rules import FURTHER_RULES, UPDATE_RULES


def pages(_: Path) -> dict[str, str]:
    """Return the tables, which the page includes, by their names."""
    return {"parameter_bounds.inc.md": _bounds(), "update_rules.inc.md": _rules()}


def _bounds() -> str:
    default = {"density": DEFAULT_DENSITY}
    default.update(zip(PAIR_COEFFICIENTS, DEFAULT_COEFFICIENTS, strict=True))
    rows = [
        (code(kind), f"{bounds.lower:g} to {bounds.upper:g}", bounds.scale, f"{default[kind]:g}")
        for kind, bounds in DEFAULT_BOUNDS.items()
    ]
    return table(("parameter", "bounds", "scale", "default"), rows)


def _rules() -> str:
    rows = []
    for name, rule in {**UPDATE_RULES, **FURTHER_RULES}.items():
        settings = [f"{code(key)} = {value:g}" for key, value in rule.defaults.items()]
        summary = (inspect.getdoc(rule) or "").partition("\n\n")[0]
        rows.append((code(name), summary, ", ".join(settings)))
    return table(("rule", "what it does", "settings and their defaults"), rows)
