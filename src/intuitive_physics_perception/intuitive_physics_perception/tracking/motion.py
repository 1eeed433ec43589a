"""Motion of an object between two frames: gravity, support by planes, bounces.

The vector of an object is (position, velocity, radius), shape (7,), in the environment's frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment, Plane
from intuitive_physics_perception.tracking.settings import FRAME_TIME, MotionSettings

POSITION, VELOCITY, RADIUS = slice(0, 3), slice(3, 6), 6
"""Where position (m), velocity (m/s) and radius (m) stand in an object's vector."""

SIZE = 7
"""Components of an object's vector."""


@dataclass(frozen=True, eq=False)
class Prediction:
    """A ball some time later.

    Parameters
    ----------
    mean, covariance : (7,) and (7, 7)
    transition : (7, 7), what a small change of the state before makes of the state then
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    transition: NDArray[np.float64]


def supporting_planes(
    environment: Environment, position: NDArray[np.float64], radius: float, tolerance: float
) -> list[Plane]:
    """Planes a ball at `position` (3,) touches within `tolerance` m and gravity presses it on."""
    return [
        plane
        for plane in environment.planes
        if abs(plane.signed_distances(position) - radius) < tolerance
        and plane.normal @ environment.gravity < 0.0
        and plane.covers(position)
    ]


def downward(environment: Environment) -> NDArray[np.float64]:
    """Unit vector (3,) along gravity; zeros without one."""
    strength = float(np.linalg.norm(environment.gravity))
    return environment.gravity / strength if strength > 0.0 else np.zeros(3)


def supported_acceleration(environment: Environment, planes: list[Plane]) -> NDArray[np.float64]:
    """Acceleration (3,) in m/s² of a ball that slides freely on planes, or flies if there are
    none."""
    acceleration = environment.gravity.copy()
    for plane in planes:
        acceleration -= min(float(acceleration @ plane.normal), 0.0) * plane.normal
    return acceleration


def predicted(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    duration: float,
    environment: Environment,
    *,
    restitution: float,
    acceleration_noise: float,
    motion: MotionSettings,
) -> Prediction:
    """Return a ball `duration` s later.

    A bounce turns the velocity with the restitution one expects and widens the covariance by what
    friction and another restitution could make of it.

    Parameters
    ----------
    mean : (7,) of the object
    covariance : (7, 7)
    duration : s
    environment : what the object bounces off
    restitution : expected of a bounce
    acceleration_noise : m/s², standard deviation of an unmodelled acceleration over `FRAME_TIME`
    motion : tuned numbers
    """
    ball, left = Prediction(mean, covariance, np.eye(SIZE)), duration
    for _ in range(motion.max_bounces):
        ball, support = _supported(ball, environment, motion)
        acceleration = supported_acceleration(environment, support)
        met, until = _next_contact(ball.mean, acceleration, left, environment, support)
        ball = _flown(ball, until, acceleration, acceleration_noise)
        left -= until
        if met is None:
            break
        ball = _bounced(ball, met.normal, restitution, motion)
    return ball


def _supported(
    ball: Prediction, environment: Environment, motion: MotionSettings
) -> tuple[Prediction, list[Plane]]:
    """What is left of a bounce is a hop of millimetres: it stays on the plane."""
    mean = ball.mean.copy()
    touched = supporting_planes(environment, mean[POSITION], mean[RADIUS], motion.support_distance)
    support = [
        plane for plane in touched if abs(plane.normal @ mean[VELOCITY]) < motion.support_speed
    ]
    for plane in support:
        mean[VELOCITY] -= (plane.normal @ mean[VELOCITY]) * plane.normal
    return Prediction(mean, ball.covariance, ball.transition), support


def _next_contact(
    mean: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    duration: float,
    environment: Environment,
    support: list[Plane],
) -> tuple[Plane | None, float]:
    """First plane met within `duration` s and when; (None, duration) when there is none."""
    first, until = None, duration
    for plane in environment.planes:
        if plane in support:
            continue
        gap = float(plane.signed_distances(mean[POSITION]) - mean[RADIUS])
        if plane.boundary is not None and gap < -2.0 * mean[RADIUS]:
            # It is wholly behind: below a table, or beyond the front of a box.
            continue
        speed = float(plane.normal @ mean[VELOCITY])
        pull = float(plane.normal @ acceleration)
        time = _falls_to_zero(gap, speed, pull)
        if time < until and plane.covers(_place_at(time, mean, acceleration)):
            first, until = plane, time
    return first, until


def _place_at(
    time: float, mean: NDArray[np.float64], acceleration: NDArray[np.float64]
) -> NDArray[np.float64]:
    return mean[POSITION] + time * (mean[VELOCITY] + 0.5 * time * acceleration)


def _falls_to_zero(gap: float, speed: float, pull: float) -> float:
    """First time ≥ 0 at which gap + speed t + pull t² / 2 gets to zero from above; inf if never."""
    if gap <= 0.0:
        return 0.0 if speed < 0.0 else np.inf
    if abs(pull) < 1e-9:
        return -gap / speed if speed < 0.0 else np.inf
    root = speed * speed - 2.0 * pull * gap
    if root < 0.0 or (pull > 0.0 and speed >= 0.0):
        return np.inf
    return (-speed - sqrt(root)) / pull


def _flown(
    ball: Prediction, duration: float, acceleration: NDArray[np.float64], noise: float
) -> Prediction:
    transition = np.eye(SIZE)
    transition[POSITION, VELOCITY] = duration * np.eye(3)
    moved = transition @ ball.mean
    moved[POSITION] += 0.5 * duration**2 * acceleration
    moved[VELOCITY] += duration * acceleration
    covariance = transition @ ball.covariance @ transition.T
    covariance[:6, :6] += np.kron(white_acceleration(duration, noise), np.eye(3))
    return Prediction(moved, covariance, transition @ ball.transition)


def white_acceleration(duration: float, noise: float) -> NDArray[np.float64]:
    """Return the covariance (2, 2) that an unknown acceleration gives to place and speed.

    It is white noise, so two steps add up to one of their length.

    Parameters
    ----------
    duration : s; negative for a step back
    noise : standard deviation of the acceleration's mean over `FRAME_TIME`, in m/s² or rad/s²
    """
    lasts = abs(duration)
    across = 0.5 * duration * lasts
    return noise**2 * FRAME_TIME * np.array([[lasts**3 / 3.0, across], [across, lasts]])


def _bounced(
    ball: Prediction, normal: NDArray[np.float64], restitution: float, motion: MotionSettings
) -> Prediction:
    speed = abs(float(normal @ ball.mean[VELOCITY]))
    across = np.outer(normal, normal)
    kept = 0.0 if speed < motion.support_speed else restitution
    turn = np.eye(SIZE)
    turn[VELOCITY, VELOCITY] -= (1.0 + kept) * across
    turned = turn @ ball.covariance @ turn.T
    turned[VELOCITY, VELOCITY] += (motion.normal_uncertainty * speed) ** 2 * across
    turned[VELOCITY, VELOCITY] += (motion.tangential_uncertainty * speed) ** 2 * (
        np.eye(3) - across
    )
    return Prediction(turn @ ball.mean, turned, turn @ ball.transition)
