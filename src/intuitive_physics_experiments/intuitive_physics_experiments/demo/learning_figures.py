"""What was learned: J over iterations (Fig. 6 of the paper), learned against true coefficients."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import PAIR_COEFFICIENTS, parameter_names
from intuitive_physics.parameter_space import parameter_vector
from intuitive_physics_cli.report.figure_style import DEFAULT, PREDICTED, TRUE
from intuitive_physics_experiments.demo.demo_result import LearningOutcome


def draw_cost(axes: Any, learning: LearningOutcome) -> None:
    """J over iterations, between the default parameters and the true ones, as in Fig. 6."""
    iterations = np.arange(1, learning.cost_history.size + 1)
    axes.axhline(1000.0 * learning.default_cost, color=DEFAULT, lw=1.4, ls="--", label="defaults")
    axes.plot(iterations, 1000.0 * learning.cost_history, color=PREDICTED, lw=2.0, label="learned")
    axes.axhline(1000.0 * learning.oracle_cost, color=TRUE, lw=1.4, ls=":", label="true parameters")
    axes.set(xlabel="iterations", ylabel="cost J (mm)", xscale="log", yscale="log")
    axes.set_xlim(1, iterations[-1])
    _plain_ticks(axes.yaxis)
    axes.grid(axis="y", which="both")
    axes.legend(loc="upper right")


def draw_coefficient(axes: Any, learning: LearningOutcome, coefficient: str) -> None:
    """One coefficient of the pairs that were identified or should have been, learned and true."""
    rows = identified_pairs(learning)
    labels = [" – ".join(pair) for pair in rows]
    for y, pair in enumerate(rows):
        _draw_parameter(axes, learning, coefficient, pair, len(rows) - 1 - y)
    axes.set_title(coefficient.replace("_", " "), loc="left", fontsize=10, weight="normal")
    axes.set_yticks(range(len(rows)), labels[::-1])
    axes.set_ylim(-0.6, len(rows) - 0.4)
    axes.set_xlim(0.0, 1.08 * axes.get_xlim()[1])
    axes.grid(axis="x")
    axes.spines["left"].set_visible(False)
    axes.tick_params(axis="y", length=0)


def parameter_legend() -> list[Any]:
    """Handles that explain `draw_coefficient`."""
    from matplotlib.lines import Line2D

    return [
        Line2D([], [], marker="|", ms=14, mew=2.2, color=TRUE, lw=0, label="true"),
        Line2D([], [], marker="o", ms=6, color=PREDICTED, lw=1.5, label="learned ± σ"),
        Line2D([], [], marker="o", ms=6, mfc="white", color=DEFAULT, lw=0, label="not identified"),
    ]


def _draw_parameter(
    axes: Any, learning: LearningOutcome, coefficient: str, pair: tuple[str, str], y: int
) -> None:
    learned = learning.learned
    names = parameter_names(learned.materials)
    index = names.index(f"{coefficient}[{pair[0]}, {pair[1]}]")
    value = parameter_vector(learned.parameters)[index]
    deviation = np.nan_to_num(learned.standard_deviations[index])
    axes.plot(learning.true.pair(*pair)[coefficient], y, "|", color=TRUE, ms=16, mew=2.2)
    if learned.identified[index]:
        axes.errorbar(
            value,
            y,
            xerr=_reach(value, deviation, learned.intervals[index]),
            fmt="o",
            color=PREDICTED,
            ms=6,
            capsize=0,
        )
    else:
        axes.plot(value, y, "o", mfc="white", color=DEFAULT, ms=6)


def _reach(value: float, deviation: float, ends: NDArray[np.float64]) -> list[list[float]]:
    """How far the bar goes down and up: a standard deviation, or to where J is as good."""
    low, high = np.fmin(value - deviation, ends[0]), np.fmax(value + deviation, ends[1])
    return [[value - float(low)], [float(high) - value]]


def identified_pairs(learning: LearningOutcome) -> list[tuple[str, str]]:
    """Pairs of which at least one coefficient was identified, in the learner's order."""
    learned = learning.learned
    pairs: dict[tuple[str, str], None] = {}
    for name, known in zip(parameter_names(learned.materials), learned.identified, strict=True):
        kind, _, rest = name.partition("[")
        if kind in PAIR_COEFFICIENTS and known:
            a, b = rest.rstrip("]").split(", ")
            pairs[(a, b)] = None
    return list(pairs)


def _plain_ticks(axis: Any) -> None:
    from matplotlib.ticker import LogLocator, ScalarFormatter

    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter(ScalarFormatter())
    axis.set_minor_locator(LogLocator(subs=()))
