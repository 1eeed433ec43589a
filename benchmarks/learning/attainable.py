"""What excess the observations of a set allow: that of draws about the true θ_s.

A learner that begins elsewhere has to find the neighbourhood of the truth among other optima. Here
θ_s is drawn about the truth with the covariance that the observations have there, from the points
up to the fit horizons of an estimator that is helped ever less:

- all points: a local bound, which assumes that all can be fitted;
- as far as trajectories can be predicted from the true initial states;
- as far as they can be fitted, with θ_s held at the truth, from the initial states observed. Only
  θ_s is left to be found, so the estimator itself cannot be expected to do better.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from benchmarks.command import Outcome
from benchmarks.learning.paper_sets import (
    SIZES,
    Task,
    by_size,
    make_task,
    seeds_of_sizes,
    side_by_side,
)
from benchmarks.learning.scores import excess
from benchmarks.results.result import Column, Table
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.parameter_space import ParameterSpace
from intuitive_physics.simulation import make_simulator
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ROTATION
from intuitive_physics_learner.cost.parameter_influence import parameter_influence
from intuitive_physics_learner.joint_estimation.joint_fit import (
    FIXED_HORIZONS,
    HELD_PRECISION,
    JointEstimationSettings,
    JointFit,
    ObservationFit,
)
from intuitive_physics_learner.joint_estimation.observation_blocks import InitialStateDeviations
from intuitive_physics_learner.search.gaussian import Gaussian
from intuitive_physics_learner.search.learning_task import LearningTask

# Times that the fit horizons advance at most with everything held at the truth
MOST_ADVANCES = 20
DRAWS = 50  # of θ_s about the truth
# s by which a horizon advances at most at a time: the estimate needs no careful approach
LONGEST_ADVANCE = 1.0
MOST_STEPS = 40  # of the fit of initial states to it


@dataclass(frozen=True)
class Attainable:
    """What can be learned from the set of a seed.

    Horizons are mean times in s: up to which trajectories can be predicted at the truth, and up to
    which they are fitted from the observed initial states with θ_s held there. Excesses are means
    over draws about the truth, with points up to these horizons and with all.
    """

    size: str
    seed: int
    horizon: float
    found_horizon: float
    up_to_horizons: float
    up_to_found_horizons: float
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


def attainable_of(size: str, seed: int) -> Attainable:
    """Draw about the truth of a set, with the covariances there."""
    simulator = make_simulator("auto", threads=1)
    return attainable_from(size, seed, make_task(SIZES[size].objects, seed, simulator))


def attainable_from(size: str, seed: int, task: Task) -> Attainable:
    """Draw about the truth of a set that was made."""
    cost = task.training_cost()
    influence = parameter_influence(cost.observations, cost.materials)
    learning = LearningTask(cost, ParameterSpace(cost.materials), influence, task.start)
    truth = learning.searched.to_unit(task.dataset.parameters)
    true = true_fits(
        cost.observations,
        task.dataset.with_initial_states("true").training_observations,
    )
    predicted, deviations = _predicted(learning, truth, true)
    found = _fitted_at(learning, truth)
    to_found = [replace(each, horizon=end) for each, end in zip(predicted, found, strict=True)]
    to_end = [replace(each, horizon=np.inf) for each in predicted]
    excesses = []
    for fits in (predicted, to_found, to_end):
        fit = JointFit(learning.fit_task, FIXED_HORIZONS)
        fit.begin_at(truth, deviations, fits)
        draws = _draws(fit, truth, np.random.default_rng(seed))
        parameters = [learning.searched.to_parameters(unit) for unit in draws]
        *costs, default = task.compared(task.exact_cost(), *parameters)
        excesses.append(float(np.mean([excess(c, task.oracle[2], default) for c in costs])))
    horizon = float(np.mean([fit.horizon for fit in predicted]))
    return Attainable(size, seed, horizon, float(np.mean(found)), *excesses)


def _predicted(
    learning: LearningTask, truth: NDArray[np.float64], true: list[ObservationFit]
) -> tuple[list[ObservationFit], NDArray[np.float64]]:
    """Let horizons advance as far as trajectories can be predicted with everything at the truth.

    `truth` (n,) θ_s on the unit cube; `true` the initial states. Returns these with the horizons,
    and the standard deviations (n,) of θ_s in widths.
    """
    settings = JointEstimationSettings(largest_advance=LONGEST_ADVANCE, scan_steps=())
    growing, deviations = JointFit(learning.fit_task, settings), learning.prior.deviations
    held = _advanced(true, growing)
    for _ in range(MOST_ADVANCES):
        growing.begin_at(truth, deviations, held)
        growing.step()
        before, held = held, _advanced(held, growing)
        deviations = growing.deviations.copy()
        pairs = zip(before, held, strict=True)
        if all(new.horizon <= old.horizon for old, new in pairs):
            break
    return held, deviations


def _fitted_at(learning: LearningTask, truth: NDArray[np.float64]) -> list[float]:
    """Return the horizons in s up to which trajectories are fitted with θ_s held at the truth.

    `truth` (n,) on the unit cube; initial states begin at those observed.
    """
    task = learning.fit_task
    prior = Gaussian.about(truth, HELD_PRECISION * np.eye(truth.size))
    fit = JointFit(replace(task, prior=prior), JointEstimationSettings(scan_steps=()))
    while not fit.settled and fit.steps < MOST_STEPS:
        fit.step()
    return fit.horizons.tolist()


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
    """Draw about the truth of all sets of all sizes, several at a time."""
    calls = [partial(attainable_of, *each) for each in seeds_of_sizes(quick, first_seed)]
    # The largest first, so that none of the processes waits long for the other.
    results = side_by_side(calls[::-1])[::-1]
    table = Table.of(
        "What the observations allow: draws about the true θ_s",
        results,
        [
            (Column("set"), lambda a: a.size),
            (Column("seed"), lambda a: a.seed),
            (Column("mean horizon: true initial states", "s", ".2f"), lambda a: a.horizon),
            (Column("found ones", "s", ".2f"), lambda a: a.found_horizon),
            (Column("excess up to the first", "", ".3f"), lambda a: a.up_to_horizons),
            (Column("up to the second", "", ".3f"), lambda a: a.up_to_found_horizons),
            (Column("with all points", "", ".3f"), lambda a: a.all_points),
            (Column("bar of the median", "", "g"), lambda a: SIZES[a.size].median),
            (Column("of one set", "", "g"), lambda a: SIZES[a.size].worst),
        ],
        note=(
            f"Means over {DRAWS} draws of θ_s about the truth, with the covariance of the estimate "
            "there. Up to the first horizons: as far as trajectories can be predicted from the "
            "truth. Up to the second: as far as they are fitted from the observed initial states "
            "with θ_s held at the truth, so what the estimator can reach if it finds the right "
            "optimum. With all points: a local bound, as if all could be fitted."
        ),
    )
    return Outcome([table], key_figures={"attainable": figures(results)})


def figures(results: Sequence[Attainable]) -> dict[str, dict[str, float] | None]:
    """Return the entry of the last line, of the sets of each size; null for none.

    Medians, and the worst set up to the horizons that are found.
    """
    entry: dict[str, dict[str, float] | None] = dict.fromkeys(SIZES)
    for name, group in by_size(results).items():
        found = [a.up_to_found_horizons for a in group]
        entry[name] = {
            "up_to_horizons": round(float(np.median([a.up_to_horizons for a in group])), 4),
            "up_to_found_horizons": round(float(np.median(found)), 4),
            "worst_up_to_found_horizons": round(max(found), 4),
            "all_points": round(float(np.median([a.all_points for a in group])), 4),
        }
    return entry
