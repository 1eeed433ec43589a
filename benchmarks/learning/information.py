"""A bound of what can be learned from a set: estimation that begins at the true θ_s and states.

A learner that begins elsewhere has to find the neighbourhood of the truth among other optima. One
that begins at the truth has not, so the rest of its excess is due to the noise of the points, and
to motion that is too sensitive to what is unknown to be fitted at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.command import Outcome
from benchmarks.learning.paper_sets import SIZES, Task, seeded_tasks
from benchmarks.learning.scores import excess
from benchmarks.results.result import Column, Table
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import JointFit, ObservationFit
from intuitive_physics_learner.joint_estimation.observation_blocks import InitialStateDeviations
from intuitive_physics_learner.joint_estimation.settings import JointEstimationSettings
from intuitive_physics_learner.search.learning_task import LearningTask

ADVANCES = 20  # times that the fit horizons advance with everything held at the truth
STEPS = 6  # steps of the fit that begins at the truth and then goes to where it fits best
# s by which a horizon advances at most at a time: the estimate needs no careful approach
LONGEST_ADVANCE = 1.0


@dataclass(frozen=True)
class Bound:
    """What can be learned from the set of a seed.

    The horizon is the mean time in s up to which trajectories can be fitted at the truth; the
    excess is that after one step from the truth, and after `STEPS`.
    """

    size: str
    seed: int
    horizon: float
    first: float
    last: float


def true_fits(observed: Sequence[Observation], true: Sequence[Observation]) -> list[ObservationFit]:
    """Return the true initial states as the result of a fit, with horizons of 0 s."""
    fits = []
    for observation, truth in zip(observed, true, strict=True):
        free = InitialStateDeviations.of(observation)
        pairs = zip(observation.objects, truth.objects, strict=True)
        deviations = np.array([_deviation(object_, true_) for object_, true_ in pairs])
        estimate = np.array([deviations[axis] for axis in free.axes])
        fits.append(ObservationFit(estimate, free.standard_deviations, 0.0))
    return fits


def _deviation(observed: ObservedObject, true: ObservedObject) -> NDArray[np.float64]:
    """Deviation (12,) of the true initial state from the observed one, as of its covariance."""
    here, there = observed.initial_state.to_vector(), true.initial_state.to_vector()
    turn = Rotation.from_quat(there[3:7]) * Rotation.from_quat(here[3:7]).inv()
    deviation = np.zeros(12)
    deviation[POSITION] = there[:3] - here[:3]
    deviation[ROTATION] = turn.as_rotvec()
    deviation[LINEAR_VELOCITY.start :] = there[7:] - here[7:]
    return deviation


def bound_of(size: str, seed: int, task: Task) -> Bound:
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
        return JointFit(learning.fit_task, of)

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
    first, last, default = task.compared(
        task.exact_cost(), space.to_parameters(units[0]), space.to_parameters(units[-1])
    )
    return Bound(
        size,
        seed,
        horizon=float(np.mean([fitted.horizon for fitted in held])),
        first=excess(first, task.oracle[2], default),
        last=excess(last, task.oracle[2], default),
    )


def _advanced(held: Sequence[ObservationFit], fit: JointFit) -> list[ObservationFit]:
    """Take all but the initial states from a fit."""
    fits = fit.observation_fits()
    return [replace(new, estimate=old.estimate) for old, new in zip(held, fits, strict=True)]


def measure(quick: bool, first_seed: int) -> Outcome:
    """Fit all sets of all sizes from their truth."""
    bounds = [bound_of(name, seed, task) for name, seed, task in seeded_tasks(quick, first_seed)]
    table = Table.of(
        "What the observations can tell: a fit that begins at the true θ_s and states",
        bounds,
        [
            (Column("set"), lambda b: b.size),
            (Column("seed"), lambda b: b.seed),
            (Column("mean fit horizon", "s", ".2f"), lambda b: b.horizon),
            (Column("excess after one step", "", ".3f"), lambda b: b.first),
            (Column(f"after {STEPS} steps", "", ".3f"), lambda b: b.last),
            (Column("bar", "", "g"), lambda b: SIZES[b.size].median),
        ],
        note=(
            "Everything is held at the truth while fit horizons advance as far as the posterior "
            "predicts trajectories; then θ_s and states are fitted. Such a fit knows which of many "
            "optima is the right one, so a learner that is given the observations alone does not "
            "do better on the average."
        ),
    )
    return Outcome([table])
