"""Residuals near an estimate of θ_s and initial states: values, slopes, linearisation error.

Differences are taken to both sides over a part of the standard deviation of the estimate, so that a
slope is that of the region where the truth is likely to be, and a kink within it (a contact that is
met or missed) shows up as a bend: the linearisation error one standard deviation away.

Curtis, Powell and Reid (1974), *On the estimation of sparse Jacobian matrices*: columns of a
Jacobian without a common row are found by one difference together. Here a row is an observation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.cost.trials import Trials
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock

DIFFERENCE_STEP = 0.5
"""Step of a finite difference to each side, standard deviations of what is moved: a slope is that
of the region where the truth is likely to be; set by hand."""

SMALLEST_DIFFERENCE = 1e-6
"""Smallest step of a finite difference of an initial state, in the unit of its argument (m, m/s,
rad or rad/s); set by hand."""

LARGEST_DIFFERENCE = 0.05
"""Largest step of a finite difference, in the unit of its argument (width, m, m/s, rad or rad/s);
set by hand."""

SMALLEST_PARAMETER_DIFFERENCE = 1e-4
"""Smallest step of a finite difference of a parameter, widths. Initial states are known no better
however many observations there are, so their steps stay wide. Were those of θ_s to shrink with its
deviation, its slopes alone would become derivatives, which grow exponentially with time where
motion is chaotic; no change of the initial states could make up for them, and the deviation would
shrink the more. Of 40 boxes 1e-6 led to deviations of 2e-6 with errors of 2e-3."""


def difference_steps(deviations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the steps (...,) of finite differences, in the unit of each of `deviations` (...,)."""
    return np.clip(DIFFERENCE_STEP * deviations, SMALLEST_DIFFERENCE, LARGEST_DIFFERENCE)


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Linearised residuals of a block's W observations, with P points and k = d + q unknowns.

    The nuisance comes first, then θ_s.

    Parameters
    ----------
    residuals : (W, P, 3) m, simulated minus observed; NaN where a point is not simulated
    slopes : (W, k, P, 3) m per unit of each unknown; 0 where a point is not simulated in all trials
    valid : (W, P) bool, which points are simulated in all trials
    bends : (W, P) m, linearisation error of the residuals one standard deviation away
    kinks : (W, k, P, 3) slopes upwards less those downwards, in units as `slopes`; 0 for what is
        at its bound on one side
    """

    residuals: NDArray[np.float64]
    slopes: NDArray[np.float64]
    valid: NDArray[np.bool_]
    bends: NDArray[np.float64]
    kinks: NDArray[np.float64]


class ParameterSteps:
    """The θ_s of all differences: parameters of one group take their steps together.

    `unit` (n,) the estimate on the unit cube; `deviations` (n,) standard deviation of each
    parameter there; `groups` (n_members,) each, indices of parameters, as `separate_groups`.

    Attributes
    ----------
    deviations : (n,) as given, but for the smallest
    candidates : the estimate, then up and down of each group
    up_index, down_index : (n,) index of the candidate that moves each parameter
    up, down : (n,) widths of the steps, not beyond the cube
    """

    def __init__(
        self,
        unit: NDArray[np.float64],
        deviations: NDArray[np.float64],
        groups: Sequence[NDArray[np.int64]],
        to_parameters: Callable[[NDArray[np.float64]], StaticParameters],
    ) -> None:
        # What happens within a step is not known to happen beyond a smaller deviation.
        self.deviations = np.maximum(deviations, SMALLEST_PARAMETER_DIFFERENCE / DIFFERENCE_STEP)
        steps = np.maximum(difference_steps(deviations), SMALLEST_PARAMETER_DIFFERENCE)
        self.up = np.minimum(unit + steps, 1.0) - unit
        self.down = unit - np.maximum(unit - steps, 0.0)
        self.up_index = np.zeros(unit.size, dtype=np.int64)
        self.candidates = [to_parameters(unit)]
        for group in groups:
            self.up_index[group] = len(self.candidates)
            for change in (self.up, -self.down):
                moved = unit.copy()
                moved[group] += change[group]
                self.candidates.append(to_parameters(moved))
        self.down_index = self.up_index + 1


def separate_groups(influence: NDArray[np.bool_]) -> list[NDArray[np.int64]]:
    """Part parameters into groups of which no two members influence the same observation.

    One simulation of all observations moves all members of a group at once. Greedy, those first
    that influence most observations, by `influence` (n_observations, n_parameters) bool. Returns
    arrays (n_members,) of indices; parameters that influence nothing are in none.
    """
    taken: list[NDArray[np.bool_]] = []
    groups: list[list[int]] = []
    counts = influence.sum(axis=0)
    for parameter in np.argsort(-counts, kind="stable")[: np.count_nonzero(counts)]:
        column = influence[:, parameter]
        for group, occupied in zip(groups, taken, strict=True):
            if not (occupied & column).any():
                group.append(int(parameter))
                occupied |= column
                break
        else:
            groups.append([int(parameter)])
            taken.append(column.copy())
    return [np.array(group) for group in groups]


def linearise(
    cost: Cost,
    block: ObservationBlock,
    estimate: NDArray[np.float64],
    state_deviations: NDArray[np.float64],
    steps: ParameterSteps,
    until: NDArray[np.float64],
) -> Linearisation:
    """Take differences of the residuals of a block.

    `estimate` (W, d) nuisance parameters, as `ObservationBlock`; `state_deviations` (W, d) standard
    deviation of each, in the same units; `until` (W,) s up to which each observation is simulated.
    """
    count, d = len(estimate), block.initial_states.components.shape[1]
    parameters = block.parameters
    k, points = d + parameters.shape[1], block.times.shape[1]
    state_deviations = state_deviations[:, :d]
    state_steps = difference_steps(state_deviations)
    # The estimate, each unknown upwards, each downwards.
    moves = np.zeros((count, 1 + 2 * k, d))
    moves[:, 1 : 1 + d] = state_steps[:, :, None] * np.eye(d)
    moves[:, 1 + k : 1 + k + d] = -moves[:, 1 : 1 + d]
    index = np.zeros((count, 1 + 2 * k), dtype=np.int64)
    index[:, 1 + d : 1 + k] = steps.up_index[parameters]
    index[:, 1 + k + d :] = steps.down_index[parameters]
    trials = Trials(
        steps.candidates,
        index.ravel(),
        np.repeat(block.members, 1 + 2 * k),
        np.concatenate(
            block.initial_states.states(estimate[:, None, :d] + moves, _most_objects(cost))
        ),
        np.repeat(until, 1 + 2 * k),
        block.columns,
    )
    rows = cost.trial_residuals(trials).reshape(count, 1 + 2 * k, points, 3)
    base = rows[:, 0].copy()
    valid = np.asarray(np.isfinite(rows).all(axis=(1, 3)))
    rows[~np.broadcast_to(valid[:, None], rows.shape[:3])] = 0.0
    up, down = rows[:, 1 : 1 + k] - rows[:, :1], rows[:, :1] - rows[:, 1 + k :]
    up_steps = np.hstack([state_steps, steps.up[parameters]])
    down_steps = np.hstack([state_steps, steps.down[parameters]])
    kinks = _kinks(up, down, up_steps, down_steps)
    spread = np.minimum(np.hstack([state_deviations, steps.deviations[parameters]]), 1.0)
    errors = kinks * (0.5 * spread)[:, :, None, None]
    bends = np.sqrt(np.einsum("wkpi,wkpi->wp", errors, errors))
    up += down
    up /= (up_steps + down_steps)[:, :, None, None]
    # Shared errors displace points alike wherever these are.
    straight = np.where(valid[:, None, :, None], block.shared, 0.0)
    return Linearisation(
        block.displaced(base, estimate),
        _inserted(up, d, straight),
        valid,
        bends,
        _inserted(kinks, d, np.zeros_like(straight)),
    )


def _kinks(
    up: NDArray[np.float64],
    down: NDArray[np.float64],
    up_steps: NDArray[np.float64],
    down_steps: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Slopes upwards less those downwards (W, k, P, 3), of changes over steps (W, k)."""
    both = (up_steps > 0.0) & (down_steps > 0.0)
    per_step = [
        np.divide(1.0, steps, out=np.zeros_like(steps), where=both)[:, :, None, None]
        for steps in (up_steps, down_steps)
    ]
    kinks = up * per_step[0]
    kinks -= down * per_step[1]
    return kinks


