"""Learning where a fifth of the throws was disturbed: excess, and which throws are set aside."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.command import report_progress
from benchmarks.learning.disturbances import Disturber
from benchmarks.learning.paper_sets import make_task
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.learning.public_learning import flagged_observations, learn_by_default
from benchmarks.learning.scores import excess
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics_experiments.paper.paper_dataset import PaperDataset
from intuitive_physics_experiments.paper.paper_room import dataset_simulator

SETS, QUICK_SETS = 6, 1
"""Random sets 1x50."""

SHARE = 0.2
"""Of the training throws that are disturbed."""

SECONDS = 4.0
"""Limit of wall time of learning, with its uncertainties."""

EXCESS_BAR, FLAGGED_BAR, FALSE_BAR = 0.1, 0.9, 0.05
"""Most excess, least share of disturbed throws that are flagged, largest share of good ones that
are, issue 17."""


@dataclass(frozen=True, eq=False)
class DisturbedSet:
    """What was learned from one set with disturbed throws.

    Parameters
    ----------
    seed : of the set
    kinds : what happened, by the id of a disturbed observation
    good : ids of the others
    flagged : ids that learning set aside; None where it does not assess observations
    excess : of J over unseen throws from true initial states
    undisturbed : excess of learning from the same throws before anything happened to them
    """

    seed: int
    kinds: dict[str, str]
    good: frozenset[str]
    flagged: Collection[str] | None
    excess: float
    undisturbed: float


def disturbed_set(
    dataset: PaperDataset, rng: np.random.Generator
) -> tuple[PaperDataset, dict[str, str]]:
    """Disturb a fifth of the training throws, the kinds in turn.

    Returns
    -------
    The set, and what happened by the id of each disturbed observation.
    """
    disturber = Disturber(dataset.parameters, dataset_simulator(dataset.engine), dataset.training)
    chosen = rng.permutation(len(dataset.training))[: round(SHARE * len(dataset.training))]
    training, kinds = list(dataset.training), {}
    for turn, number in enumerate(chosen):
        kind = list(disturber.kinds)[turn % len(disturber.kinds)]
        training[number] = disturber.disturb(dataset.training[number], kind, rng)
        kinds[training[number].observation.id] = kind
    return replace(dataset, training=tuple(training)), kinds


def learn_disturbed(seed: int, seconds: float) -> DisturbedSet:
    """Learn one set, disturbed and undisturbed."""
    task = make_task(1, seed)
    disturbed, kinds = disturbed_set(task.dataset, np.random.default_rng([seed, 1]))
    seen = disturbed.training_observations
    learned = learn_by_default(seen, seconds=seconds)
    undisturbed = learn_by_default(task.dataset.training_observations, seconds=seconds)
    candidates = [
        each.parameters.parameters.extended(task.start.materials) for each in (learned, undisturbed)
    ]
    costs = task.exact_cost().costs([*candidates, task.start])
    ours, before, default = costs.tolist()
    return DisturbedSet(
        seed,
        kinds,
        frozenset(each.id for each in seen) - set(kinds),
        flagged_observations(learned),
        excess(ours, task.oracle[2], default),
        excess(before, task.oracle[2], default),
    )


def counted(
    found: Sequence[DisturbedSet], kind: str | None = None
) -> tuple[int, int, int, int] | None:
    """Count flagged and all disturbed throws, then flagged and all good ones.

    Parameters
    ----------
    found : sets
    kind : of the disturbed throws that count; None: all

    Returns
    -------
    None where observations are not assessed.
    """
    counts = np.zeros(4, dtype=int)
    for each in found:
        if each.flagged is None:
            return None
        disturbed = {name for name, what in each.kinds.items() if kind in (None, what)}
        flagged = set(each.flagged)
        counts += (
            len(flagged & disturbed),
            len(disturbed),
            len(flagged & each.good),
            len(each.good),
        )
    hits, disturbed_count, false, good = counts.tolist()
    return hits, disturbed_count, false, good


def measure(plan: Plan) -> Findings:
    """Learn all sets."""
    sets = QUICK_SETS if plan.quick else SETS
    found = []
    for number in range(sets):
        report_progress(f"disturbed 1x50, set {number + 1} of {sets}")
        found.append(learn_disturbed(plan.first_seed + number, SECONDS))
    entry = figures(found)
    return Findings(
        tables=[_set_table(found), _kind_table(found)],
        figures={"disturbed": entry},
        complaints=_complaints(entry),
    )


def figures(found: Sequence[DisturbedSet]) -> dict[str, Any]:
    """Return the entry of the last line; null where observations are not assessed."""
    counts = counted(found)
    return {
        "excess": round(float(np.mean([each.excess for each in found])), 4),
        "flagged": None if counts is None else round(counts[0] / counts[1], 3),
        "false": None if counts is None else round(counts[2] / counts[3], 3),
    }


def _set_table(found: Sequence[DisturbedSet]) -> Table:
    rows: list[list[Cell]] = []
    for each in found:
        counts = counted([each])
        rows.append(
            [
                each.seed,
                f"{len(each.kinds)} of {len(each.kinds) + len(each.good)}",
                each.excess,
                EXCESS_BAR,
                each.undisturbed,
                1.0,
                None if counts is None else f"{counts[0]} of {counts[1]}",
                None if counts is None else f"{counts[2]} of {counts[3]}",
            ]
        )
    return Table(
        title="1x50, a fifth of the throws disturbed: J over unseen throws, true initial states",
        columns=[
            Column("seed"),
            Column("disturbed throws"),
            Column("excess", "", ".3f"),
            Column("bar of the mean", "", "g"),
            Column("excess without disturbances", "", ".3f"),
            Column("defaults' excess", "", "g"),
            Column("disturbed ones flagged"),
            Column("good ones flagged"),
        ],
        rows=rows,
    )


def _kind_table(found: Sequence[DisturbedSet]) -> Table:
    kinds = sorted({kind for each in found for kind in each.kinds.values()})
    rows: list[list[Cell]] = []
    for kind in kinds:
        counts = counted(found, kind)
        total = sum(kind == what for each in found for what in each.kinds.values())
        rows.append([kind, None if counts is None else counts[0], total])
    counts = counted(found)
    good = sum(len(each.good) for each in found)
    rows.append(["(good)", None if counts is None else counts[2], good])
    return Table(
        title="Throws that are flagged, by what happened to them",
        columns=[Column("what happened"), Column("flagged"), Column("of")],
        rows=rows,
        note=(
            f"Bars: at least {FLAGGED_BAR:.0%} of the disturbed and at most {FALSE_BAR:.0%} of the "
            "good ones. The defaults flag none."
        ),
    )


def _complaints(entry: dict[str, Any]) -> list[str]:
    complaints = []
    if entry["excess"] > EXCESS_BAR:
        complaints.append(f"disturbed: mean excess {entry['excess']:.3f}, bar {EXCESS_BAR:g}")
    if entry["flagged"] is None:
        complaints.append("disturbed: observations are not assessed")
        return complaints
    if entry["flagged"] < FLAGGED_BAR:
        complaints.append(f"disturbed: {entry['flagged']:.0%} flagged, bar {FLAGGED_BAR:.0%}")
    if entry["false"] > FALSE_BAR:
        complaints.append(f"disturbed: {entry['false']:.0%} false, bar {FALSE_BAR:.0%}")
    return complaints


DISTURBED = Part("disturbed", ("disturbed",), measure)
"""The part of disturbed throws."""
