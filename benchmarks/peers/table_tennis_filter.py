"""An extended Kalman filter with drag, Magnus force and a bounce, as table-tennis robots use it.

State: position, velocity and spin. Flight: dv/dt = g - k_D |v| v + k_M ω × v with constant
coefficients, the spin constant (Zhang, Xiong, Zhao, Chu: An adaptive trajectory prediction method
for ping-pong robots, ICIRA 2012; Tebbe, Gao, Sastre-Rienietz, Zell: A table tennis robot system
using an industrial KUKA robot arm, GCPR 2018). Bounce: linear in velocity and spin,
v⁺ = A v⁻ + B ω⁻ and ω⁺ = C v⁻ + D ω⁻ of a hollow ball (Nakashima, Ogawa, Kobayashi, Hayakawa:
Modeling of rebound phenomenon of a rigid ball with friction and elastic effects, ACC 2010). There
A to D depend on a share α of the slip that a bounce takes away: constant, 2/5, where the ball comes
to roll, and μ (1 + e) |v_z| / |slip| where it slips all the time.

Written from these models; none of the authors' programs was used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

RADIUS, MASS, AIR_DENSITY, GRAVITY = 0.020, 0.0027, 1.204, 9.81  # m, kg, kg/m³, m/s²
FIRST_ROWS = 6  # rows whose straight line starts the filter
SHELL = 1.5  # 1 / κ of a thin shell, by which friction changes the rim's speed more than the ball's
STEPS = np.array([1e-4] * 3 + [1e-3] * 3 + [0.1] * 3)  # changes of the state for the derivatives


@dataclass(frozen=True)
class FilterParameters:
    """Parameters of the filter; the defaults are tuned to flights of a robot's laboratory."""

    drag: float = 0.552  # C_D
    magnus: float = 0.321  # C_M
    restitution: float = 0.961
    share: float = 0.117  # largest share of the slip that a bounce takes away
    # μ of a bounce that slips; None for one that is linear, with the same share always
    friction: float | None = None
    height: float = -0.0045  # m, of the ball's centre at a bounce at y = 0
    slope: float = 0.0066  # growth of this height along y
    noise: float = 0.00095  # m, standard deviation of a detection across the flight
    noise_along: float = 0.0054  # m, the same along y, along which balls fly
    acceleration: float = 0.264  # m/s^1.5, density of the process noise of the velocity
    bounce_noise: float = 0.189  # m/s, standard deviation that a bounce adds to the velocity
    spin_deviation: float = 65.8  # rad/s about every axis, before the first detection


NOT_FITTED = ("height", "slope")  # parameters that `fit_filter` leaves; all others are above zero
GATE = 30.0  # squared Mahalanobis distance above which a detection is left out


class TableTennisFilter:
    """The filter, started by a line through the first rows."""

    def __init__(
        self,
        parameters: FilterParameters,
        times: NDArray[np.float64],
        positions: NDArray[np.float64],
    ) -> None:
        self._parameters = parameters
        rows = min(FIRST_ROWS, len(times))
        since = times[:rows] - times[0]
        fallen = 0.5 * GRAVITY * since**2
        lifted = positions[:rows] + fallen[:, None] * np.array([0.0, 0.0, 1.0])
        line = np.polynomial.polynomial.polyfit(since, lifted, 1)
        self.time = float(times[0])
        self.state = np.concatenate([line[0], line[1], np.zeros(3)])
        self._noise = np.diag([parameters.noise**2, parameters.noise_along**2, parameters.noise**2])
        spread = np.full(9, parameters.spin_deviation**2)
        spread[:3], spread[3:6] = 4.0 * np.diag(self._noise), 1.0
        self.covariance = np.diag(spread)
        for time, position in zip(times, positions, strict=True):
            self.move_to(float(time))
            self._correct(position)

    def move_to(self, time: float) -> None:
        """Predict the state at a time in s, through a bounce if one comes."""
        elapsed = time - self.time
        changed = self.state + np.vstack([np.zeros(9), np.diag(STEPS)])
        moved, bounced = _moved(self._parameters, changed, elapsed)
        jacobian = (moved[1:] - moved[0]).T / STEPS
        self.state, self.time = moved[0], time
        noise = np.zeros(9)
        noise[3:6] = self._parameters.acceleration**2 * elapsed
        if bounced:
            noise[3:6] += self._parameters.bounce_noise**2
        self.covariance = jacobian @ self.covariance @ jacobian.T + np.diag(noise)

    def _correct(self, position: NDArray[np.float64]) -> None:
        residual = position - self.state[:3]
        expected = self.covariance[:3, :3] + self._noise
        if residual @ np.linalg.solve(expected, residual) > GATE:
            return
        gain = np.linalg.solve(expected, self.covariance[:3]).T
        self.state = self.state + gain @ residual
        covariance = self.covariance - gain @ self.covariance[:3]
        self.covariance = 0.5 * (covariance + covariance.T)


