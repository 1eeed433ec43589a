"""Most likely explanations of what was detected: minima of the misfit by damped Gauss–Newton steps.

With the unknowns as a standard normal vector ξ and the whitened residuals r(ξ), the negative
logarithm of the posterior is ½ |ξ|² + ½ |r(ξ)|². Near a minimum it is normal with the information
H = I + Jᵀ J, J = ∂r/∂ξ (Laplace). A bounce that sticks and one that slips may both explain what was
seen, with different spins: then there are two minima.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_predictor.estimation.trajectory_fit import TrajectoryFit

STEP_SHARE = 0.3
"""Standard deviations of the posterior by which a derivative's difference is taken: the simulated
motion is smooth at this scale but for contacts, which smaller steps would see as jumps."""

FIRST_STEP = 0.05
"""Size of that difference in standard deviations of the prior, while there is no posterior."""

DAMPING = np.array([1.0, 0.5, 0.2, 0.05])
"""Shares of a Gauss–Newton step, simulated in one batch; the best one is taken."""

ITERATIONS = 3
"""Largest number of steps for each detection; the next detection continues."""

SETTLED = 0.1
"""Difference in misfit between the gain of a step and the gain if the motion were linear in the
unknowns. Below it the step has reached the minimum and is the last."""

LARGEST_RISE = 12.0
"""Misfit above the least by which an explanation is e⁻¹² times as likely: it is dropped."""

SAME = 9.0
"""Squared distance, in variances, within which two minima are one."""

MOST = 3
"""Explanations that are kept."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Minima of the misfit, the least first.

    Parameters
    ----------
    centres : (m, n) standard normal vectors
    information : (m, n, n) H
    misfits : (m,) ½ |ξ|² + ½ |r|²
    residuals : (m, 3 k) whitened, at the centres
    """

    centres: NDArray[np.float64]
    information: NDArray[np.float64]
    misfits: NDArray[np.float64]
    residuals: NDArray[np.float64]


def misfit(standard: NDArray[np.float64], residuals: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the negative logarithm of the posterior, ½ |ξ|² + ½ |r|², (count,).

    standard (count, n) is ξ, residuals (count, rows) is r.
    """
    return np.asarray(0.5 * (standard**2).sum(axis=1) + 0.5 * (residuals**2).sum(axis=1))


def find_modes(
    fit: TrajectoryFit, starts: NDArray[np.float64], steps: NDArray[np.float64]
) -> Modes:
    """Descend from starts (m, n) at once, and keep the minima that explain the detections.

    The derivatives at each start are taken over its n differences steps (m, n, n).
    """
    centres = starts
    for _ in range(ITERATIONS):
        residuals, slopes = _linearised(fit, centres, steps)
        before = misfit(centres, residuals)
        information = np.eye(centres.shape[1]) + slopes @ slopes.swapaxes(1, 2)
        downhill = centres + (slopes @ residuals[..., None])[..., 0]
        full = np.asarray(-np.linalg.solve(information, downhill[..., None])[..., 0])
        linear = -0.5 * np.einsum("mn,mn->m", downhill, full)
        centres, residuals, misfits = _damped(fit, centres, residuals, full)
        if np.abs(before - misfits - linear).max() < SETTLED:
            break
        steps = derivative_steps(information)
    return _distinct(Modes(centres, information, misfits, residuals))


def derivative_steps(information: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the differences (m, n, n), one a row, over which derivatives are taken.

    They lie along the axes of the posterior with information (m, n, n). Along a single unknown a
    step would be as long as the least certain combination it is part of: the uncertainty of the
    spin about a bounce's normal would set the step of well-known spins.
    """
    deviations, axes = principal_deviations(information)
    return np.asarray(STEP_SHARE * (axes * deviations[:, None]).swapaxes(1, 2))


def principal_deviations(
    information: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the standard deviations (m, n) along the posterior's axes, and these (m, n, n).

    The posterior has the information (m, n, n); its axes are unit vectors, one a column.
    """
    precisions, axes = np.linalg.eigh(information)
    # The prior alone has the precision 1: what is below it is rounding, where another unknown is
    # known 10⁸ times better.
    return np.maximum(precisions, 1.0) ** -0.5, axes


def _linearised(
    fit: TrajectoryFit, centres: NDArray[np.float64], steps: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Residuals (m, rows) at the centres, and their derivatives (m, n, rows)."""
    m, n = centres.shape
    moved = centres[:, None] + steps
    residuals = fit.residuals(np.concatenate([centres, moved.reshape(m * n, n)]))
    apart = residuals[m:].reshape(m, n, -1) - residuals[:m, None]
    return residuals[:m], np.asarray(np.linalg.solve(steps, apart), dtype=np.float64)


def _damped(
    fit: TrajectoryFit,
    centres: NDArray[np.float64],
    residuals: NDArray[np.float64],
    full: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Go the share of the full steps (m, n) that is best, or stay."""
    m, n = centres.shape
    tried = centres[:, None] + DAMPING[:, None] * full[:, None]
    outcomes = fit.residuals(tried.reshape(-1, n)).reshape(m, len(DAMPING), -1)
    tried = np.concatenate([centres[:, None], tried], axis=1)
    outcomes = np.concatenate([residuals[:, None], outcomes], axis=1)
    misfits = 0.5 * (tried**2).sum(axis=2) + 0.5 * (outcomes**2).sum(axis=2)
    rows, best = np.arange(m), misfits.argmin(axis=1)
    return tried[rows, best], outcomes[rows, best], misfits[rows, best]


def _distinct(modes: Modes) -> Modes:
    """Keep the likely minima that are not one and the same, the least first."""
    kept: list[int] = []
    order = np.argsort(modes.misfits)
    for k in order:
        if modes.misfits[k] > modes.misfits[order[0]] + LARGEST_RISE or len(kept) == MOST:
            break
        apart = modes.centres[kept] - modes.centres[k]
        squares = np.einsum("mi,mij,mj->m", apart, modes.information[kept], apart)
        if not (squares < SAME).any():
            kept.append(int(k))
    return Modes(
        modes.centres[kept], modes.information[kept], modes.misfits[kept], modes.residuals[kept]
    )
