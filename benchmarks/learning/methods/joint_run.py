"""How J falls with time on one of the paper's synthetic sets."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.paper_sets import TOLERANCE, Task
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_search import JointSearch
from intuitive_physics_learner.search.learning_task import LearningTask


@dataclass(frozen=True, eq=False)
class JointRun:
    """How joint estimation went on one set: arrays (n,) of the time after each step.

    The wall time is with the set-up, without the evaluations of J over the test split.
    """

    seconds: NDArray[np.float64]
    iterations: NDArray[np.int64]  # evaluations of J that would have simulated as much
    test: NDArray[np.float64]  # J in m over the test split
    exact: float  # J in m over the test split from the true initial states, in the end


def joint_run(task: Task, time_limit: float) -> JointRun:
    """Let joint estimation run until it has settled or the time is over."""
    test = task.test_cost()
    space = ParameterSpace(task.start.materials)
    began = time.perf_counter()
    cost = task.training_cost()
    influence = parameter_influence(cost.observations, cost.materials)
    learning = LearningTask(cost, space, influence, task.start)
    search = JointSearch(learning, np.random.default_rng(0))
    rows = []
    seconds = 0.0
    while seconds <= time_limit and search.step(1) > 0:
        stopped = time.perf_counter()
        seconds = stopped - began
        tested = float(test.costs([search.best_parameters])[0])
        rows.append((seconds, search.iterations, tested))
        # The clock stands still meanwhile.
        began += time.perf_counter() - stopped
    search.conclude()
    times, iterations, tests = np.array(rows).T
    exact = float(task.exact_cost().costs([search.best_parameters])[0])
    return JointRun(times, iterations.astype(np.int64), tests, exact)


def seconds_to_tolerance(run: JointRun, oracle: float) -> float:
    """Seconds from when on J over the test split stays within the tolerance; infinite if it ends
    above."""
    above = np.flatnonzero(run.test > (1.0 + TOLERANCE) * oracle)
    first = 0 if above.size == 0 else above[-1] + 1
    return float(run.seconds[first]) if first < run.seconds.size else np.inf


Joint = dict[str, tuple[Task, JointRun]]  # A task and its run of joint estimation, by set
