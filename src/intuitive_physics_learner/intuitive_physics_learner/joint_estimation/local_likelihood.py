"""The likelihood of θ_s near an estimate, of each observation by itself.

With its initial states integrated out by Laplace's approximation, the negative logarithm of the
likelihood of one observation is, near the estimate û of its q parameters,

    l(u) = l(û) + gᵀ (u - û) + ½ (u - û)ᵀ Λ (u - û),

where Λ and g are its reduced information and scores (`normal_equations`) and l(û) is the loss at
the estimate plus ½ ln det(P_s^-½ H_ss P_s^-½), by which the data narrow its initial states.
Parameters are on the unit cube of the search.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.initial_spins.spin_evidence import SpinLikelihood
from intuitive_physics_learner.joint_estimation.trajectory_model import Estimate, TrajectoryModel


@dataclass(frozen=True, eq=False)
class LocalLikelihood:
    """Likelihood of one observation, about an estimate of its q parameters.

    Parameters
    ----------
    parameters : (q,) indices among all parameters
    estimate : (q,) û, on the unit cube
    information : (q, q) Λ, per width²
    scores : (q,) g, per width
    loss : l(û), without a unit
    spins : what the observation says of each initial spin that was a guess, θ_s and all else
        integrated out
    """

    parameters: NDArray[np.int64]
    estimate: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    loss: float
    spins: tuple[SpinLikelihood, ...] = ()


def local_likelihoods(model: TrajectoryModel, estimate: Estimate) -> list[LocalLikelihood]:
    """Take the likelihoods of all observations of a model, in their order.

    Each is that of its own observation alone: the weights with which a fit counts them are left
    out.
    """
    likelihoods: dict[int, LocalLikelihood] = {}
    linear = model.linearised(estimate)
    equations = model.equations(estimate, linear)
    posterior, together = model.posterior(equations)
    for (block, part), slopes, block_equations, left in zip(
        model.parts(estimate), linear, equations, together, strict=True
    ):
        spins = model.spin_likelihoods(
            block, part, posterior.state_covariances(block_equations, left)
        )
        eliminated = replace(
            block_equations, weights=np.ones_like(block_equations.weights)
        ).eliminated()
        present = part.estimate[None], slopes.residuals[None]
        losses = part.losses(block, *present)[0]
        d = block_equations.state_size
        scale = block.prior_deviations
        inner = block_equations.hessian[:, :d, :d] * scale[:, :, None] * scale[:, None, :]
        losses = losses + 0.5 * np.linalg.slogdet(inner)[1]
        for row, member in enumerate(block.members):
            likelihoods[int(member)] = LocalLikelihood(
                block.parameters[row],
                estimate.unit[block.parameters[row]],
                eliminated.information[row],
                eliminated.scores[row],
                float(losses[row]),
                spins[row],
            )
    return [likelihoods[member] for member in range(len(likelihoods))]
