"""Samples of a posterior with more than one mode, by importance."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ObjectState,
)
from intuitive_physics_predictor.estimation.modes import Modes, misfit, principal_deviations
from intuitive_physics_predictor.estimation.trajectory_fit import TrajectoryFit
from intuitive_physics_predictor.estimation.unknowns import (
    KINEMATIC,
    MOTION,
    PLACE,
    SPIN,
    VELOCITY,
    Unknowns,
)
from intuitive_physics_predictor.noise import StateNoise

WIDENING = 1.1
"""Factor on the standard deviations of the modes that samples are drawn from: tails that are too
thin would give single samples large weights."""

LEAST_SHARE = 0.05
"""Smallest share of the samples that a mode has."""


LEAST_EFFECTIVE = 0.15
"""Share of the samples that has to count."""

MOST_HALVINGS = 8
"""Halvings of the logarithms: by then all weights are alike."""


STILL_GUESS = 0.5
"""A spin counts as a guess while its standard deviation is more than this part of the guess's."""

LEAST_POSSIBLE = 10.0
"""Independent samples that have to be possible: of fewer a prediction would repeat some."""


@dataclass(frozen=True, eq=False)
class WeightedStates:
    """Samples of an object's unknowns at one time.

    Parameters
    ----------
    values : (count, 12 + p) as `Unknowns.values`
    weights : (count,), summing to one
    unknowns : what the columns are
    """

    values: NDArray[np.float64]
    weights: NDArray[np.float64]
    unknowns: Unknowns

    @property
    def moments(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Mean (12,) and covariance (12, 12) of x, v, ω and b."""
        kinematic = self.values[:, :KINEMATIC]
        mean = self.weights @ kinematic
        apart = kinematic - mean
        return mean, (self.weights[:, None] * apart).T @ apart

    @property
    def spin_is_guess(self) -> bool:
        """Whether the spin was a guess, and the detections have hardly narrowed it."""
        guess = self.unknowns.guessed_spin
        _, covariance = self.moments
        return guess > 0.0 and bool(
            np.linalg.det(covariance[SPIN, SPIN] / (STILL_GUESS * guess) ** 2) > 1.0
        )

    def where(self, possible: NDArray[np.bool_]) -> WeightedStates:
        """Return the distribution of the possible (count,) samples alone.

        With too few of them it stays as it is.
        """
        weights = self.weights * possible
        total = weights.sum()
        if total * total < LEAST_POSSIBLE * (weights @ weights) or total == 0.0:
            return self
        return replace(self, weights=weights / total)

    def choose(self, count: int, rng: np.random.Generator) -> NDArray[np.int64]:
        """Return indices (count,) of samples, each as often as its weight says, in random order."""
        places = (np.arange(count) + rng.random()) / count
        chosen = np.searchsorted(np.cumsum(self.weights), places).clip(max=len(self.weights) - 1)
        return np.asarray(rng.permutation(chosen))

    def draw(
        self, count: int, noise: StateNoise, rng: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Draw motions (count, 9): position, velocity, spin; and their parameters (count, p).

        The factors of the noise stretch the samples about their mean; its fixed part is added. The
        parameters are on the unit cube.
        """
        chosen = self.choose(count, rng)
        motions_now = self.values[:, MOTION]
        mean = self.weights @ motions_now
        factors = np.repeat([noise.scale, noise.scale, noise.spin_scale], 3)
        motions = mean + factors * (motions_now[chosen] - mean)
        fixed = np.repeat([noise.position, noise.linear_velocity, noise.angular_velocity], 3)
        if fixed.any():
            motions += fixed * rng.standard_normal(motions.shape)
        return motions, self.values[chosen, KINEMATIC:]

    def state(self, orientation: NDArray[np.float64]) -> ObjectState:
        """Return the mean state with the covariance of the samples, and orientation (4,)."""
        mean, covariance = self.moments
        rows = np.r_[POSITION, LINEAR_VELOCITY, ANGULAR_VELOCITY]
        whole = np.zeros((ERROR_SIZE, ERROR_SIZE))
        whole[np.ix_(rows, rows)] = covariance[MOTION, MOTION]
        return ObjectState(mean[PLACE], orientation, mean[VELOCITY], mean[SPIN], whole)


def draw_weighted(
    fit: TrajectoryFit, modes: Modes, count: int, time: float, rng: np.random.Generator
) -> WeightedStates:
    """Draw `count` samples of the posterior, and carry them on to a time (s).

    They are drawn from normal distributions about the modes, each weighed by its posterior density
    over the density that it was drawn from.
    """
    deviations, axes = principal_deviations(modes.information)
    roots = WIDENING * axes * deviations[:, None]
    volumes = 2.0 * np.log(WIDENING * deviations).sum(axis=1)
    shares = np.exp(0.5 * volumes - modes.misfits - (0.5 * volumes - modes.misfits).max())
    shares = np.maximum(shares / shares.sum(), LEAST_SHARE)
    shares /= shares.sum()
    drawn = np.concatenate(
        [
            centre + rng.standard_normal((size, len(centre))) @ root.T
            for centre, root, size in zip(
                modes.centres, roots, rng.multinomial(count, shares), strict=True
            )
        ]
    )
    apart = drawn - modes.centres[:, None]
    squares = ((apart @ modes.information) * apart).sum(axis=2) / WIDENING**2
    each = np.log(shares)[:, None] - 0.5 * (squares + volumes[:, None])
    drawn_from = np.logaddexp.reduce(each, axis=0)
    residuals, states = fit.residuals_and_states(drawn, time)
    logarithms = -misfit(drawn, residuals) - drawn_from
    return WeightedStates(states, _weights(logarithms), fit.unknowns)


def _weights(logarithms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights (count,) of samples from their logarithms, tempered where few would have them all.

    Where a contact makes the posterior far from normal, its modes miss some of it; the logarithms
    are then taken by halves until `LEAST_EFFECTIVE` of the samples count.
    """
    for _ in range(MOST_HALVINGS):
        weights = np.exp(logarithms - logarithms.max())
        weights /= weights.sum()
        if 1.0 / (weights @ weights) >= LEAST_EFFECTIVE * len(weights):
            break
        logarithms = 0.5 * logarithms
    return np.asarray(weights)
