"""Leaving local optima: parameters tried over their whole range.

Coordinates are scanned side by side: parameters of one group share no observation, so one
simulation of all observations judges a value of each of them. For each value the initial states
take the Gauss-Newton step that suits them best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.fit_horizons import TrajectoryFits
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation, residuals_at
from intuitive_physics_learner.joint_estimation.normal_equations import NormalEquations
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock
from intuitive_physics_learner.joint_estimation.state_steps import StateSteps
from intuitive_physics_learner.joint_estimation.trajectory_model import Estimate, TrajectoryModel
from intuitive_physics_learner.search.search_space import ActiveSpace

SCAN_LEVELS = (0.02, 0.14, 0.26, 0.38, 0.5, 0.62, 0.74, 0.86, 0.98)
"""Places on the unit interval at which a scan tries each parameter: equal steps that leave out the
bounds themselves."""

SMALLEST_SCAN_GAIN = 3.0
"""Loss that a scanned value must gain to be taken: a likelihood ratio of e³ ≈ 20, hardly chance."""


def scan_candidates(
    unit: NDArray[np.float64],
    groups: Sequence[NDArray[np.int64]],
    space: ActiveSpace,
    levels: NDArray[np.float64],
) -> tuple[list[StaticParameters], NDArray[np.int64]]:
    """Return θ_s in which the parameters of a group take one of their levels, the others stay.

    `unit` (n,) the estimate on the unit cube; `groups` (n_members,) each, indices of parameters,
    as `separate_groups`; `levels` (n, n_levels) places on the unit interval of each parameter.
    Returns the candidates, and (n, n_levels) index of the one that gives each parameter each level.
    """
    candidates: list[StaticParameters] = []
    index = np.zeros(levels.shape, dtype=np.int64)
    for group in groups:
        for k in range(levels.shape[1]):
            index[group, k] = len(candidates)
            moved = unit.copy()
            moved[group] = levels[group, k]
            candidates.append(space.to_parameters(moved))
    return candidates, index


def scanned_states(
    cost: Cost,
    block: ObservationBlock,
    fits: TrajectoryFits,
    linear: Linearisation,
    candidates: Sequence[StaticParameters],
    index: NDArray[np.int64],
    until: NDArray[np.float64],
    present_too: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Fit the initial states of a block to each of some θ_s, by a Gauss-Newton step each.

    `index` (c, W) of the candidate that is tried for each observation; `until` (W,) s, the fit
    horizon, or 0 of one that does not count; `present_too`: whether the present states stay where
    that step explains less. Returns `estimates` (c, W, d) deviations from the observed initial
    states, in SI units; `losses` (c, W).
    """
    estimate = fits.estimate
    tried = np.broadcast_to(estimate, (len(index), *estimate.shape))
    residuals = residuals_at(cost, block, tried, candidates, index, until)
    of_states = replace(linear, slopes=linear.slopes[:, : estimate.shape[1]])
    equations = NormalEquations.of(block, estimate, of_states, until)
    estimates = StateSteps.of(block, fits, linear, equations).stepped(tried, residuals)
    left = residuals_at(cost, block, estimates, candidates, index, until)
    losses = fits.losses(block, estimates, left)
    if present_too:
        before = fits.losses(block, tried, residuals)
        stays = before < losses
        estimates = np.where(stays[..., None], tried, estimates)
        losses = np.where(stays, before, losses)
    return estimates, losses


def scanned(
    model: TrajectoryModel,
    estimate: Estimate,
    linear: Sequence[Linearisation],
    levels: ArrayLike,
    weights: NDArray[np.float64],
    asked: NDArray[np.bool_] | None = None,
    *,
    present_too: bool = False,
) -> tuple[NDArray[np.float64], list[NDArray[np.float64]]]:
    """Try each parameter at each level.

    `levels` (n_levels,) places on the unit interval, or (n, n_levels) of each parameter;
    `weights` (n_observations,) of the observations; `asked` (n,) which parameters are tried; None:
    all; `present_too` as `scanned_states` has it. Returns `rises` (n, n_levels) change of the loss,
    without a unit, of the prior and of the observations that each parameter influences, for those
    that are tried; `fitted` (q, n_levels, W, d) of each block, deviations from the observed initial
    states, in SI units, fitted to the levels of its parameters, or of those of them that are tried.
    """
    each = np.broadcast_to(levels, (estimate.unit.size, np.shape(levels)[-1]))
    candidates, index = scan_candidates(estimate.unit, model.groups, model.space, each)
    rises = model.prior.rises(estimate.unit, each - estimate.unit[:, None])
    parts, fitted = list(model.parts(estimate)), []
    asked = np.ones(estimate.unit.size, dtype=bool) if asked is None else asked
    tried = [tried_parameters(block.parameters, asked) for block, _ in parts]
    until = [
        np.where(counts.any(axis=1), part.horizons, 0.0)
        for (_, part), (_, counts) in zip(parts, tried, strict=True)
    ]

    def scanned_block(k: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        of_parameters = index[tried[k][0]].reshape(len(tried[k][0]), -1).T
        return scanned_states(
            model.cost, *parts[k], linear[k], candidates, of_parameters, until[k], present_too
        )

    for (block, part), slopes, (parameters, counts), (states, losses), reached in zip(
        parts, linear, tried, model.of_blocks(scanned_block), until, strict=True
    ):
        model.count(block, reached, 2 * len(states))
        present = part.estimate[None], slopes.residuals[None]
        here = part.losses(block, *present)
        there = weights[block.members] * (losses - here)
        by_level = there.T.reshape(*parameters.shape, each.shape[1])
        np.add.at(rises, parameters, by_level * counts[..., None])
        fitted.append(states.reshape(parameters.shape[1], each.shape[1], *part.estimate.shape))
    return rises, fitted


def tried_parameters(
    parameters: NDArray[np.int64], asked: NDArray[np.bool_]
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Choose those of the parameters (W, q) of observations that are tried.

    `asked` (n,) which are. Returns (W, k) parameters, as many for each observation as one has at
    most and one at least, and (W, k) which of them count: the others fill up.
    """
    counts = asked[parameters]
    first = np.argsort(~counts, axis=1, kind="stable")[:, : counts.sum(axis=1).max(initial=1)]
    return np.take_along_axis(parameters, first, axis=1), np.take_along_axis(counts, first, axis=1)


def compatible_moves(gains: NDArray[np.float64], influence: NDArray[np.bool_]) -> list[int]:
    """Choose parameters by index, the most gainful first, no two of which share an observation.

    `gains` (n,) by which moving each alone lowers the loss, in the unit of the loss; `influence`
    (n_observations, n) bool, which observation can depend on which parameter.
    """
    chosen: list[int] = []
    occupied = np.zeros(len(influence), dtype=bool)
    for parameter in np.argsort(-gains, kind="stable"):
        if gains[parameter] < SMALLEST_SCAN_GAIN:
            break
        if not (occupied & influence[:, parameter]).any():
            chosen.append(int(parameter))
            occupied |= influence[:, parameter]
    return chosen
