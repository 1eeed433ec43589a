"""Shots of a launcher with the same settings: the spread that is predicted and the one that was.

Of some launches the distribution of the state at one distance from the launcher is fitted: mean and
covariance, which hold how differently the launcher shoots. It is simulated on, and what comes of it
at the table is compared with what other launches did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.materials import StaticParameters
from intuitive_physics.observation import Observation
from intuitive_physics.scene import Environment, Scene
from intuitive_physics.simulation import Simulator
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.flight_fits import state_covariance
from intuitive_physics_experiments.results import markdown_table
from intuitive_physics_predictor.noisy_newton import predict
from intuitive_physics_predictor.parameter_uncertainty import UncertainParameters

START_X = 0.25  # m along the flight: every launch is seen from there on
FAR_X = 2.0  # m along the table, where flights are compared
LONGEST_WAY = 0.2  # s that a launch may take to `START_X`; the bounce comes later
STEP = 0.005  # s, of the flight there; velocities are differences over two of them

# s between recorded points, and between simulated ones, which are read the same way.
FRAME = 1.0 / 180.0

HORIZON = 1.2  # s that are simulated, long enough to bounce and to reach `FAR_X`
APPROACH = 8  # Points of the fall before the bounce that are continued to the table
LOWEST_TURN = 0.15  # m above the bounce height below which a ball that turns upward has bounced
SAMPLES = 2000  # Simulations from which the predicted spread is taken

# What is compared, in m.
QUANTITIES = ("y at x = 2 m", "z at x = 2 m", "x of the bounce", "y of the bounce")


@dataclass(frozen=True, eq=False)
class LaunchSpread:
    """Standard deviations, in m, of `QUANTITIES`."""

    # predicted, seen: (4,) of the prediction and of the launches it was not made from
    predicted: NDArray[np.float64]
    seen: NDArray[np.float64]
    # low, high: (4,) 95 % confidence interval of `seen`, if the launches are normal
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    offset: NDArray[np.float64]  # (4,) mean of the prediction minus mean of the launches
    launches: NDArray[np.int64]  # (4,) launches that show each quantity

    def to_markdown(self) -> str:
        """Return a table in millimetres."""
        header = ["same settings, mm", "predicted σ", "σ seen", "95 % of it", "mean off", "n"]
        rows = [
            [
                name,
                f"{1e3 * self.predicted[k]:.1f}",
                f"{1e3 * self.seen[k]:.1f}",
                f"{1e3 * self.low[k]:.1f} to {1e3 * self.high[k]:.1f}",
                f"{1e3 * self.offset[k]:+.1f}",
                str(self.launches[k]),
            ]
            for k, name in enumerate(QUANTITIES)
        ]
        return markdown_table(header, rows)


def launch_spread(
    past: Sequence[Observation],
    others: Sequence[Observation],
    parameters: UncertainParameters,
    *,
    seed: int,
    simulator: Simulator,
) -> LaunchSpread:
    """Predict the spread of launches from that of the first stretch of others."""
    if len(past) < 8 or len(others) < 3:
        raise InvalidInputError(
            f"there are {len(past)} launches to predict from and {len(others)} to compare with; "
            "expected at least 8 and 3"
        )
    first, known = past[0], parameters.learned.parameters
    scene = Scene(
        first.environment, (first.objects[0].object,), (_launch_state(past, known, simulator),)
    )
    times = np.arange(0.0, HORIZON, FRAME)
    rng = np.random.default_rng(seed)
    flights = predict(
        scene, parameters, times, rng=rng, sample_count=SAMPLES, simulator=simulator
    ).positions[:, 0]
    radius = scene.objects[0].shape.bounding_radius
    predicted = np.array([_quantities(times, x, scene.environment, radius) for x in flights])
    tracks = [launch.objects[0].trajectory for launch in others]
    observed = np.array(
        [_quantities(t.times, t.positions, scene.environment, radius) for t in tracks]
    )
    count = (~np.isnan(observed)).sum(axis=0)
    deviation = np.nanstd(observed, axis=0, ddof=1)
    freedom = count - 1
    return LaunchSpread(
        np.nanstd(predicted, axis=0),
        deviation,
        deviation * np.sqrt(freedom / chi2.ppf(0.975, freedom)),
        deviation * np.sqrt(freedom / chi2.ppf(0.025, freedom)),
        np.nanmean(predicted, axis=0) - np.nanmean(observed, axis=0),
        count,
    )


def _launch_state(
    launches: Sequence[Observation], parameters: StaticParameters, simulator: Simulator
) -> ObjectState:
    """Mean and covariance of the states in which launches pass `START_X`."""
    states = np.array([_state_at_start(launch, parameters, simulator) for launch in launches])
    mean = states.mean(axis=0)
    # The next launch is about the mean of n launches, which itself is uncertain.
    spread = np.cov(states.T) * (1.0 + 1.0 / len(states))
    return ObjectState(mean[:3], linear_velocity=mean[3:], covariance=state_covariance(spread))


def _state_at_start(
    launch: Observation, parameters: StaticParameters, simulator: Simulator
) -> NDArray[np.float64]:
    """Position and velocity, (6,), with which a launch passes `START_X` from its initial state."""
    times = np.arange(0.0, LONGEST_WAY, STEP)
    flight = simulator.rollout([launch.scene()], parameters, times, orientations=False)
    path = flight.positions[0, 0]
    if path[0, 0] >= START_X or path[-2, 0] < START_X:
        raise InvalidInputError(
            f"launch {launch.id} goes from x = {path[0, 0]:.3f} to {path[-1, 0]:.3f} m in "
            f"{LONGEST_WAY} s; expected it to pass {START_X} m"
        )
    velocity = np.gradient(path, STEP, axis=0)
    k = int(np.argmax(path[:, 0] >= START_X))
    share = (START_X - path[k - 1, 0]) / (path[k, 0] - path[k - 1, 0])
    states = np.hstack([path, velocity])
    return np.asarray(states[k - 1] + share * (states[k] - states[k - 1]))


def _quantities(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    environment: Environment,
    radius: float,
) -> NDArray[np.float64]:
    """Return `QUANTITIES` of one flight, (4,), NaN for what it does not reach."""
    far = np.full(2, np.nan)
    if positions[:, 0].max() >= FAR_X:
        k = max(int(np.argmax(positions[:, 0] >= FAR_X)), 1)
        before, after = positions[k - 1], positions[k]
        share = (FAR_X - before[0]) / (after[0] - before[0])
        far = (before + share * (after - before))[1:]
    height = environment.planes[0].signed_distances(positions) - radius
    return np.concatenate([far, _bounce(times, positions, height)])


def _bounce(
    times: NDArray[np.float64], positions: NDArray[np.float64], height: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Place (x, y) where the parabola of the fall before the first bounce meets the table."""
    turns = (height[1:-1] <= height[:-2]) & (height[1:-1] < height[2:])
    lowest = np.flatnonzero(turns & (height[1:-1] < LOWEST_TURN)) + 1
    if not lowest.size or lowest[0] < APPROACH:
        return np.full(2, np.nan)
    rows = slice(lowest[0] - APPROACH, lowest[0])
    since = times[rows] - times[lowest[0]]
    falling = np.polynomial.Polynomial.fit(since, height[rows], 2)
    real = [float(root.real) for root in falling.roots() if abs(root.imag) < 1e-9]
    meets = min(real, key=abs, default=float("nan"))
    path = np.polynomial.polynomial.polyfit(since, positions[rows, :2], 2)
    return np.asarray(np.array([1.0, meets, meets**2]) @ path)
