"""Normal equations of θ_s and the states of all segments of throws, the states eliminated.

With the whitened residuals of a segment's points and of its link to the next state, the states of
a throw have a block tridiagonal matrix: each has in common with its neighbours what binds them.
Blocks are eliminated one after the other, as in a smoother (Rauch, Tung and Striebel 1965).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_learner.joint_estimation.linearisation import DIFFERENCE_STEP
from intuitive_physics_learner.joint_estimation.normal_equations import Elimination, huber_weights
from intuitive_physics_learner.segmented_estimation.chaotic_states import (
    CHANGE_SPREADS,
    change,
    moved,
)
from intuitive_physics_learner.segmented_estimation.segmented_throws import SegmentedThrows
from intuitive_physics_learner.segmented_estimation.smoothed_states import SmoothedStates

SMALLEST_CHANGE = 1e-6
"""Smallest step of a finite difference of a state, in the unit of its component."""

LARGEST_CHANGES = np.repeat((0.05, 0.05, 0.05, 0.5), 3)
"""Largest step of a finite difference of a state, in the unit of its component; set by hand."""

SMALLEST_PARAMETER_STEP, LARGEST_PARAMETER_STEP = 1e-4, 0.05
"""Steps of a finite difference of a parameter, widths; set by hand."""

STATE_DAMPINGS = (0.01, 1.0)
"""Dampings of the steps of states that are tried; set by hand."""

LOOSE = 20.0
"""Spreads at which a state would be without any points: so its matrix always has an inverse."""

COMPONENTS = 12
"""Components of a change of a state."""


@dataclass(frozen=True, eq=False)
class SegmentEquations:
    """Equations of A throws of up to K segments and of n parameters.

    What does not count has the identity as its matrix, and no gradient.

    Parameters
    ----------
    blocks : (A, K, 12, 12) of each state
    next_blocks : (A, K, 12, 12) of each state (rows) with the next one
    parameter_blocks : (A, K, 12, n) of each state with the parameters
    gradients : (A, K, 12)
    information, scores : (A, n, n), (A, n) of the parameters where no state moves
    link_precisions : (A, K, 12) of the link from each state's segment to the next; 0 without one
    """

    blocks: NDArray[np.float64]
    next_blocks: NDArray[np.float64]
    parameter_blocks: NDArray[np.float64]
    gradients: NDArray[np.float64]
    information: NDArray[np.float64]
    scores: NDArray[np.float64]
    link_precisions: NDArray[np.float64]

    def solved(self, damping: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return gains (A, K, 12, n) and offsets (A, K, 12) of the states.

        `damping` : the part by which diagonals are enlarged.
        """
        pivots, gains = self._pivots(damping)
        right = np.concatenate([self.parameter_blocks, self.gradients[..., None]], axis=-1)
        for k in range(1, right.shape[1]):
            right[:, k] += gains[:, k - 1].swapaxes(1, 2) @ right[:, k - 1]
        right = np.linalg.solve(pivots, right)
        for k in reversed(range(right.shape[1] - 1)):
            right[:, k] += gains[:, k] @ right[:, k + 1]
        return right[..., :-1], right[..., -1]

    def eliminated(self) -> Elimination:
        """Solve for the states of all segments."""
        gains, offsets = self.solved()
        throws, n = gains.shape[0], gains.shape[3]
        flat = self.parameter_blocks.reshape(throws, -1, n).swapaxes(1, 2)
        gains = gains.reshape(throws, -1, n)
        offsets = offsets.reshape(throws, -1)
        return Elimination(
            np.arange(throws),
            np.tile(np.arange(n), (throws, 1)),
            gains,
            offsets,
            self.information - flat @ gains,
            self.scores - (flat @ offsets[..., None])[..., 0],
        )

    @property
    def covariances(self) -> NDArray[np.float64]:
        """Covariance (A, K, 12, 12) of each state, its neighbours and θ_s held."""
        return np.asarray(np.linalg.inv(self.blocks), dtype=np.float64)

    @property
    def smoothed(self) -> SmoothedStates:
        """What is known of each state, its neighbours free."""
        pivots, gains = self._pivots()
        links = self.link_precisions[..., None] * np.eye(COMPONENTS)
        before = np.zeros_like(pivots)
        before[:, 1:] = (links + self.next_blocks.swapaxes(2, 3) @ gains)[:, :-1]
        covariances = np.asarray(np.linalg.inv(pivots), dtype=np.float64)
        for k in reversed(range(pivots.shape[1] - 1)):
            gain = gains[:, k]
            covariances[:, k] += gain @ covariances[:, k + 1] @ gain.swapaxes(1, 2)
        return SmoothedStates(covariances, before, gains)

    def _pivots(self, damping: float = 0.0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Eliminate one state after the other, diagonals larger by a part `damping`.

        Returns the block (A, K, 12, 12) of each state without those before it, and the change (A,
        K, 12, 12) of each state with that of the next one; of the last with none.
        """
        pivots, gains = self.blocks.copy(), np.zeros_like(self.blocks)
        diagonal = np.arange(COMPONENTS)
        pivots[..., diagonal, diagonal] *= 1.0 + damping
        for k in range(1, pivots.shape[1]):
            across = self.next_blocks[:, k - 1]
            gains[:, k - 1] = -np.linalg.solve(pivots[:, k - 1], across)
            pivots[:, k] += across.swapaxes(1, 2) @ gains[:, k - 1]
        return pivots, gains


def segment_equations(
    throws: SegmentedThrows,
    states: NDArray[np.float64],
    explained: NDArray[np.int64],
    spreads: NDArray[np.float64],
    state_deviations: NDArray[np.float64],
    unit: NDArray[np.float64],
    deviations: NDArray[np.float64],
) -> SegmentEquations:
    """Take differences of the segments of paths that are explained.

    Parameters
    ----------
    throws : that the paths are of
    states : (A, K, 13) in which segments begin
    explained : (A,) number of segments of each throw that count
    spreads : (A, K, 12) of the links
    state_deviations : (A, K, 12) standard deviation of each state, in SI units
    unit : (n,) θ_s on the unit cube
    deviations : (n,) standard deviation of each parameter, widths
    """
    counted = np.arange(throws.shape[1]) < explained[:, None]
    rows, segments = np.nonzero(counted)
    linked = (segments + 1 < explained[rows])[:, None]
    slopes, residuals = _linearised(
        throws, states, rows, segments, state_deviations, unit, deviations
    )
    point_slopes, link_slopes = slopes
    point_residuals, ends = residuals
    following = np.where(linked[:, 0], segments + 1, segments)
    links = np.where(linked, change(ends, states[rows, following]), 0.0)
    precisions = np.where(linked, spreads[rows, segments] ** -2.0, 0.0)
    weighted = link_slopes * precisions[:, None]
    hessian = point_slopes @ point_slopes.swapaxes(1, 2) + weighted @ link_slopes.swapaxes(1, 2)
    gradient = (point_slopes @ point_residuals[..., None])[..., 0]
    gradient += (weighted @ links[..., None])[..., 0]
    return _assembled(throws, states, counted, hessian, gradient, (weighted, links, precisions))


def _linearised(
    throws: SegmentedThrows,
    states: NDArray[np.float64],
    rows: NDArray[np.int64],
    segments: NDArray[np.int64],
    state_deviations: NDArray[np.float64],
    unit: NDArray[np.float64],
    deviations: NDArray[np.float64],
) -> tuple[
    tuple[NDArray[np.float64], NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]
]:
    """Return slopes and residuals of s segments by differences.

    They are central for parameters. A state has one difference for each component: fits to 13 boxes
    ended as near to the true θ_s as with central ones, in three quarters of the time.

    Slopes (s, 12 + n, 3 N) of the points, whitened and weighted against outliers, and (s, 12 + n,
    12) of the ends; residuals (s, 3 N) of the points, likewise, and the ends (s, 13).
    """
    n, s = unit.size, rows.size
    steps = np.clip(
        DIFFERENCE_STEP * state_deviations[rows, segments], SMALLEST_CHANGE, LARGEST_CHANGES
    )
    units, widths = _parameter_steps(unit, deviations)
    moves = np.zeros((s, 1 + COMPONENTS + 2 * n, COMPONENTS))
    axes = np.arange(COMPONENTS)
    moves[:, 1 + axes, axes] = steps
    index = np.zeros(moves.shape[1], dtype=np.int64)
    index[1 + COMPONENTS :] = 1 + np.arange(2 * n)
    begun = moved(states[rows, segments][:, None], moves)
    offsets, ends = throws.simulated(throws.worlds(units), rows, segments, begun, index)
    failed = np.asarray(~np.isfinite(ends).all(axis=(1, 2)))
    offsets, ends = np.nan_to_num(offsets), np.where(failed[:, None, None], ends[:, :1], ends)
    offsets[failed] = offsets[failed, :1]
    whitening = throws.points.whitening[rows, segments]
    whitened = (whitening[:, None] @ offsets[..., None])[..., 0]
    rooted = np.sqrt(huber_weights(np.linalg.norm(whitened[:, 0], axis=-1)))
    weighted = (whitened * rooted[:, None, :, None]).reshape(s, len(index), -1)
    spans = np.concatenate([steps, np.tile(widths, (s, 1))], axis=1)[..., None]
    up = np.arange(1, 1 + COMPONENTS + n)
    down = np.r_[np.zeros_like(axes), 1 + COMPONENTS + n : len(index)]
    point_slopes = (weighted[:, up] - weighted[:, down]) / spans
    link_slopes = np.nan_to_num(change(ends[:, up], ends[:, down])) / spans
    return (point_slopes, link_slopes), (weighted[:, 0], ends[:, 0])


def _parameter_steps(
    unit: NDArray[np.float64], deviations: NDArray[np.float64]
) -> tuple[list[NDArray[np.float64]], NDArray[np.float64]]:
    """Return `unit`, each parameter upwards, then each downwards, and the widths (n,) between."""
    steps = np.clip(DIFFERENCE_STEP * deviations, SMALLEST_PARAMETER_STEP, LARGEST_PARAMETER_STEP)
    moves = np.diag(steps)
    up, down = np.clip(unit + moves, 0.0, 1.0), np.clip(unit - moves, 0.0, 1.0)
    return [unit, *up, *down], np.diag(up) - np.diag(down)


def _assembled(
    throws: SegmentedThrows,
    states: NDArray[np.float64],
    counted: NDArray[np.bool_],
    hessian: NDArray[np.float64],
    gradient: NDArray[np.float64],
    links: tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]],
) -> SegmentEquations:
    """Put the parts of s segments together.

    `counted` (A, K) bool, which of them there are; `hessian` (s, 12 + n, 12 + n); `gradient` (s, 12
    + n); `links` the slopes (s, 12 + n, 12) times precisions, the links (s, 12) and precisions.
    """
    d = COMPONENTS
    n = gradient.shape[1] - d
    shape = counted.shape
    loose = np.diag((LOOSE * CHANGE_SPREADS) ** -2.0)
    blocks = np.tile(np.eye(d), (*shape, 1, 1))
    blocks[counted] = hessian[:, :d, :d] + loose
    across = np.zeros((*shape, d, n))
    across[counted] = hessian[:, :d, d:]
    gradients = np.zeros((*shape, d))
    gradients[counted] = gradient[:, :d]
    information, scores = np.zeros((shape[0], n, n)), np.zeros((shape[0], n))
    rows = np.nonzero(counted)[0]
    np.add.at(information, rows, hessian[:, d:, d:])
    np.add.at(scores, rows, gradient[:, d:])
    next_blocks = np.zeros((*shape, d, d))
    # The slopes of a link along the state after it are those of the identity, downwards.
    weighted, apart, precisions = links
    held = precisions.any(axis=1)
    from_rows, from_segments = (each[held] for each in np.nonzero(counted))
    to = from_rows, from_segments + 1
    next_blocks[from_rows, from_segments] = -weighted[held][:, :d]
    blocks[to] += precisions[held][:, :, None] * np.eye(d)
    gradients[to] -= (precisions * apart)[held]
    across[to] -= weighted[held][:, d:].swapaxes(1, 2)
    begun = counted[:, 0]
    known = throws.initial_precisions[begun]
    blocks[begun, 0] += known[:, :, None] * np.eye(d)
    gradients[begun, 0] += known * change(states[begun, 0], throws.initial_states[begun])
    link_precisions = np.zeros((*shape, d))
    link_precisions[counted] = precisions
    return SegmentEquations(
        blocks, next_blocks, across, gradients, information, scores, link_precisions
    )
