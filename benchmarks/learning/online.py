"""What is published on-line, beside a fit to all, and after a floor has changed."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from benchmarks.command import report_progress
from benchmarks.learning.online_stream import published_after_each
from benchmarks.learning.paper_sets import make_task
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.learning.public_learning import learn_by_default
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.shapes import Sphere
from intuitive_physics_experiments.paper.paper_dataset import throw_objects
from intuitive_physics_experiments.paper.paper_room import (
    ROOM_MATERIAL,
    dataset_simulator,
    draw_parameters,
    draw_pool,
)

SETS, QUICK_SETS = 3, 1
"""Random sets 1x50 of which all training observations come one by one."""

QUICK_OBSERVATIONS = 6
"""Of a set with `--quick`."""

STREAMS, QUICK_STREAMS = 3, 1
"""Random streams in which restitution falls."""

SECONDS = 1.0
"""CPU time that may be spent on-line on each observation; the node's default is more."""

ONLINE_BAR = 1.1
"""J of what is published over that of the fit to all at most, issue 17."""

BEFORE, AFTER = 0.8, 0.7
"""Restitution of the ball and the room before and after the change."""

OBSERVATIONS_BEFORE = 15
"""Before the change."""

MOST_OBSERVATIONS_AFTER, QUICK_OBSERVATIONS_AFTER = 30, 4
"""After the change, before it counts as not noticed."""

DRIFT_TOLERANCE = 0.01
"""Of the published restitution."""

DRIFT_BAR = 15.0
"""Observations after the change at most, issue 17."""

WORKERS = 2
"""Processes side by side, each with one thread."""


@dataclass(frozen=True)
class Comparison:
    """On-line learning and a fit to all on one set.

    Parameters
    ----------
    seed : of the set
    observations : that came
    online, batch, default, oracle : J in m over unseen throws from the true initial states, of what
        was published last, of the fit, of the defaults, of the true θ_s
    versions : that were published
    """

    seed: int
    observations: int
    online: float
    batch: float
    default: float
    oracle: float
    versions: int

    @property
    def ratio(self) -> float:
        """J of what was published over that of the fit to all."""
        return self.online / self.batch


@dataclass(frozen=True)
class Drift:
    """How a change was followed in one stream.

    Parameters
    ----------
    seed : of the stream
    restitutions : published value after each observation, from the last before the change on
    """

    seed: int
    restitutions: tuple[float, ...]

    @property
    def observations(self) -> float:
        """After the change, until the published value is within the tolerance; infinite: never."""
        for count, value in enumerate(self.restitutions[1:], start=1):
            if abs(value - AFTER) <= DRIFT_TOLERANCE:
                return float(count)
        return float("inf")


def compare(seed: int, observations: int | None) -> Comparison:
    """Learn one set on-line and at once.

    Parameters
    ----------
    seed : of the set
    observations : that come; None: the whole training split
    """
    task = make_task(1, seed)
    seen = task.dataset.training_observations[:observations]
    with tempfile.TemporaryDirectory() as folder:
        *_, published = published_after_each(seen, Path(folder) / "learner.sqlite3", SECONDS)
    fitted = learn_by_default(seen, threads=1).parameters
    materials = task.start.materials
    candidates = [
        published.parameters.extended(materials),
        fitted.parameters.extended(materials),
        task.start,
    ]
    online, batch, default = task.exact_cost().costs(candidates).tolist()
    return Comparison(seed, len(seen), online, batch, default, task.oracle[2], published.version)


def changing_stream(seed: int, after: int) -> Iterator[Observation]:
    """Yield throws of a ball, `after` of them once restitution has fallen."""
    rng = np.random.default_rng(seed)
    pool = draw_pool(1, rng, [Sphere.kind])
    simulator = dataset_simulator("auto")
    drawn = draw_parameters(pool, rng)
    for count, restitution in ((OBSERVATIONS_BEFORE, BEFORE), (after, AFTER)):
        true = drawn.with_pair(pool[0].material, ROOM_MATERIAL, restitution=restitution)
        for _ in range(count):
            yield throw_objects(pool, true, simulator, "three_points", rng).observation


def follow_change(seed: int, after: int) -> Drift:
    """Learn one stream on-line until the change is followed, or `after` observations of it."""
    restitutions: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        stream = changing_stream(seed, after)
        for published in published_after_each(stream, Path(folder) / "learner.sqlite3", SECONDS):
            restitutions.append(_restitution(published.parameters))
            drift = Drift(seed, tuple(restitutions[OBSERVATIONS_BEFORE - 1 :]))
            if np.isfinite(drift.observations):
                break
    return drift


