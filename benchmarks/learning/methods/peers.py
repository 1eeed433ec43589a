"""What a learner reaches in the same time when another engine simulates for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.methods.histories import joint_run
from benchmarks.learning.paper_sets import THREADS, Task, make_task
from benchmarks.peers.mujoco_simulator import MujocoSimulator
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import Rollout, Simulator, WorldBatch, make_simulator
from intuitive_physics.simulation.bullet import BulletSimulator
from intuitive_physics_learner import (
    ActiveSpace,
    ConvergenceCriteria,
    ParameterSearch,
    active_parameters,
    make_update_rule,
)

RULE = "bounded_adaptive_random"
"""Of the paper's rules the one that gains most from few evaluations of J."""

TIME_STEP = 0.01
"""s, of the other engines."""


class OneFrictionBullet(Simulator):
    """PyBullet, given μ_d for both frictions: it has one."""

    name = "bullet, one friction"

    def __init__(self) -> None:
        self._bullet = BulletSimulator(time_step=TIME_STEP)

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        coefficients = worlds.coefficients.copy()
        coefficients[:, 0] = coefficients[:, 1]
        return self._bullet._rollout(
            replace(worlds, coefficients=coefficients), times, orientations
        )


@dataclass(frozen=True)
class PeerResult:
    """What one engine reached.

    Parameters
    ----------
    name : of engine and method
    steps : evaluations of J in the time
    test : J in m over the test split, of what was learned, simulated by that engine
    oracle : J in m of the true θ_s, simulated by that engine
    how : how pairs of materials are mapped to it
    """

    name: str
    steps: int
    test: float
    oracle: float
    how: str


def compare_engines(seconds: float, seed: int) -> list[PeerResult]:
    """Learn one object's parameters from the training split of one set.

    Parameters
    ----------
    seconds : with each engine
    seed : of the set
    """
    task = make_task(1, seed)
    run = joint_run(task, seconds)
    results = [
        PeerResult(
            "auto, levenberg_marquardt",
            int(run.iterations[-1]),
            float(run.test[-1]),
            task.oracle[1],
            "exactly",
        )
    ]
    for name, simulator, how in (
        ("auto", make_simulator("auto", threads=THREADS), "exactly"),
        ("PyBullet", OneFrictionBullet(), "object against room exactly, μ_d for μ_s"),
        ("MuJoCo", MujocoSimulator(TIME_STEP), "μ_d for μ_s, a spring tuned to e"),
    ):
        results.append(_by_rule(make_task(1, seed, simulator), f"{name}, {RULE}", how, seconds))
    return results


def _by_rule(task: Task, name: str, how: str, seconds: float) -> PeerResult:
    cost = task.training_cost()
    space = ParameterSpace(task.start.materials)
    active = active_parameters(cost.observations, cost.materials)
    searched = ActiveSpace(space, active, task.start)
    begin = searched.to_unit(task.start)
    rule = make_update_rule(RULE, searched.size, np.random.default_rng(0), begin)
    criteria = ConvergenceCriteria(None, time_limit=seconds)
    found = ParameterSearch(cost.costs, searched, rule).run(criteria)
    test = float(task.test_cost().costs([found.parameters])[0])
    return PeerResult(name, found.iterations, test, task.oracle[1], how)
