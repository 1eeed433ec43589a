"""How quickly J is evaluated by threads of one process, and by processes of a Dask cluster."""

from __future__ import annotations

import time

import numpy as np

from benchmarks.learning.paper_sets import Task
from benchmarks.results.result import Cell, Column, Table
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import TrajectoryCost
from intuitive_physics_learner.cost.cluster import CostMaker
from intuitive_physics_learner.cost.cost_function import Cost

WORKERS = 2  # processes of the cluster, and threads that they are compared with
ROUNDS = 3  # rounds, of which the quickest counts


def compare_paces(task: Task, count: int) -> Table:
    """Evaluate J of the same random θ_s, `count` at once; ms are of one evaluation."""
    space = ParameterSpace(task.start.materials)
    points = np.random.default_rng(0).random((count, space.size))
    candidates = [space.to_parameters(point) for point in points]
    observations = task.dataset.training_observations

    def milliseconds(cost: Cost) -> float:
        cost.costs(candidates)
        seconds = []
        for _ in range(ROUNDS):
            began = time.perf_counter()
            cost.costs(candidates)
            seconds.append(time.perf_counter() - began)
        return 1e3 * min(seconds) / count

    rows: list[list[Cell]] = []
    for threads in (1, WORKERS):
        simulator = make_simulator("auto", threads=threads)
        cost = TrajectoryCost(observations, simulator, task.start.materials)
        rows.append([f"this process, threads: {threads}", milliseconds(cost)])
    with CostMaker(f"local:{WORKERS}") as make_cost:
        shared = make_cost(observations, make_simulator("auto", threads=1), task.start.materials)
        rows.append([f"Dask, processes: {WORKERS}", milliseconds(shared)])
    columns = [Column("where"), Column("ms", "ms", ".1f")]
    return Table("An evaluation of J over the training split, 10x50", columns, rows)
