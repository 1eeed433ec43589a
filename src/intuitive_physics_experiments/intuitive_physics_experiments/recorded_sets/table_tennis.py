"""Table-tennis balls in flight, recorded by others, as observations above a table.

Initial states are fitted to the whole flight before the first bounce. Air is left out as the paper
does, unless coefficients of it are given; what the model lacks then stays visible in the
covariances and errors. In air the spin is part of the fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters, parameter_names
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import non_negative_float, positive_float
from intuitive_physics_experiments.flight_fits import (
    AirFactors,
    fit_initial_state,
    fit_initial_state_in_air,
)
from intuitive_physics_recordings.npz_file import Arrays, split_rows

BALL_MATERIAL, TABLE_MATERIAL = "ball", "table"  # Names of the materials
BALL_RADIUS = 0.020  # m, by the rules of the sport
BALL_MASS = 0.0027  # kg, by the rules of the sport
LAUNCH_BOUNCE_HEIGHT = 0.759  # m, height of the ball's centre at a bounce in the launches

# m, of the ball's centre when it touches the table, in the frames of the two recordings.
GUN_BOUNCE_HEIGHT = -0.44

CLEARANCE = 0.02  # m above the bounce height where a ball may touch the table, allowing for noise

# m above the bounce height below which a ball that turns upward has bounced unseen.
TURNING_HEIGHT = 0.15

FEWEST_FREE_POINTS = 6  # Before the first bounce, that an initial state is fitted to
FEWEST_POINTS = 20  # Points of the shortest recording that becomes an observation


@dataclass(frozen=True)
class AirCoefficients:
    """Coefficients of air on a ball; all zero is the paper's vacuum."""

    drag: float = 0.0  # C_d, about 0.47 for a smooth sphere at these speeds
    magnus: float = 0.0  # C_M, about 1

    def __post_init__(self) -> None:
        non_negative_float(self.drag, "drag coefficient")
        non_negative_float(self.magnus, "Magnus coefficient")


VACUUM = AirCoefficients()  # No drag and no Magnus force


def ball_parameters() -> StaticParameters:
    """Default θ_s of ball and table, but for the ball's density, which counts in air."""
    default = StaticParameters.uniform((BALL_MATERIAL, TABLE_MATERIAL))
    return default.with_density(BALL_MATERIAL, BALL_MASS / Sphere(BALL_RADIUS).volume)


def launch_observations(arrays: Arrays, air: AirCoefficients = VACUUM) -> list[Observation]:
    """Observations of the launcher's shots; recordings without enough free flight are left out.

    The arrays are `time` (n,) s, `position` (n, 3) m, `offsets`, `radius` m.
    """
    radius = positive_float(arrays["radius"], "radius")
    environment = table_at(LAUNCH_BOUNCE_HEIGHT - radius)
    ball = ball_in_air(radius, air)
    recordings = zip(split_rows(arrays, "time"), split_rows(arrays, "position"), strict=True)
    observations = [
        flight_observation(f"launch_{i:03d}", times - times[0], positions, environment, ball)
        for i, (times, positions) in enumerate(recordings)
    ]
    return [observation for observation in observations if observation is not None]


def gun_observations(arrays: Arrays, air: AirCoefficients = VACUUM) -> list[Observation]:
    """Observations of the gun's flights; recordings without enough free flight are left out.

    The arrays are `position` (n, 3) m, `velocity` (n, 3) m/s, `offsets`, `dt_implied` s, without
    time stamps. Displacement over speed of neighbouring rows comes in whole multiples of half of
    `dt_implied`, so the time between two rows is taken to be the nearest such multiple; rows that
    repeat the one before are left out.
    """
    period = positive_float(arrays["dt_implied"], "dt_implied")
    environment = table_at(GUN_BOUNCE_HEIGHT - BALL_RADIUS)
    ball = ball_in_air(BALL_RADIUS, air)
    recordings = zip(split_rows(arrays, "position"), split_rows(arrays, "velocity"), strict=True)
    observations = []
    for i, (positions, velocities) in enumerate(recordings):
        times, kept = recovered_times(positions, velocities, period)
        observations.append(
            flight_observation(f"gun_{i:03d}", times, positions[kept], environment, ball)
        )
    return [observation for observation in observations if observation is not None]