def filter_prediction(
    parameters: FilterParameters,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    asked: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return positions (k, 3) m at asked times (k,) s after the given rows: (n,) s and (n, 3) m."""
    filtered = TableTennisFilter(parameters, times, positions)
    state, now = filtered.state[None], filtered.time
    places = []
    for time in asked:
        state, _ = _moved(parameters, state, float(time) - now)
        now = float(time)
        places.append(state[0, :3])
    return np.array(places)


def fit_filter(
    start: FilterParameters,
    cost: Callable[[FilterParameters], float],
    evaluations: int,
) -> FilterParameters:
    """Tune the parameters by Nelder and Mead's simplex on their logarithms."""
    values = {name: value for name, value in asdict(start).items() if name not in NOT_FITTED}
    names = [name for name, value in values.items() if value is not None]

    def changed(logarithms: Sequence[float]) -> FilterParameters:
        return replace(start, **dict(zip(names, np.exp(logarithms).tolist(), strict=True)))

    fit = minimize(
        lambda logarithms: cost(changed(logarithms)),
        np.log([values[name] for name in names]),
        method="Nelder-Mead",
        options={"maxfev": evaluations, "adaptive": True},
    )
    return changed(fit.x)


def _moved(
    parameters: FilterParameters, states: NDArray[np.float64], elapsed: float
) -> tuple[NDArray[np.float64], bool]:
    """Return states (n, 9) after a time in s, all through a bounce where the first one has one."""
    flown = _flown(parameters, states, elapsed)
    above, below = _height(parameters, states[0]), _height(parameters, flown[0])
    if elapsed <= 0.0 or below >= 0.0 or above <= below:
        return flown, False
    until = elapsed * min(max(above / (above - below), 0.0), 1.0)
    touching = _rebounded(parameters, _flown(parameters, states, until))
    return _flown(parameters, touching, elapsed - until), True


def _height(parameters: FilterParameters, state: NDArray[np.float64]) -> float:
    return float(state[2] - parameters.height - parameters.slope * state[1])


def _flown(
    parameters: FilterParameters, states: NDArray[np.float64], elapsed: float
) -> NDArray[np.float64]:
    """A step by the midpoint rule."""
    middle = states + 0.5 * elapsed * _rates(parameters, states)
    return states + elapsed * _rates(parameters, middle)


def _rates(parameters: FilterParameters, states: NDArray[np.float64]) -> NDArray[np.float64]:
    velocity, spin = states[:, 3:6], states[:, 6:9]
    pressed = 0.5 * AIR_DENSITY * np.pi * RADIUS**2 / MASS
    speed = np.linalg.norm(velocity, axis=1, keepdims=True)
    rates = np.zeros_like(states)
    rates[:, :3] = velocity
    rates[:, 3:6] = -pressed * parameters.drag * speed * velocity
    rates[:, 3:6] += pressed * RADIUS * parameters.magnus * np.cross(spin, velocity)
    rates[:, 5] -= GRAVITY
    return rates


def _rebounded(parameters: FilterParameters, states: NDArray[np.float64]) -> NDArray[np.float64]:
    normal = np.array([0.0, -parameters.slope, 1.0])
    normal /= np.linalg.norm(normal)
    velocity, spin = states[:, 3:6], states[:, 6:9]
    approach = velocity @ normal
    slip = velocity - approach[:, None] * normal - RADIUS * np.cross(spin, normal)
    share = np.full(len(states), parameters.share)
    if parameters.friction is not None:
        speed = np.maximum(np.linalg.norm(slip, axis=1), 1e-9)
        grip = parameters.friction * (1.0 + parameters.restitution) * np.abs(approach)
        share = np.minimum(share, grip / speed)
    lost = share[:, None] * slip
    after = states.copy()
    after[:, 3:6] -= lost + (1.0 + parameters.restitution) * approach[:, None] * normal
    after[:, 6:9] += SHELL / RADIUS * np.cross(normal, lost)
    return after
