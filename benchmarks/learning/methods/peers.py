"""What a learner reaches in the same time when another engine simulates for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchmarks.learning.methods.joint_run import joint_run
from benchmarks.learning.paper_sets import THREADS, Task, make_task
from benchmarks.results.result import Column, Table
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import Rollout, Simulator, WorldBatch, make_simulator
from intuitive_physics.simulation.bullet import BulletSimulator
from intuitive_physics_experiments.engines.mujoco_simulator import MujocoSimulator
from intuitive_physics_learner import (
    ActiveSpace,
    ConvergenceCriteria,
    ParameterSearch,
    active_parameters,
    make_update_rule,
)

RULE = "bounded_adaptive_random"  # the rule of the paper that gains most from few evaluations of J
TIME_STEP, CONTACT_TIME = 0.01, 0.06  # s, of the other engines' steps, and of a bounce in MuJoCo


class OneFriction(Simulator):
    """An engine with one friction coefficient, given μ_d for both."""

    name = "one friction"

    def __init__(self, engine: BulletSimulator | MujocoSimulator) -> None:
        self._engine = engine

    def _rollout(
        self, worlds: WorldBatch, times: NDArray[np.float64], orientations: bool
    ) -> Rollout:
        coefficients = worlds.coefficients.copy()
        coefficients[:, 0] = coefficients[:, 1]
        return self._engine._rollout(
            replace(worlds, coefficients=coefficients), times, orientations
        )


@dataclass(frozen=True)
class PeerResult:
    """What one engine reached: J in m over the test split, simulated by that engine.

    `steps` are evaluations of J in the time; `oracle` is J of the true θ_s.
    """

    name: str
    steps: int
    test: float
    oracle: float
    how: str  # pairs of materials are mapped to the engine


def compare_engines(seconds: float, seed: int) -> Table:
    """Learn one object's parameters from the training split of one set, with each engine."""
    task = make_task(1, seed)
    run = joint_run(task, seconds)
    steps, test = int(run.iterations[-1]), float(run.test[-1])
    results = [PeerResult("auto, levenberg_marquardt", steps, test, task.oracle[1], "exactly")]
    bullet = BulletSimulator(time_step=TIME_STEP)
    mujoco = MujocoSimulator(time_step=TIME_STEP, contact_time=CONTACT_TIME)
    for name, simulator, how in (
        ("auto", make_simulator("auto", threads=THREADS), "exactly"),
        ("PyBullet", OneFriction(bullet), "object against room exactly, μ_d for μ_s"),
        ("MuJoCo", OneFriction(mujoco), "μ_d for μ_s, a spring tuned to e"),
    ):
        results.append(_by_rule(make_task(1, seed, simulator), f"{name}, {RULE}", how, seconds))
    return Table.of(
        "One object, 50 samples: the same time with other engines as the learner's",
        results,
        [
            (Column("engine"), lambda r: r.name),
            (Column("steps"), lambda r: r.steps),
            (Column("test J, m", "m", ".3f"), lambda r: r.test),
            (Column("oracle's J, m", "m", ".3f"), lambda r: r.oracle),
            (Column("how pairs are mapped"), lambda r: r.how),
        ],
    )


def _by_rule(task: Task, name: str, how: str, seconds: float) -> PeerResult:
    cost = task.training_cost()
    space = ParameterSpace(task.start.materials)
    active = active_parameters(cost.observations, cost.materials)
    searched = ActiveSpace(space, active, task.start)
    begin = searched.to_unit(task.start)
    rule = make_update_rule(RULE, searched.size, np.random.default_rng(0), begin)
    criteria = ConvergenceCriteria(None, time_limit=seconds)
    search = ParameterSearch(cost.costs, searched, rule).run(criteria)
    test = float(task.test_cost().costs([search.parameters])[0])
    return PeerResult(name, search.iterations, test, task.oracle[1], how)
