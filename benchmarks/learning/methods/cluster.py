"""How quickly J is evaluated by threads of one process, and by processes of a Dask cluster."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from benchmarks.learning.paper_sets import Task
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.cluster import CostMaker
from intuitive_physics_learner.cost.cost_function import Cost

WORKERS = 2
"""Processes of the cluster, and threads that they are compared with."""

CANDIDATES = 20
"""Random θ_s that are evaluated at once."""

ROUNDS = 3
"""The quickest of them counts."""


@dataclass(frozen=True)
class Pace:
    """How long an evaluation of J takes.

    Parameters
    ----------
    where : it is evaluated
    milliseconds : an evaluation, the quickest of some rounds
    """

    where: str
    milliseconds: float


def compare_paces(task: Task) -> list[Pace]:
    """Evaluate J of the same random θ_s, `CANDIDATES` at once."""
    space = ParameterSpace(task.start.materials)
    points = np.random.default_rng(0).random((CANDIDATES, space.size))
    candidates = [space.to_parameters(point) for point in points]
    seen = task.dataset.training_observations

    def pace(where: str, cost: Cost) -> Pace:
        cost.costs(candidates)
        took = []
        for _ in range(ROUNDS):
            began = time.perf_counter()
            cost.costs(candidates)
            took.append(time.perf_counter() - began)
        return Pace(where, 1e3 * min(took) / CANDIDATES)

    paces = [
        pace(
            f"this process, threads: {threads}",
            TrajectoryCost(seen, make_simulator("auto", threads=threads), task.start.materials),
        )
        for threads in (1, WORKERS)
    ]
    with CostMaker(f"local:{WORKERS}") as make_cost:
        cost = make_cost(seen, make_simulator("auto", threads=1), task.start.materials)
        paces.append(pace(f"Dask, processes: {WORKERS}", cost))
    return paces
