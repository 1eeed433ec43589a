"""State and spin of one ball from everything seen of it, through its bounce.

What is known of the spin before is a sum of Gaussians. From each of them the unknowns are fitted to
all rows at once, with the simulator as the model, by damped Gauss-Newton steps. So a bounce that
slips and one that sticks may both explain what was seen, and a spin that the air does not tell
stays wide; every explanation counts with its probability.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from intuitive_physics.materials import StaticParameters
from intuitive_physics.scene import Environment, Plane, Scene, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.simulation import WorldBatch, make_simulator, pack_worlds
from intuitive_physics.state import ObjectState
from intuitive_physics_experiments.recorded_sets.table_tennis import (
    BALL_MASS,
    BALL_MATERIAL,
    BALL_RADIUS,
    TABLE_MATERIAL,
)

# What varies from flight to flight: C_D without spin; largest lift coefficient, and the spin ratio
# that it is approached at (`_air_coefficients`); e and μ of ball and table; height of the ball's
# centre at a bounce at y = 0 (m), and how much that grows along y.
COEFFICIENTS = ("drag", "lift", "lift_ratio", "restitution", "friction", "height", "slope")

STATE_SIZE = 9  # Position, velocity and spin
UNKNOWN_SIZE = STATE_SIZE + len(COEFFICIENTS)  # State and coefficients
LOWEST = np.array([0.0, 0.0, 0.05, 0.0, 0.0, -0.1, -0.2])  # Lower bounds of the coefficients

# Upper bounds. Where a camera measures heights askew, a bounce may seem to be faster than the fall
# before it: restitution may be a little above 1.
HIGHEST = np.array([3.0, 2.0, 3.0, 1.1, 2.0, 0.1, 0.2])

# C_D over the drag of a flight, less one, grows by these with the spin ratio, its square, and the
# speed (s/m). The first two are a fit to those flights of even number of the recorded set whose
# bounce gives their spin, the third leaves least spread of drag and error after the bounce there.
DRAG_LAW = (0.56, -0.60, -0.05)

USUAL_SPEED = 8.0  # m/s, at which a ball without spin has the drag of its flight

# Spin ratio up to which the laws of drag and lift were fitted; they stay as they are above.
HIGHEST_RATIO = 1.2

LEAST_DRAG = 0.3  # C_D over the drag of a flight, at least

# s, after which drag and Magnus coefficient follow speed and spin, which a bounce changes.
LEG = 0.1

INSTANT = 1e-5  # s between positions and orientations that give velocity and spin
SHELL = 5.0 / 3.0  # Moment of inertia of a thin shell over that of a solid ball

# Changes of the unknowns for finite differences
STEPS = np.array([1e-4] * 3 + [1e-3] * 3 + [0.2] * 3 + [1e-3] * 5 + [1e-4] * 2)

MOST_ROUNDS = 30  # Damped steps at most
CONVERGED = 1e-2  # Decrease of the cost, which is minus a log probability, that ends the search
LARGEST_DAMPING = 1e6  # Damping at which no step lowers the cost
FIRST_ROWS = 8  # Rows whose straight line starts the search
LOOSE_POSITION, LOOSE_VELOCITY = 0.1, 5.0  # m and m/s, standard deviations around that line
UNLIKELY = 10.0  # Log probability below that of the best explanation at which another is dropped


# Arrays of a batch with a row for each environment, except the planes.
ENVIRONMENT_ARRAYS = (
    "gravity",
    "plane_counts",
    "plane_materials",
    "corner_counts",
    "corners",
    "box_counts",
    "boxes",
    "box_materials",
)


class BallModel:
    """Simulates balls that differ in state and coefficients."""

    def __init__(self) -> None:
        self._simulator = make_simulator("stepped")
        ball = SceneObject("ball", BALL_MATERIAL, Sphere(BALL_RADIUS), 1.0, 1.0, SHELL)
        table = Plane("table", TABLE_MATERIAL, (0.0, 0.0, 1.0), -BALL_RADIUS)
        density = BALL_MASS / Sphere(BALL_RADIUS).volume
        parameters = StaticParameters.uniform((BALL_MATERIAL, TABLE_MATERIAL), density=density)
        scene = Scene(Environment([table]), (ball,), (ObjectState((0.0, 0.0, 1.0)),))
        self._world = pack_worlds(
            [scene], parameters.with_pair(BALL_MATERIAL, TABLE_MATERIAL, rolling_friction=0.0)
        )

    def positions(
        self, unknowns: NDArray[np.float64], times: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Simulate positions (n, k, 3) m at times (k,) s, increasing, none negative.

        The unknowns (n, 16) are position (m), velocity (m/s) and spin (rad/s) at time 0, then
        `COEFFICIENTS`; those out of bounds count as the bounds.
        """
        paths = np.empty((len(unknowns), len(times), 3))
        now, begin = unknowns, 0.0
        while True:
            end = begin + LEG
            inside = (times >= begin) & (times < end)
            if times[-1] < end:
                paths[:, inside] = self._leg(now, times[inside] - begin)[0]
                return paths
            asked = np.concatenate([times[inside] - begin, LEG + INSTANT * np.arange(3.0)])
            places, turns = self._leg(now, asked, turns=True)
            paths[:, inside] = places[:, :-3]
            now, begin = _state_at_end(now, places[:, -3:], turns[:, -3:]), end + INSTANT

    def _leg(
        self, unknowns: NDArray[np.float64], times: NDArray[np.float64], *, turns: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Positions (n, k, 3) m and, if asked for, orientations (n, k, 4)."""
        rollout = self._simulator.rollout_batch(self._worlds(unknowns), times, orientations=turns)
        orientations = np.empty(0) if rollout.orientations is None else rollout.orientations[:, 0]
        return rollout.positions[:, 0], orientations

    def _worlds(self, unknowns: NDArray[np.float64]) -> WorldBatch:
        n = len(unknowns)
        states = np.zeros((n, 1, 13))
        states[:, 0, :3], states[:, 0, 6] = unknowns[:, :3], 1.0
        states[:, 0, 7:] = unknowns[:, 3:STATE_SIZE]
        known = np.clip(unknowns[:, STATE_SIZE:], LOWEST, HIGHEST)
        drag, lift, lift_ratio, restitution, friction, height, slope = known.T
        copies = self._world.repeated(states)
        air = copies.air_factors.copy()
        air[:, 0] *= _air_coefficients(unknowns, drag, lift, lift_ratio)
        coefficients = np.repeat(self._world.coefficients, n, axis=0)
        coefficients[:, :2] = friction[:, None, None, None]
        coefficients[:, 3] = restitution[:, None, None]
        planes = np.zeros((n, 1, 4))
        planes[:, 0, 1], planes[:, 0, 2] = -slope, 1.0
        planes[:, 0, 3] = height
        planes /= np.sqrt(1.0 + slope**2)[:, None, None]
        planes[:, 0, 3] -= BALL_RADIUS
        one_each: dict[str, Any] = {
            name: np.repeat(getattr(self._world, name), n, axis=0) for name in ENVIRONMENT_ARRAYS
        }
        return replace(
            copies,
            **one_each,
            air_factors=air,
            planes=planes,
            coefficients=coefficients,
            density=np.repeat(self._world.density, n, axis=0),
            environment_index=np.arange(n),
            parameter_index=np.arange(n),
            environments=self._world.environments * n,
        )


def _state_at_end(
    unknowns: NDArray[np.float64], places: NDArray[np.float64], turns: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Unknowns (n, 16) in the middle of three instants: places (n, 3, 3) m, turns (n, 3, 4)."""
    state = unknowns.copy()
    state[:, :3] = places[:, 1]
    state[:, 3:6] = (places[:, 2] - places[:, 0]) / (2.0 * INSTANT)
    turned = Rotation.from_quat(turns[:, 2]) * Rotation.from_quat(turns[:, 0]).inv()
    state[:, 6:9] = turned.as_rotvec() / (2.0 * INSTANT)
    return state


def _air_coefficients(
    unknowns: NDArray[np.float64],
    drag: NDArray[np.float64],
    lift: NDArray[np.float64],
    lift_ratio: NDArray[np.float64],
) -> NDArray[np.float64]:
    """C_D and C_M (n, 2) of balls (n, 16), by the ratio S = r |ω × v| / v² of rim speed to speed.

    C_M = C_L / S, and the lift coefficient C_L = lift · tanh(S / lift_ratio) of a fast spin
    approaches a constant, as it does in wind tunnels.
    """
    velocity, spin = unknowns[:, 3:6], unknowns[:, 6:9]
    speeds = np.maximum(np.linalg.norm(velocity, axis=1), 1e-3)
    ratios = BALL_RADIUS * np.linalg.norm(np.cross(spin, velocity), axis=1) / speeds**2
    ratios = np.clip(ratios, 1e-6, HIGHEST_RATIO)
    first, second, by_speed = DRAG_LAW
    law = 1.0 + first * ratios + second * ratios**2 + by_speed * (speeds - USUAL_SPEED)
    magnus = lift * np.tanh(ratios / lift_ratio) / ratios
    return np.column_stack([drag * np.maximum(law, LEAST_DRAG), magnus])


@dataclass(frozen=True, eq=False)
class BallPrior:
    """Prior of a flight."""

    coefficients: NDArray[np.float64]  # (7,) means of `COEFFICIENTS`
    coefficient_covariance: NDArray[np.float64]  # (7, 7) of single flights
    # (k, 3) rad/s about the flight's axes (`flight_axes`), of each Gaussian
    spin_means: NDArray[np.float64]
    spin_covariance: NDArray[np.float64]  # (3, 3) (rad/s)² about them, of every Gaussian
    spin_weights: NDArray[np.float64]  # (k,) probabilities of the Gaussians
    # (3,) m, standard deviations of a detection
    noise: NDArray[np.float64] = field(default_factory=lambda: np.array([6e-4, 9e-4, 8e-4]))
    degrees: float = 4.0  # of freedom of Student's t, by which a detection may be no ball


@dataclass(frozen=True, eq=False)
class BallEstimate:
    """Explanations of a flight."""

    start: float  # s, the time of the states
    unknowns: NDArray[np.float64]  # (k, 16), as `BallModel.positions` takes them
    covariances: NDArray[np.float64]  # (k, 16, 16)
    weights: NDArray[np.float64]  # (k,) probabilities
    components: NDArray[np.intp]  # (k,) the Gaussian of the prior that each comes from
    # log probability of what was seen, up to a constant that depends on the rows only
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
    """Unit vectors (3, 3), in rows: across the flight and level, across and upward, along it.

    The flight has the `velocity` (3,) m/s.
    """
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
    """Estimate state, spin and coefficients of one flight: times (n,) s, positions (n, 3) m."""
    problem = _Problem(model, prior, times, positions)
    unknowns, costs = problem.solve()
    normal, _ = problem.linearised(unknowns)
    volumes: NDArray[np.float64] = 0.5 * (
        np.linalg.slogdet(problem.information)[1] - np.linalg.slogdet(normal)[1]
    )
    evidence = np.log(prior.spin_weights) + volumes - costs
    kept = np.flatnonzero(evidence > evidence.max() - UNLIKELY)
    weights = np.exp(evidence[kept] - evidence.max())
    return BallEstimate(
        float(times[0]),
        unknowns[kept],
        np.asarray(np.linalg.inv(normal[kept]), dtype=np.float64),
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
