"""The paper's synthetic sets (Sec. IV-B) as tasks of learning, beside the true θ_s."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from intuitive_physics.materials import StaticParameters
from intuitive_physics.simulation import Simulator, make_simulator
from intuitive_physics_experiments.paper.paper_dataset import PaperDataset, make_paper_dataset
from intuitive_physics_learner import TrajectoryCost

SAMPLES = 50
"""Of each object of a set."""

THREADS = 2
"""Of the learner's simulator."""

TOLERANCE = 0.05
"""Part of the oracle's J by which a learner may stay above it."""


@dataclass(frozen=True, eq=False)
class Task:
    """A set to learn from, an engine to learn with, and what the oracle reaches.

    Parameters
    ----------
    dataset : with the paper's initial states, from three points
    simulator : of the learner
    start : θ_s that joint estimation begins from
    oracle : J of the true θ_s in m, on the training and on the test split, and on the test split
        from the true initial states
    """

    dataset: PaperDataset
    simulator: Simulator
    start: StaticParameters
    oracle: tuple[float, float, float]

    def training_cost(self) -> TrajectoryCost:
        """J over the training split."""
        observations = self.dataset.training_observations
        return TrajectoryCost(observations, self.simulator, self.start.materials)

    def test_cost(self) -> TrajectoryCost:
        """J over the test split."""
        observations = self.dataset.test_observations
        return TrajectoryCost(observations, self.simulator, self.start.materials)

    def exact_cost(self) -> TrajectoryCost:
        """J over the test split from the true initial states, which depends on θ_s alone."""
        observations = self.dataset.with_initial_states("true").test_observations
        return TrajectoryCost(observations, self.simulator, self.start.materials)


def make_task(objects: int, seed: int, simulator: Simulator | None = None) -> Task:
    """Make the set of that seed."""
    dataset = make_paper_dataset(objects, SAMPLES, np.random.default_rng(seed))
    simulator = simulator or make_simulator("auto", threads=THREADS)
    start = StaticParameters.uniform(dataset.parameters.materials)
    task = Task(dataset, simulator, start, (np.nan, np.nan, np.nan))
    training, test, exact = (
        float(cost.costs([dataset.parameters])[0])
        for cost in (task.training_cost(), task.test_cost(), task.exact_cost())
    )
    return Task(dataset, simulator, start, (training, test, exact))
