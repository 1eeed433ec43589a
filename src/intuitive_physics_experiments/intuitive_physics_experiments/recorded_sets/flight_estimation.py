"""State and spin of one ball from everything seen of it, through its bounce.

What is known of the spin before is a sum of Gaussians. From each of them the unknowns are fitted to
all rows at once, with the simulator as the model, by damped Gauss-Newton steps. So a bounce that
slips and one that sticks may both explain what was seen, and a spin that the air does not tell
stays wide; every explanation counts with its probability.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_experiments.recorded_sets.ball_model import (
    STATE_SIZE,
    UNKNOWN_SIZE,
    BallModel,
)

STEPS = np.array([1e-4] * 3 + [1e-3] * 3 + [0.2] * 3 + [1e-3] * 5 + [1e-4] * 2)
"""By which unknowns are changed for finite differences."""

MOST_ROUNDS = 30
"""Damped steps at most."""

CONVERGED = 1e-2
"""Decrease of the cost, which is minus a log probability, that ends the search."""

LARGEST_DAMPING = 1e6
"""At which no step lowers the cost."""

FIRST_ROWS = 8
"""Whose straight line starts the search."""

LOOSE_POSITION, LOOSE_VELOCITY = 0.1, 5.0
"""m and m/s, standard deviations around that line."""

UNLIKELY = 10.0
"""Below the log probability of the best explanation, at which another is dropped."""


@dataclass(frozen=True, eq=False)
class BallPrior:
    """What is known of a flight before it is seen.

    Parameters
    ----------
    coefficients : (7,) means of `COEFFICIENTS`
    coefficient_covariance : (7, 7) of single flights
    spin_means : (k, 3) rad/s about the flight's axes (`flight_axes`), of each Gaussian
    spin_covariance : (3, 3) (rad/s)² about them, of every Gaussian
    spin_weights : (k,) probabilities of the Gaussians
    noise : (3,) m, standard deviations of a detection
    degrees : of freedom of Student's t, by which a detection may be no ball
    """

    coefficients: NDArray[np.float64]
    coefficient_covariance: NDArray[np.float64]
    spin_means: NDArray[np.float64]
    spin_covariance: NDArray[np.float64]
    spin_weights: NDArray[np.float64]
    noise: NDArray[np.float64] = field(default_factory=lambda: np.array([6e-4, 9e-4, 8e-4]))
    degrees: float = 4.0


@dataclass(frozen=True, eq=False)
class BallEstimate:
    """Explanations of a flight.

    Parameters
    ----------
    start : s, the time of the states
    unknowns : (k, 16), as `BallModel.positions` takes them
    covariances : (k, 16, 16)
    weights : (k,) probabilities
    components : (k,) the Gaussian of the prior that each comes from
    log_evidence : log probability of what was seen, up to a constant that depends on the rows only
    """

    start: float
    unknowns: NDArray[np.float64]
    covariances: NDArray[np.float64]
    weights: NDArray[np.float64]
    components: NDArray[np.intp]
    log_evidence: float

    def predict(self, model: BallModel, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """Median positions (n, 3) m over the explanations at times (n,) s, not before the start."""
        paths = model.positions(self.unknowns, times - self.start)
        order = np.argsort(paths, axis=0)
        below = np.cumsum(self.weights[order], axis=0)
        middle = np.argmax(below >= 0.5 * below[-1], axis=0)[None]
        chosen = np.take_along_axis(order, middle, axis=0)
        return np.take_along_axis(paths, chosen, axis=0)[0]

    @property
    def likeliest(self) -> int:
        """Index of the likeliest explanation."""
        return int(np.argmax(self.weights))

    @property
    def spin(self) -> NDArray[np.float64]:
        """Mean spin (3,) rad/s."""
        return self.weights @ self.unknowns[:, 6:9]

    @property
    def spin_covariance(self) -> NDArray[np.float64]:
        """Covariance (3, 3) (rad/s)² of the spin, within and between the explanations."""
        apart = self.unknowns[:, 6:9] - self.spin
        within = self.covariances[:, 6:9, 6:9] + apart[:, :, None] * apart[:, None, :]
        return np.einsum("k,kij->ij", self.weights, within)


def flight_axes(velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors (3, 3), in rows: across the flight and level, across and upward, along it."""
    along = velocity / max(float(np.linalg.norm(velocity)), 1e-9)
    level = np.array([-along[1], along[0], 0.0])
    length = float(np.linalg.norm(level))
    level = level / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    return np.array([level, np.cross(along, level), along])


