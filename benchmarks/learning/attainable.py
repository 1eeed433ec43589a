"""What excess the observations of a set allow: that of draws about the true θ_s.

A learner that begins elsewhere has to find the neighbourhood of the truth among other optima. Here
θ_s is drawn about the truth with the covariance that the observations have there: once from the
points up to the estimator's fit horizons, once from all points. The first is what the estimator can
reach if it finds the right optimum. The second is a local bound: it assumes that all points can be
fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.command import Outcome
from benchmarks.learning.paper_sets import SIZES, Task, by_size, seeded_tasks
from benchmarks.learning.scores import excess
from benchmarks.results.result import Column, Table
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import (
    FIXED_HORIZONS,
    JointEstimationSettings,
    JointFit,
    ObservationFit,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import InitialStateDeviations
from intuitive_physics_learner.search.learning_task import LearningTask

ADVANCES = 20  # times that the fit horizons advance with everything held at the truth
DRAWS = 50  # of θ_s about the truth
# s by which a horizon advances at most at a time: the estimate needs no careful approach
LONGEST_ADVANCE = 1.0


@dataclass(frozen=True)
class Attainable:
    """What can be learned from the set of a seed.

    The horizon is the mean time in s up to which trajectories can be fitted at the truth; the
    excesses are means over draws about it, up to these horizons and with all points.
    """

    size: str
    seed: int
    horizon: float
    up_to_horizons: float
    all_points: float


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


def attainable_from(size: str, seed: int, task: Task) -> Attainable:
    """Draw about the truth of a set, with the covariance there."""
    settings = JointEstimationSettings(largest_advance=LONGEST_ADVANCE, scan_steps=())
    cost = task.training_cost()
    influence = parameter_influence(cost.observations, cost.materials)
    learning = LearningTask(cost, ParameterSpace(cost.materials), influence, task.start)
    truth = learning.searched.to_unit(task.dataset.parameters)
    held = true_fits(
        cost.observations,
        task.dataset.with_initial_states("true").training_observations,
    )
    growing, deviations = JointFit(learning.fit_task, settings), learning.prior.deviations
    held = _advanced(held, growing)
    for _ in range(ADVANCES):
        growing.begin_at(truth, deviations, held)
        growing.step()
        held, deviations = _advanced(held, growing), growing.deviations.copy()
    whole = [replace(fit, horizon=np.inf) for fit in held]
    excesses = []
    for fits in (held, whole):
        fit = JointFit(learning.fit_task, FIXED_HORIZONS, growing.model.stated_blocks)
        fit.begin_at(truth, deviations, fits)
        draws = _draws(fit, truth, np.random.default_rng(seed))
        parameters = [learning.searched.to_parameters(unit) for unit in draws]
        *costs, default = task.compared(task.exact_cost(), *parameters)
        excesses.append(np.mean([excess(each, task.oracle[2], default) for each in costs]))
    return Attainable(
        size,
        seed,
        horizon=float(np.mean([fit.horizon for fit in held])),
        up_to_horizons=float(excesses[0]),
        all_points=float(excesses[1]),
    )


def _draws(
    fit: JointFit, truth: NDArray[np.float64], rng: np.random.Generator
) -> NDArray[np.float64]:
    """Draw θ_s (DRAWS, n) on the unit cube about the truth (n,), by the likelihood there."""
    covariance = fit.prior.plus(fit.likelihoods()).covariance
    drawn = rng.multivariate_normal(truth, covariance, DRAWS)
    return np.clip(drawn, 0.0, 1.0)


def _advanced(held: Sequence[ObservationFit], fit: JointFit) -> list[ObservationFit]:
    """Take all but the initial states from a fit."""
    fits = fit.observation_fits()
    return [replace(new, estimate=old.estimate) for old, new in zip(held, fits, strict=True)]


def measure(quick: bool, first_seed: int) -> Outcome:
    """Draw about the truth of all sets of all sizes."""
    results = [
        attainable_from(name, seed, task) for name, seed, task in seeded_tasks(quick, first_seed)
    ]
    table = Table.of(
        "What the observations allow: draws about the true θ_s",
        results,
        [
            (Column("set"), lambda a: a.size),
            (Column("seed"), lambda a: a.seed),
            (Column("mean fit horizon", "s", ".2f"), lambda a: a.horizon),
            (Column("excess up to the horizons", "", ".3f"), lambda a: a.up_to_horizons),
            (Column("excess with all points", "", ".3f"), lambda a: a.all_points),
            (Column("bar", "", "g"), lambda a: SIZES[a.size].median),
        ],
        note=(
            f"Means over {DRAWS} draws of θ_s about the truth, with the covariance of the estimate "
            "there. Up to the fit horizons, as the estimator has them: what it can reach if it "
            "finds the right optimum. With all points: a local bound, as if all could be fitted."
        ),
    )
    return Outcome([table], key_figures={"attainable": figures(results)})


def figures(results: Sequence[Attainable]) -> dict[str, dict[str, float] | None]:
    """Return the entry of the last line: medians over the sets of each size, null for none."""
    entry: dict[str, dict[str, float] | None] = dict.fromkeys(SIZES)
    for name, group in by_size(results).items():
        entry[name] = {
            "up_to_horizons": round(float(np.median([a.up_to_horizons for a in group])), 4),
            "all_points": round(float(np.median([a.all_points for a in group])), 4),
        }
    return entry