def _restitution(parameters: StaticParameters) -> float:
    (ball,) = (name for name in parameters.materials if name != ROOM_MATERIAL)
    return parameters.pair(ball, ROOM_MATERIAL)["restitution"]


def measure(plan: Plan) -> Findings:
    """Learn all sets and all streams, several at a time."""
    sets, streams = (QUICK_SETS, QUICK_STREAMS) if plan.quick else (SETS, STREAMS)
    observations = QUICK_OBSERVATIONS if plan.quick else None
    after = QUICK_OBSERVATIONS_AFTER if plan.quick else MOST_OBSERVATIONS_AFTER
    report_progress(f"{sets} sets and {streams} changing streams on-line")
    with ProcessPoolExecutor(WORKERS, get_context("spawn")) as pool:
        first = plan.first_seed
        compared = pool.map(compare, range(first, first + sets), [observations] * sets)
        followed = pool.map(follow_change, range(first, first + streams), [after] * streams)
        comparisons, drifts = list(compared), list(followed)
    ratio = max(each.ratio for each in comparisons)
    drift = mean_drift(drifts)
    complaints = []
    if ratio > ONLINE_BAR:
        complaints.append(f"online_over_batch: {ratio:.2f}, bar {ONLINE_BAR:g}")
    if drift is None or drift > DRIFT_BAR:
        shown = "not in every stream" if drift is None else f"{drift:g}"
        complaints.append(f"drift_observations: {shown}, bar {DRIFT_BAR:g}")
    return Findings(
        tables=[_comparison_table(comparisons), _drift_table(drifts)],
        figures={"online_over_batch": round(ratio, 3), "drift_observations": drift},
        complaints=complaints,
    )


def mean_drift(drifts: Sequence[Drift]) -> float | None:
    """Return the mean number of observations until a change is followed; None where one is not."""
    mean = float(np.mean([drift.observations for drift in drifts]))
    return round(mean, 2) if np.isfinite(mean) else None


def _comparison_table(comparisons: Sequence[Comparison]) -> Table:
    rows: list[list[Cell]] = [
        [
            each.seed,
            each.observations,
            each.versions,
            each.online,
            each.batch,
            each.default,
            each.oracle,
            each.ratio,
            each.default / each.batch,
            ONLINE_BAR,
        ]
        for each in comparisons
    ]
    return Table(
        title="Published on-line against a fit to all: J over unseen throws, true initial states",
        columns=[
            Column("seed"),
            Column("observations"),
            Column("versions"),
            Column("on-line", "m", ".3f"),
            Column("fit to all", "m", ".3f"),
            Column("defaults", "m", ".3f"),
            Column("true θ_s", "m", ".3f"),
            Column("on-line / fit", "", ".2f"),
            Column("defaults / fit", "", ".2f"),
            Column("bar", "", "g"),
        ],
        rows=rows,
        note=(
            f"Observations come one by one, {SECONDS:g} s of CPU time each; the fit ends by the "
            "library's own limit of evaluations of J. The worst set counts."
        ),
    )


def _drift_table(drifts: Sequence[Drift]) -> Table:
    rows: list[list[Cell]] = [
        [
            each.seed,
            each.restitutions[0],
            each.restitutions[-1],
            len(each.restitutions) - 1,
            each.observations,
            DRIFT_BAR,
        ]
        for each in drifts
    ]
    return Table(
        title=f"Restitution falls from {BEFORE:g} to {AFTER:g} in a stream",
        columns=[
            Column("seed"),
            Column("published before", "", ".3f"),
            Column("published last", "", ".3f"),
            Column("observations after the change"),
            Column(f"until within {DRIFT_TOLERANCE:g}", "", "g"),
            Column("bar of the mean", "", "g"),
        ],
        rows=rows,
        note=(
            f"{OBSERVATIONS_BEFORE} throws of a ball before the change. The defaults' "
            f"restitution is {_default_restitution():g} and never within {DRIFT_TOLERANCE:g}."
        ),
    )


def _default_restitution() -> float:
    return StaticParameters.uniform(("ball", ROOM_MATERIAL)).pair("ball", ROOM_MATERIAL)[
        "restitution"
    ]


ONLINE = Part("online", ("online_over_batch", "drift_observations"), measure)
"""The part of on-line learning."""