def estimate_ball(
    model: BallModel,
    prior: BallPrior,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
) -> BallEstimate:
    """Estimate state, spin and coefficients of one flight.

    Parameters
    ----------
    model : the simulator
    prior : what is known before
    times : (n,) s, n ≥ 2
    positions : (n, 3) m
    """
    problem = _Problem(model, prior, times, positions)
    unknowns, costs = problem.solve()
    normal, _ = problem.linearised(unknowns)
    volumes = 0.5 * (np.linalg.slogdet(problem.information)[1] - np.linalg.slogdet(normal)[1])
    evidence = np.log(prior.spin_weights) + volumes - costs
    kept = np.flatnonzero(evidence > evidence.max() - UNLIKELY)
    weights = np.exp(evidence[kept] - evidence.max())
    return BallEstimate(
        float(times[0]),
        unknowns[kept],
        np.linalg.inv(normal[kept]),
        weights / weights.sum(),
        kept,
        float(evidence.max() + np.log(weights.sum())),
    )


class _Problem:
    """Cost of unknowns (k, 16), one row for each Gaussian: minus the log of their probability."""

    def __init__(
        self,
        model: BallModel,
        prior: BallPrior,
        times: NDArray[np.float64],
        positions: NDArray[np.float64],
    ) -> None:
        self._model, self._prior = model, prior
        self._since, self._positions = times - times[0], positions
        rows = min(FIRST_ROWS, len(times))
        line = np.polynomial.polynomial.polyfit(self._since[:rows], positions[:rows], 1)
        axes = flight_axes(line[1])
        known = np.concatenate([line[0], line[1], np.zeros(3), prior.coefficients])
        self._means = np.tile(known, (len(prior.spin_means), 1))
        self._means[:, 6:STATE_SIZE] = prior.spin_means @ axes
        self.information = np.zeros((UNKNOWN_SIZE, UNKNOWN_SIZE))
        self.information[:3, :3] = np.eye(3) / LOOSE_POSITION**2
        self.information[3:6, 3:6] = np.eye(3) / LOOSE_VELOCITY**2
        self.information[6:9, 6:9] = axes.T @ np.linalg.inv(prior.spin_covariance) @ axes
        self.information[9:, 9:] = np.linalg.inv(prior.coefficient_covariance)

    def solve(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Unknowns (k, 16) of least cost and their costs (k,), by damped Gauss-Newton steps."""
        unknowns = self._means.copy()
        costs = self._costs(unknowns, self._means)
        damping = np.full(len(unknowns), 1e-3)
        normal, gradient = self.linearised(unknowns)
        active = np.arange(len(unknowns))
        for _ in range(MOST_ROUNDS):
            scales = np.einsum("kii->ki", normal[active]) * damping[active, None]
            damped = normal[active] + scales[:, :, None] * np.eye(UNKNOWN_SIZE)
            tried = unknowns[active] - np.linalg.solve(damped, gradient[active, :, None])[..., 0]
            tried_costs = self._costs(tried, self._means[active])
            better = tried_costs < costs[active]
            moved = active[better]
            damping[active] *= np.where(better, 0.1, 10.0)
            gains = costs[moved] - tried_costs[better]
            unknowns[moved], costs[moved] = tried[better], tried_costs[better]
            still = moved[gains > CONVERGED]
            if still.size:
                normal[still], gradient[still] = self.linearised(unknowns[still], still)
            stuck = active[~better]
            active = np.sort(np.concatenate([still, stuck[damping[stuck] < LARGEST_DAMPING]]))
            if not active.size:
                break
        return unknowns, costs

    def _costs(
        self, unknowns: NDArray[np.float64], means: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        paths = self._model.positions(unknowns, self._since)
        squares = (((paths - self._positions) / self._prior.noise) ** 2).sum(axis=-1)
        degrees = self._prior.degrees
        by_rows = 0.5 * (degrees + 3.0) * np.log1p(squares / degrees).sum(axis=1)
        apart = unknowns - means
        costs = by_rows + 0.5 * np.einsum("ki,ij,kj->k", apart, self.information, apart)
        return np.where(np.isfinite(costs), costs, np.inf)

    def linearised(
        self, unknowns: NDArray[np.float64], components: NDArray[np.intp] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Normal matrices (k, 16, 16) and gradients (k, 16) of the costs."""
        means = self._means if components is None else self._means[components]
        changes = np.vstack([np.zeros(UNKNOWN_SIZE), np.diag(STEPS)])
        changed = (unknowns[:, None] + changes).reshape(-1, UNKNOWN_SIZE)
        paths = self._model.positions(changed, self._since)
        paths = paths.reshape(len(unknowns), UNKNOWN_SIZE + 1, -1, 3) / self._prior.noise
        slopes = (paths[:, 1:] - paths[:, :1]) / STEPS[:, None, None]
        residuals = paths[:, 0] - self._positions / self._prior.noise
        degrees = self._prior.degrees
        weights = (degrees + 3.0) / (degrees + (residuals**2).sum(axis=-1))
        weighted = (slopes * weights[:, None, :, None]).reshape(len(unknowns), UNKNOWN_SIZE, -1)
        flat = slopes.reshape(weighted.shape)
        normal = weighted @ flat.transpose(0, 2, 1) + self.information
        gradient = (weighted @ residuals.reshape(len(unknowns), -1, 1))[..., 0]
        return normal, gradient + (unknowns - means) @ self.information
