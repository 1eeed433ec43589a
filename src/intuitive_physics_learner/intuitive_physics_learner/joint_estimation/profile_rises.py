"""The loss where a parameter is at other places, initial states fitted to each of them.

Parameters that share no observation are moved side by side, so one simulation of all observations
judges a place of each of them. Initial states take the Gauss-Newton step that suits a place best by
the slopes at the estimate, or stay where that explains more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner.cost.cost_function import Cost
from intuitive_physics_learner.joint_estimation.fit_horizons import TrajectoryFits
from intuitive_physics_learner.joint_estimation.linearisation import Linearisation, residuals_at
from intuitive_physics_learner.joint_estimation.normal_equations import NormalEquations
from intuitive_physics_learner.joint_estimation.observation_blocks import ObservationBlock
from intuitive_physics_learner.joint_estimation.state_steps import StateSteps
from intuitive_physics_learner.joint_estimation.trajectory_model import Estimate, TrajectoryModel
from intuitive_physics_learner.search.search_space import ActiveSpace


def moved_candidates(
    unit: NDArray[np.float64],
    groups: Sequence[NDArray[np.int64]],
    space: ActiveSpace,
    places: NDArray[np.float64],
) -> tuple[list[StaticParameters], NDArray[np.int64]]:
    """Return θ_s in which the parameters of a group are at one of their places, the others stay.

    `unit` (n,) the estimate on the unit cube; `groups` (n_members,) each, indices of parameters,
    as `separate_groups`; `places` (n, k) on the unit interval of each parameter. Returns the
    candidates, and (n, k) index of the one that has each parameter at each place.
    """
    candidates: list[StaticParameters] = []
    index = np.zeros(places.shape, dtype=np.int64)
    for group in groups:
        for k in range(places.shape[1]):
            index[group, k] = len(candidates)
            moved = unit.copy()
            moved[group] = places[group, k]
            candidates.append(space.to_parameters(moved))
    return candidates, index


def fitted_losses(
    cost: Cost,
    block: ObservationBlock,
    fits: TrajectoryFits,
    linear: Linearisation,
    candidates: Sequence[StaticParameters],
    index: NDArray[np.int64],
    until: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return losses (c, W) of a block's observations with initial states fitted to some θ_s.

    `index` (c, W) of the candidate that is tried for each observation; `until` (W,) s, the fit
    horizon, or 0 of one that does not count.
    """
    estimate = fits.estimate
    present = np.broadcast_to(estimate, (len(index), *estimate.shape))
    residuals = residuals_at(cost, block, present, candidates, index, until)
    of_states = replace(linear, slopes=linear.slopes[:, : estimate.shape[1]])
    equations = NormalEquations.of(block, estimate, of_states, until)
    stepped = StateSteps.of(block, fits, linear, equations).stepped(present, residuals)
    left = residuals_at(cost, block, stepped, candidates, index, until)
    return np.minimum(fits.losses(block, present, residuals), fits.losses(block, stepped, left))


def profile_rises(
    model: TrajectoryModel,
    estimate: Estimate,
    linear: Sequence[Linearisation],
    places: NDArray[np.float64],
    weights: NDArray[np.float64],
    asked: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return rises (n, k) of the loss where each parameter alone is at each of its places.

    They are of the prior and of the observations that a parameter influences, and mean nothing for
    parameters that are not asked for.

    `places` (n, k) on the unit interval of each parameter; `weights` (n_observations,) of the
    observations; `asked` (n,) for which parameters.
    """
    candidates, index = moved_candidates(estimate.unit, model.groups, model.space, places)
    rises = model.prior.rises(estimate.unit, places - estimate.unit[:, None])
    parts = list(model.parts(estimate))
    tried = [tried_parameters(block.parameters, asked) for block, _ in parts]
    until = [
        np.where(counts.any(axis=1), part.horizons, 0.0)
        for (_, part), (_, counts) in zip(parts, tried, strict=True)
    ]

    def losses_of_block(k: int) -> NDArray[np.float64]:
        of_parameters = index[tried[k][0]].reshape(len(tried[k][0]), -1).T
        return fitted_losses(model.cost, *parts[k], linear[k], candidates, of_parameters, until[k])

    for (block, part), slopes, (parameters, counts), losses, reached in zip(
        parts, linear, tried, model.of_blocks(losses_of_block), until, strict=True
    ):
        model.count(block, reached, 2 * len(losses))
        here = part.losses(block, part.estimate[None], slopes.residuals[None])
        by_place = (weights[block.members] * (losses - here)).T
        by_place = by_place.reshape(*parameters.shape, places.shape[1])
        np.add.at(rises, parameters, by_place * counts[..., None])
    return rises


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
