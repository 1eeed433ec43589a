"""How much the observations of a set can tell: estimation that begins at the true θ_s and states.

A learner that begins elsewhere has to find the neighbourhood of the truth among other optima. One
that begins at the truth has not, so what is left of its excess is due to the noise of the points,
and to motion that is too sensitive to what is unknown to be fitted at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.command import report_progress
from benchmarks.learning.paper_sets import Task, make_task
from benchmarks.learning.part import Findings, Part, Plan
from benchmarks.learning.scores import excess
from benchmarks.learning.sets import SIZES
from benchmarks.results.result import Column, Table
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit, ObservationFit
from intuitive_physics_learner.joint_estimation.observation_blocks import InitialStateDeviations
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings
from intuitive_physics_learner.search.learning_task import LearningTask

ADVANCES = 20
"""Times that the fit horizons advance with everything held at the truth."""

STEPS = 6
"""Steps of the fit that begins at the truth and then goes where it fits best."""

LONGEST_ADVANCE = 1.0
"""s by which a horizon advances at most at a time: the estimate needs no careful approach."""


@dataclass(frozen=True)
class Bound:
    """What a set tells.

    Parameters
    ----------
    seed : of the set
    horizon : s, mean of the times up to which trajectories can be fitted at the truth
    first, last : excess after one step from the truth, and after `STEPS`
    """

    seed: int
    horizon: float
    first: float
    last: float


def true_fits(observed: Sequence[Observation], true: Sequence[Observation]) -> list[ObservationFit]:
    """Return the true initial states as what a fit has found, with horizons of 0 s.

    Parameters
    ----------
    observed : with the initial states that a learner is given
    true : the same ones with their true initial states
    """
    fits = []
    for seen, truth in zip(observed, true, strict=True):
        free = InitialStateDeviations.of(seen)
        away = np.array([_away(a, b) for a, b in zip(seen.objects, truth.objects, strict=True)])
        estimate = np.array([away[axis] for axis in free.axes])
        fits.append(ObservationFit(estimate, free.standard_deviations, 0.0))
    return fits


def _away(seen: ObservedObject, true: ObservedObject) -> NDArray[np.float64]:
    """Deviation (12,) of the true initial state from the observed one, as of its covariance."""
    here, there = seen.initial_state.to_vector(), true.initial_state.to_vector()
    turn = Rotation.from_quat(there[3:7]) * Rotation.from_quat(here[3:7]).inv()
    away = np.zeros(12)
    away[POSITION] = there[:3] - here[:3]
    away[ROTATION] = turn.as_rotvec()
    away[LINEAR_VELOCITY.start :] = there[7:] - here[7:]
    return away


def bound_of(task: Task, seed: int) -> Bound:
    """Fit a set from its truth."""
    settings = JointEstimationSettings(largest_advance=LONGEST_ADVANCE, scan_steps=())
    cost = task.training_cost()
    influence = parameter_influence(cost.observations, cost.materials)
    learning = LearningTask(cost, ParameterSpace(cost.materials), influence, task.start)
    space, prior = learning.searched, learning.prior
    truth = space.to_unit(task.dataset.parameters)
    held = true_fits(
        cost.observations,
        task.dataset.with_initial_states("true").training_observations,
    )

    def fit(of: JointEstimationSettings) -> JointFit:
        return JointFit(cost, space, influence[:, learning.active], prior, of)

    growing, deviations = fit(settings), prior.deviations
    held = _advanced(held, growing)
    for _ in range(ADVANCES):
        growing.begin_at(truth, deviations, held)
        growing.step()
        held, deviations = _advanced(held, growing), growing.deviations.copy()
    free = fit(settings.with_fixed_horizons())
    free.begin_at(truth, deviations, held)
    units = []
    for _ in range(STEPS):
        free.step()
        units.append(free.unit)
    default, *found = task.exact_cost().costs(
        [task.start, space.to_parameters(units[0]), space.to_parameters(units[-1])]
    )
    first, last = (excess(float(one), task.oracle[2], float(default)) for one in found)
    return Bound(seed, float(np.mean([one.horizon for one in held])), first, last)


def _advanced(held: Sequence[ObservationFit], fit: JointFit) -> list[ObservationFit]:
    """Take all but the initial states from a fit."""
    found = fit.observation_fits()
    return [replace(b, estimate=a.estimate) for a, b in zip(held, found, strict=True)]


def measure(plan: Plan) -> Findings:
    """Fit all sets of all sizes from their truth."""
    found: dict[str, list[Bound]] = {}
    for name, size in SIZES.items():
        count = size.quick_sets if plan.quick else size.sets
        for number in range(count):
            report_progress(f"{name} from the truth, set {number + 1} of {count}")
            seed = plan.first_seed + number
            found.setdefault(name, []).append(bound_of(make_task(size.objects, seed), seed))
    return Findings(tables=[_table(found)])


def _table(found: dict[str, list[Bound]]) -> Table:
    return Table(
        title="What the observations can tell: a fit that begins at the true θ_s and states",
        columns=[
            Column("set"),
            Column("seed"),
            Column("mean fit horizon", "s", ".2f"),
            Column("excess after one step", "", ".3f"),
            Column(f"after {STEPS} steps", "", ".3f"),
            Column("bar", "", "g"),
        ],
        rows=[
            [name, each.seed, each.horizon, each.first, each.last, SIZES[name].median]
            for name, bounds in found.items()
            for each in bounds
        ],
        note=(
            "Everything is held at the truth while fit horizons advance as far as the posterior "
            "predicts trajectories; then θ_s and states are fitted. Such a fit knows which of many "
            "optima is the right one, so a learner that is given the observations alone does not "
            "do better on the average."
        ),
    )


INFORMATION = Part("information", (), measure)
"""The part that bounds what any learner could reach; measured where it is asked for."""
