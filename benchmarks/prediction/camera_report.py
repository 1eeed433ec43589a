"""The predictions in the camera's worlds, as tables, missed bars and key figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.prediction.camera import (
    AHEAD,
    ESTIMATE,
    FIXED,
    GUESS,
    KNOWN_SPIN,
    MOMENTS,
    Judged,
    JudgedWorld,
)
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics_predictor.scores.highest_density import WITHIN_TWO_SIGMA, coverage

WORLDS = (2.0, 10.0, 40.0)  # rad/s about each axis, of the spins of each world
RATIOS = (0.5, 1.0, 2.0)  # s ahead at which errors are compared
# Bars of the error over that with the known spin, 1 s ahead, by world
MOST_OVER_KNOWN = {
    "after_first_bounce": {2.0: 2.5, 10.0: 3.0, 40.0: 5.0},
    "after_second_bounce": dict.fromkeys(WORLDS, 1.3),
}

# The same in the first flight of a ball with a pattern, in every world
MOST_PATTERN_OVER_KNOWN = 2.0
# Bar of the error over that of the guess, in the first flight of the world of least spin
MOST_OVER_GUESS = 0.8
SPIN_BARS = (0.90, 0.99)  # bars of the share of spins within two standard deviations
# Bars of the share of balls that regions hold, by their probability
COVERAGE_BARS = {0.5: (0.45, 0.55), 0.9: (0.86, 0.94)}
FEWEST = 30  # predictions of which a share can be held against a bar: a first look has fewer

Worlds = Mapping[float, JudgedWorld]  # by spin, rad/s


def camera_figures(worlds: Worlds) -> dict[str, Any]:
    """Return the key figures."""
    everything = _of(worlds, MOMENTS)
    seconds = [each for world in worlds.values() for each in world.seconds]
    return {
        **{f"world_{spin:g}": _world_figures(spin, world) for spin, world in worlds.items()},
        "pattern_first_flight_error_over_known_spin": {
            f"world_{spin:g}": _ratio(world.patterned, KNOWN_SPIN, 1.0)
            for spin, world in worlds.items()
        },
        "first_flight_error_over_guess": {
            f"world_{spin:g}": _ratio(world.moments["first_flight"], GUESS, 1.0)
            for spin, world in worlds.items()
        },
        "coverage_50": _coverages(everything, 0.5),
        "coverage_90": _coverages(everything, 0.9),
        "energy_score_over_fixed_noise": _score_ratio(everything, FIXED),
        "energy_score_over_before": _score_ratio(_of(worlds, MOMENTS[1:]), GUESS),
        "estimate_ms": {
            "median": _rounded(1e3 * np.median(seconds)),
            "p99": _rounded(1e3 * np.quantile(seconds, 0.99)),
        },
    }


def camera_table(worlds: Worlds) -> Table:
    """Return one row for each world and moment."""
    rows = [
        [
            f"{spin:g}",
            name.replace("_", " "),
            len(moments[name]),
            *(1e3 * _median(moments[name], way, 1.0) for way in (ESTIMATE, KNOWN_SPIN, GUESS)),
            float(np.median([item.spin_error for item in moments[name]] or [np.nan])),
            100.0 * _within(moments[name]),
            100.0 * coverage(_levels(moments[name], 1.0), 0.5),
            100.0 * coverage(_levels(moments[name], 1.0), 0.9),
            _score_ratio(moments[name], GUESS),
            _score_ratio(moments[name], FIXED),
        ]
        for spin, moments in ((spin, _rows(world)) for spin, world in worlds.items())
        for name in moments
    ]
    return Table(
        title="Thrown balls that a rendered camera sees",
        note="Median error of the predicted mean 1 s ahead; the same from the perceived state with "
        "the true spin, and with a guess of 10 rad/s, as before there were estimates. Regions are "
        "of 1 s ahead; scores are over all times, over those of the guess.",
        columns=[
            Column("spins, rad/s", "rad/s"),
            Column("begins"),
            Column("predictions"),
            Column("error, mm", "mm", ".1f"),
            Column("known spin", "mm", ".1f"),
            Column("guess", "mm", ".1f"),
            Column("spin error", "rad/s", ".2f"),
            Column("within 2 σ, %", "%", ".0f"),
            Column("in 50 % region, %", "%", ".0f"),
            Column("in 90 %", "%", ".0f"),
            Column("energy score / guess", "", ".2f"),
            Column("/ fixed noise", "", ".2f"),
        ],
        rows=rows,
    )


def coverage_table(worlds: Worlds) -> Table:
    """Return how often regions hold the ball, one row for each world and one for all."""
    rows: list[list[Cell]] = []
    for name, judged in _by_world(worlds).items():
        for probability in COVERAGE_BARS:
            levels = _levels(judged, AHEAD[0])
            shares = _coverages(judged, probability).values()
            rows.append(
                [
                    name,
                    100.0 * probability,
                    len(levels),
                    100.0 * _error(probability, len(levels)),
                    *(None if share is None else 100.0 * share for share in shares),
                ]
            )
    return Table(
        title="How often regions hold the ball that a camera sees",
        note="Predictions from all moments together, by the time ahead. The error of a share is "
        "its binomial standard error; as the predictions of one throw are correlated, it is a "
        "little too small.",
        columns=[
            Column("world"),
            Column("region", "%", ".0f"),
            Column("predictions"),
            Column("error of a share", "%", ".1f"),
            *(Column(f"{ahead:g} s", "%", ".0f") for ahead in AHEAD),
        ],
        rows=rows,
    )


def camera_complaints(worlds: Worlds) -> list[str]:
    """Return the bars that were missed."""
    missed = []
    for name, bars in MOST_OVER_KNOWN.items():
        for spin, world in worlds.items():
            ratio = _ratio(world.moments[name], KNOWN_SPIN, 1.0)
            if ratio is not None and ratio > bars[spin]:
                missed.append(f"{name} of world_{spin:g}: error {ratio:.2f} of the known spin's")
    for spin, world in worlds.items():
        ratio = _ratio(world.patterned, KNOWN_SPIN, 1.0)
        if ratio is not None and ratio > MOST_PATTERN_OVER_KNOWN:
            missed.append(
                f"first flight with a pattern in world_{spin:g}: error {ratio:.2f} of the known "
                "spin's"
            )
    ratio = _ratio(worlds[WORLDS[0]].moments["first_flight"], GUESS, 1.0)
    if ratio is not None and ratio > MOST_OVER_GUESS:
        missed.append(f"first_flight of world_{WORLDS[0]:g}: error {ratio:.2f} of the guess's")
    return missed + _spin_complaints(worlds) + _coverage_complaints(worlds)


def _spin_complaints(worlds: Worlds) -> list[str]:
    """Moments at which spins are too seldom or too often within two standard deviations."""
    least, most = SPIN_BARS
    return [
        f"{name} of world_{spin:g}: {100 * share:.0f} % of {len(world.moments[name])} spins "
        "within 2 σ"
        for spin, world in worlds.items()
        for name in MOMENTS
        if len(world.moments[name]) >= FEWEST
        and not least <= (share := _within(world.moments[name])) <= most
    ]


def _coverage_complaints(worlds: Worlds) -> list[str]:
    """Regions that hold too much or too little, of each world by itself and of all together."""
    return [
        f"{name}: {100 * probability:.0f} % regions hold {100 * share:.0f} % after {ahead} s"
        for name, judged in _by_world(worlds).items()
        for probability, (least, most) in COVERAGE_BARS.items()
        for ahead, share in _coverages(judged, probability).items()
        if share is not None
        and len(_levels(judged, float(ahead))) >= FEWEST
        and not least <= share <= most
    ]


def _by_world(worlds: Worlds) -> dict[str, list[Judged]]:
    """Return the predictions of each world and of all together, by the name of the row."""
    single = {f"world_{spin:g}": _of({spin: world}, MOMENTS) for spin, world in worlds.items()}
    return {**single, "all": _of(worlds, MOMENTS)}


def _error(probability: float, count: int) -> float:
    """Standard error of the share of `count` predictions that their regions hold."""
    return float(np.sqrt(probability * (1.0 - probability) / count)) if count else float("nan")


def _rows(world: JudgedWorld) -> dict[str, list[Judged]]:
    """Return the predictions of a world by the name of the row."""
    return {**world.moments, "first_flight, pattern": world.patterned}


def _of(worlds: Worlds, names: Sequence[str]) -> list[Judged]:
    """Return the predictions at some moments."""
    return [item for world in worlds.values() for name in names for item in world.moments[name]]


def _world_figures(spin: float, world: JudgedWorld) -> dict[str, Any]:
    judged = _of({spin: world}, MOMENTS)
    return {
        **{name: _moment_figures(world.moments[name]) for name in MOMENTS},
        "coverage_50": _coverages(judged, 0.5),
        "coverage_90": _coverages(judged, 0.9),
    }


def _moment_figures(judged: Sequence[Judged]) -> dict[str, Any]:
    return {
        "predictions": len(judged),
        "error_over_known_spin": {f"{t:g}": _ratio(judged, KNOWN_SPIN, t) for t in RATIOS},
        "spin_error": _rounded(np.median([item.spin_error for item in judged] or [np.nan])),
        "spin_within_2_sigma": _rounded(_within(judged)),
    }


def _within(judged: Sequence[Judged]) -> float:
    return float(
        np.mean(np.array([item.spin_nees for item in judged]) < WITHIN_TWO_SIGMA)
        if judged
        else np.nan
    )


def _median(judged: Sequence[Judged], way: str, ahead: float) -> float:
    """Median error in m at a time ahead (s), of the predictions that can be judged there."""
    values = np.array([item.errors[way][AHEAD.index(ahead)] for item in judged] or [np.nan])
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else float("nan")


def _ratio(judged: Sequence[Judged], way: str, ahead: float) -> float | None:
    return _rounded(_median(judged, ESTIMATE, ahead) / _median(judged, way, ahead))


def _levels(judged: Sequence[Judged], ahead: float) -> NDArray[np.float64]:
    """Levels (n, 2) of the predictions that can be judged at a time ahead (s)."""
    levels = np.array([item.levels[AHEAD.index(ahead)] for item in judged]).reshape(-1, 2)
    return levels[np.isfinite(levels[:, 0])]


def _coverages(judged: Sequence[Judged], probability: float) -> dict[str, float | None]:
    return {f"{t:g}": _rounded(coverage(_levels(judged, t), probability)) for t in AHEAD}


def _score_ratio(judged: Sequence[Judged], way: str) -> float | None:
    """Sum of the energy scores of all times over that of another way to predict."""
    if not judged:
        return None
    scores = {name: np.nansum([item.scores[name] for item in judged]) for name in (ESTIMATE, way)}
    return _rounded(scores[ESTIMATE] / scores[way])


def _rounded(value: Any) -> float | None:
    return round(float(value), 3) if np.isfinite(value) else None
