"""Searches that are cancelled at random instants."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from intuitive_physics_msgs.msg import LearningOptions, ResultCode

from benchmarks.command import Outcome
from benchmarks.results.result import Column
from benchmarks.torture.bars import bars
from benchmarks.torture.early_end import noted
from benchmarks.torture.learner import Learner, running_learner
from benchmarks.torture.nodes import PATIENCE, thrown_ball
from benchmarks.torture.part import row_table
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Box
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_learner.methods import METHODS

LATEST = 3.0  # s of a search after which it is cancelled at the latest
LONG = 590.0  # s that boxes tumbled in an observation: a simulation of them takes seconds
LONG_EVERY = 4  # one search in this many learns from the long observation


def cancel(folder: Path, count: int, rng: np.random.Generator) -> Outcome:
    """Cancel `count` searches, some of which may have ended before."""
    took: list[float] = []
    failures: list[str] = []
    balls, boxes = [thrown_ball(number) for number in range(5)], _tumbling_boxes()
    with (
        noted(failures),
        running_learner(folder / "cancelled.sqlite3", online="false") as learner,
    ):
        for observation in (*balls, boxes):
            learner.add(observation)
        for number in range(count):
            chosen = [boxes] if number % LONG_EVERY == 0 else balls
            options = LearningOptions(
                method=str(rng.choice(sorted(METHODS))),
                max_iterations=1_000_000,
                observation_ids=[observation.id for observation in chosen],
            )
            _cancel_one(learner, options, rng.uniform(0.0, LATEST), took, failures)
    return _part(took, failures)


def _part(took: list[float], failures: list[str]) -> Outcome:
    longest = max(took, default=0.0)
    table = row_table(
        "Searches cancelled at random instants",
        "All methods; every fourth learns from boxes that tumble for minutes. Counted from "
        "the request to cancel to the result; searches that had ended before are left out.",
        [
            (Column("cancelled"), len(took)),
            (Column("median", "ms", ".0f"), 1e3 * float(np.median(took)) if took else None),
            (Column("longest", "ms", ".0f"), 1e3 * longest if took else None),
        ],
        failures,
    )
    missed = [*failures]
    if not took:
        missed.append("no search was cancelled")
    if longest > bars().cancel:
        missed.append(f"a search ended {longest:.2f} s after it was cancelled")
    return Outcome([table], {"cancel_s_worst": round(longest, 2)}, complaints=missed)


def _cancel_one(
    learner: Learner,
    options: LearningOptions,
    after: float,
    took: list[float],
    failures: list[str],
) -> None:
    """Start a search and cancel it after some seconds, unless it has ended before."""
    search, result = learner.search(options)
    learner.peer.spin_for(after)
    if result.done():
        return
    begin = time.monotonic()
    search.cancel_goal_async()
    end = learner.end_of(result, PATIENCE)
    took.append(time.monotonic() - begin)
    if end.value not in (ResultCode.CANCELLED, ResultCode.OK):
        failures.append(
            f"a cancelled search by {options.method} ended with {end.value} ({end.message})"
        )


def _tumbling_boxes() -> Observation:
    """Return an observation of boxes that tumble in a heap for minutes."""
    times = np.linspace(0.0, LONG, 30)
    boxes = tuple(
        ObservedObject(
            SceneObject(f"box {k}", "wood", Box((0.2, 0.1, 0.1))),
            Trajectory(times, np.tile([0.0, 0.0, 0.5 + k], (times.size, 1))),
            ObjectState((0.0, 0.0, 0.5 + k), angular_velocity=(1.0, 2.0, 3.0)),
        )
        for k in range(5)
    )
    return Observation(Environment([Plane("floor", "floor", (0, 0, 1), 0.0)]), boxes, 0.0, "boxes")
