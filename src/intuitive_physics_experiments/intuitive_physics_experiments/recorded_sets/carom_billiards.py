"""Shots of a carom match, tracked by a camera above the table, as observations of three balls.

The first row of a shot is from before the cue hits its ball, so observations start at the second
one. Nobody saw how the balls spin: they are taken to slide at first. What this gets wrong grows
with every impact, so observations end after `DURATION`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.observation import Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.shapes import Sphere
from intuitive_physics.state import LINEAR_VELOCITY, POSITION, ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics.validation import finite_array, positive_float
from intuitive_physics_experiments.flight_fits import fit_initial_state
from intuitive_physics_recordings.npz_file import Arrays

# Names of the materials.
BALL_MATERIAL, CLOTH_MATERIAL, CUSHION_MATERIAL = "ball", "cloth", "cushion"

DURATION = 1.0  # s of a shot that is observed

# Rows whose velocity counts as that of the first: at 20 ms a row it falls by 2 % in them.
MOST_FREE_ROWS = 6

STILL = 0.002  # m; a ball that stays so near its first place rests
FEWEST_ROWS = 10  # Rows of the shortest motion that becomes an observation


def carom_observations(arrays: Arrays) -> list[Observation]:
    """Observations of the shots, each with all balls, on the table z = 0 between four cushions.

    The arrays are `shot_ball_t_x_y` (n, 5) shot, ball, s, m, m; `ball_radius` m; `table` (2,) m,
    its size along x and y.
    """
    radius = positive_float(arrays["ball_radius"], "ball_radius")
    size = finite_array(arrays["table"], "table", (2,))
    if (size <= 4.0 * radius).any():
        raise InvalidInputError(
            f"table measures {size.tolist()} m; expected room for balls of {radius:g} m radius"
        )
    rows = finite_array(arrays["shot_ball_t_x_y"], "shot_ball_t_x_y", (None, 5))
    environment = _table(size)
    observations = []
    for shot in np.unique(rows[:, 0]):
        times, paths = _paths(rows[rows[:, 0] == shot], f"shot {shot:g}")
        # Tracking puts a ball at a cushion a hair into it.
        within = np.clip(paths, radius, size - radius)
        observations.append(_observation(f"shot_{shot:03.0f}", times, within, environment, radius))
    return [observation for observation in observations if observation is not None]


def _table(size: NDArray[np.float64]) -> Environment:
    width, length = size.tolist()
    return Environment(
        [
            Plane("cloth", CLOTH_MATERIAL, (0.0, 0.0, 1.0), 0.0),
            Plane("left cushion", CUSHION_MATERIAL, (1.0, 0.0, 0.0), 0.0),
            Plane("right cushion", CUSHION_MATERIAL, (-1.0, 0.0, 0.0), -width),
            Plane("near cushion", CUSHION_MATERIAL, (0.0, 1.0, 0.0), 0.0),
            Plane("far cushion", CUSHION_MATERIAL, (0.0, -1.0, 0.0), -length),
        ]
    )


def _paths(rows: NDArray[np.float64], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times (n,) and positions (balls, n, 2) of one shot."""
    balls = [rows[rows[:, 1] == ball] for ball in np.unique(rows[:, 1])]
    if any(not np.array_equal(ball[:, 2], balls[0][:, 2]) for ball in balls):
        raise InvalidInputError(f"balls of {name} were seen at different times; expected the same")
    return balls[0][:, 2], np.stack([ball[:, 3:] for ball in balls])


def _observation(
    name: str,
    times: NDArray[np.float64],
    paths: NDArray[np.float64],
    environment: Environment,
    radius: float,
) -> Observation | None:
    within = (times > times[0]) & (times <= times[0] + DURATION)
    times, paths = times[within], paths[:, within]
    if times.size < FEWEST_ROWS:
        return None
    free = _rows_before_contact(paths, environment, radius)
    if free < 2:
        return None
    balls = []
    for ball, path in enumerate(paths):
        places = np.column_stack([path, np.full(len(path), radius)])
        scene_object = SceneObject(f"ball {ball}", BALL_MATERIAL, Sphere(radius))
        state = _initial_state(times[:free], places[:free])
        balls.append(ObservedObject(scene_object, Trajectory(times, places), state))
    return Observation(environment, tuple(balls), float(times[0]), name)


def _rows_before_contact(
    paths: NDArray[np.float64], environment: Environment, radius: float
) -> int:
    """Number of first rows in which the moving ball touches nothing."""
    moved = np.linalg.norm(paths - paths[:, :1], axis=-1) > STILL
    first_moves = np.where(moved.any(axis=1), moved.argmax(axis=1), moved.shape[1])
    cue = int(np.argmin(first_moves))
    others = np.delete(moved, cue, axis=0).any(axis=0)
    place = np.column_stack([paths[cue], np.full(paths.shape[1], radius)])
    gaps = [plane.signed_distances(place) - radius for plane in environment.planes[1:]]
    touches = others | (np.min(gaps, axis=0) < STILL)
    first = int(np.argmax(touches)) if touches.any() else touches.size
    return min(first, MOST_FREE_ROWS)


def _initial_state(times: NDArray[np.float64], places: NDArray[np.float64]) -> ObjectState:
    if np.linalg.norm(places - places[0], axis=1).max() < STILL:
        return ObjectState(places[0])
    fitted = fit_initial_state(times, places, np.zeros(3))
    position, velocity = fitted.position.copy(), fitted.linear_velocity.copy()
    position[2], velocity[2] = places[0, 2], 0.0
    covariance = fitted.covariance.copy()
    for part in (POSITION, LINEAR_VELOCITY):
        covariance[part.start + 2, :] = covariance[:, part.start + 2] = 0.0
    return ObjectState(position, linear_velocity=velocity, covariance=covariance)