def recovered_times(
    positions: NDArray[np.float64], velocities: NDArray[np.float64], period: float
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return times (k,) s from 0 of rows, and which rows (k,) have them.

    They follow from `positions` (n, 3) m, `velocities` (n, 3) m/s and the usual period in s.
    """
    # Only horizontal motion: a bounce turns the vertical speed round between two rows.
    steps = np.diff(positions[:, :2], axis=0)
    speeds = 0.5 * (velocities[1:, :2] + velocities[:-1, :2])
    ratios = (steps * speeds).sum(axis=1) / np.maximum((speeds**2).sum(axis=1), 1e-12)
    usual = float(np.median(ratios))
    if not usual > 0.0:
        raise InvalidInputError("positions do not move along the velocities; expected a flight")
    halves = np.maximum(np.rint(2.0 * ratios / usual), 0.0)
    times = np.concatenate([[0.0], np.cumsum(halves)]) * 0.5 * period
    kept = np.concatenate([[0], 1 + np.flatnonzero(halves > 0.0)])
    return times[kept], kept


def table_at(height: float) -> Environment:
    """A level table, height in m, and nothing else."""
    return Environment([Plane("table", TABLE_MATERIAL, (0.0, 0.0, 1.0), height)])


def flight_observation(
    name: str,
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    environment: Environment,
    ball: SceneObject,
) -> Observation | None:
    """Observation of one ball above a table, or None where too little of its flight was seen.

    The `times` (n,) s and `positions` (n, 3) m are of the ball's centre; the first plane of the
    environment is the table.
    """
    above = environment.planes[0].signed_distances(positions) - ball.shape.bounding_radius
    free = rows_before_contact(above)
    # A ball below the table has flown over its edge, which the set does not contain.
    gone = np.flatnonzero(above < -CLEARANCE)
    end = int(gone[0]) if gone.size else len(times)
    if free < FEWEST_FREE_POINTS or end < FEWEST_POINTS:
        return None
    state = fit_ball_state(times[:free], positions[:free], environment, ball)
    observed = ObservedObject(ball, Trajectory(times[:end], positions[:end]), state)
    return Observation(environment, (observed,), float(times[0]), name)


def ball_in_air(radius: float, air: AirCoefficients) -> SceneObject:
    """A ball of some radius (m) in some air."""
    return SceneObject("ball", BALL_MATERIAL, Sphere(radius), air.drag, air.magnus)


def fit_ball_state(
    times: NDArray[np.float64],
    positions: NDArray[np.float64],
    environment: Environment,
    ball: SceneObject,
) -> ObjectState:
    """Fit θ_d to a free flight, positions (n, 3) m at times (n,) s, in the ball's air."""
    if ball.drag_coefficient == ball.magnus_coefficient == 0.0:
        return fit_initial_state(times, positions, environment.gravity)
    air = AirFactors.of(ball, environment.air_density, BALL_MASS)
    return fit_initial_state_in_air(times, positions, environment.gravity, air)


def rows_before_contact(above: NDArray[np.float64]) -> int:
    """Count the first rows in free flight; `above` (n,) m is the height above that of a bounce."""
    turns = np.zeros(len(above), dtype=bool)
    turns[1:-1] = (above[1:-1] < above[:-2]) & (above[1:-1] < above[2:])
    contacts = np.flatnonzero((above < CLEARANCE) | (turns & (above < TURNING_HEIGHT)))
    return int(contacts[0]) if contacts.size else len(above)


MASS_TOLERANCE = 0.02  # Relative, of a ball by the rules of the sport (2.67 to 2.77 g)


def known_ball() -> LearnedParameters:
    """Defaults, but for the ball's density, which counts in air and is given by the rules."""
    start = LearnedParameters.defaults((BALL_MATERIAL, TABLE_MATERIAL))
    names = np.array(parameter_names(start.materials))
    known_density = names == f"density[{BALL_MATERIAL}]"
    parameters = ball_parameters()
    density = parameters.density[parameters.index(BALL_MATERIAL)]
    return LearnedParameters(
        parameters,
        np.where(known_density, MASS_TOLERANCE * density, np.nan),
        known_density,
        start.version,
        start.cost,
        start.observation_count,
        start.method,
    )