def _inserted(
    slopes: NDArray[np.float64], place: int, others: NDArray[np.float64]
) -> NDArray[np.float64]:
    if others.shape[1] == 0:
        return slopes
    return np.concatenate([slopes[:, :place], others, slopes[:, place:]], axis=1)


def residuals_at(
    cost: Cost,
    block: ObservationBlock,
    estimates: NDArray[np.float64],
    candidates: Sequence[StaticParameters],
    candidate_index: NDArray[np.int64],
    until: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Simulate the observations of a block under other θ_s and from other initial states.

    `estimates` (c, W, d) nuisance parameters, as `ObservationBlock`; `candidate_index` (c, W) index
    of the candidate of each, or (c, 1) for all observations alike; `until` (W,) s up to which each
    observation is simulated. Returns (c, W, P, 3) m, residuals.
    """
    count = len(candidate_index)
    members = block.members.size
    states = block.initial_states.states(estimates.swapaxes(0, 1), _most_objects(cost))
    trials = Trials(
        candidates,
        np.broadcast_to(candidate_index, (count, members)).ravel(),
        np.tile(block.members, count),
        np.concatenate(states.swapaxes(0, 1)),
        np.tile(until, count),
        block.columns,
    )
    points = block.times.shape[1]
    residuals = cost.trial_residuals(trials).reshape(count, members, points, 3)
    return block.displaced(residuals, estimates)


def _most_objects(cost: Cost) -> int:
    return int(cost.trajectory_object.max()) + 1
