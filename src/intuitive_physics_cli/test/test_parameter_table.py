from __future__ import annotations

from dataclasses import replace

import numpy as np

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.prior_knowledge import InitialSpins, SpinSpread
from intuitive_physics_cli.parameter_table import parameter_table, unidentified

MATERIALS = ("ball", "table")


def learned(*identified: str) -> LearnedParameters:
    parameters = StaticParameters.uniform(MATERIALS, restitution=0.8, rolling_friction=0.2)
    known = [name in identified for name in parameter_names(MATERIALS)]
    deviations = np.where(known, 0.01, np.nan)
    ends = np.full((len(known), 2), np.nan)
    ends[parameter_names(MATERIALS).index("dynamic_friction[ball, table]")] = 0.35, 1.0
    return LearnedParameters(parameters, deviations, known, 1, 0.02, 3, "cma_es", ends)


def test_what_is_known_is_a_row_and_a_bound_is_told() -> None:
    table = parameter_table(
        learned("restitution[ball, table]", "rolling_friction[ball, table]")
    ).splitlines()
    rows = {line.split("  ")[0]: line for line in table}
    assert rows["restitution[ball, table]"].split()[2:] == ["0.8", "0.01", "0.5"]
    assert rows["rolling_friction[ball, table]"].endswith("on its upper bound")


def test_ends_are_told_beside_the_deviation() -> None:
    table = parameter_table(learned("dynamic_friction[ball, table]")).splitlines()
    assert table[2].endswith("one-sided: 0.35 to 1")


def test_how_balls_are_thrown_has_a_line() -> None:
    spins = InitialSpins({"ball": SpinSpread(2.0, 16.4, 10.0)})
    table = parameter_table(replace(learned(), initial_spins=spins)).splitlines()
    expected = "initial spins: ball 2 ± 0.2 rad/s on each axis (from about 16 throws)"
    assert table[-1] == expected


def test_what_is_not_known_is_named_once() -> None:
    assert unidentified(learned("restitution[ball, table]", "density[ball]")) == [
        "density of table",
        "all of [ball, ball]",
        "static_friction, dynamic_friction, rolling_friction of [ball, table]",
        "all of [table, table]",
    ]


def test_everything_known_needs_no_last_line() -> None:
    assert unidentified(learned(*parameter_names(MATERIALS))) == []
    assert "not identified" not in parameter_table(learned(*parameter_names(MATERIALS)))
