"""Motion of an object between two frames: gravity, support by planes and boxes, bounces.

The vector of an object is (position, velocity, radius), shape (7,), in the environment's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment, Plane
from intuitive_physics_perception.tracking.supports import (
    supported_acceleration,
    surfaces_of,
    time_on,
)

FRAME_TIME = 1.0 / 30.0
"""Time, s, between frames where a setting counts detections or is given for one frame:
at another frame rate it holds for as much time."""

MAX_BOUNCES = 4
"""Largest number of bounces within one step."""

SUPPORT_DISTANCE = 0.006
"""Gap up to which a plane supports an object, m."""

SUPPORT_SPEED = 0.25
"""Normal speed up to which an object stays on a plane, m/s: what is left of such a bounce is a hop
of millimetres."""

BOUNCE_RESTITUTION = 0.6
"""Restitution that is expected of a bounce of which nothing is known."""

NORMAL_UNCERTAINTY = 0.35
"""Standard deviation of the normal velocity after a bounce, as a part of the normal speed before
it: what another restitution could make of it."""

TANGENTIAL_UNCERTAINTY = 0.3
"""`NORMAL_UNCERTAINTY` of the tangential velocity: what friction could make of it."""

ROLLING_INERTIA = 0.4
"""Κ, moment of inertia over m r² of a ball that rolls, which gains g sin α / (1 + κ) on a slope:
2/5 of a uniform one, 2/3 of a thin shell."""

LIFT_SIGMAS = 3.0
"""Standard deviations by which noise may lift a ball that rolls on a plane."""

GATE = 25.0
"""Squared distance, in variances, from which on a detection contradicts what was predicted."""

POSITION, VELOCITY, RADIUS = slice(0, 3), slice(3, 6), 6
"""Places of position (m), velocity (m/s) and radius (m) in an object's vector."""

PLACED = np.array([0, 1, 2, RADIUS])
"""Components of an object's vector that a detection measures: centre and radius."""

SIZE = 7
"""Components of an object's vector."""


def lasting(detections: float) -> float:
    """Return how long in s an object was seen at 30 Hz with that many detections, at least.

    Half a frame less, as stamps are not quite regular.
    """
    return (detections - 1.5) * FRAME_TIME


@dataclass(frozen=True, eq=False)
class Prediction:
    """A ball some time later.

    Parameters
    ----------
    mean, covariance : (7,) and (7, 7)
    transition : (7, 7), what a small change of the state before makes of the state then
    contact : whether something was touched meanwhile
    """

    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    transition: NDArray[np.float64]
    contact: bool = False


def downward(environment: Environment) -> NDArray[np.float64]:
    """Unit vector (3,) along gravity; zeros without one."""
    strength = float(np.linalg.norm(environment.gravity))
    return environment.gravity / strength if strength > 0.0 else np.zeros(3)


def predicted(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    duration: float,
    environment: Environment,
    *,
    acceleration_noise: float,
    rolls: bool = True,
) -> Prediction:
    """Return a ball `duration` s later.

    A bounce turns the velocity with the restitution one expects and widens the covariance by what
    friction and another restitution could make of it.

    `mean` (7,) of the object; `covariance` (7, 7); `duration` in s; `acceleration_noise` in m/s²,
    standard deviation of an unmodelled acceleration over `FRAME_TIME`; `rolls`: whether it rolls
    down a slope; else it slides.
    """
    ball, left = Prediction(mean, covariance, np.eye(SIZE)), duration
    passed: list[Plane] = []
    contact = False
    for _ in range(MAX_BOUNCES):
        ball, support = _supported(ball, environment, passed)
        acceleration = supported_acceleration(
            environment.gravity, support, ROLLING_INERTIA if rolls else None
        )
        met, until = surfaces_of(environment).next_contact(
            ball.mean, acceleration, left, [*support, *passed]
        )
        ends = [time_on(plane, ball.mean, acceleration) for plane in support]
        if min(ends, default=np.inf) < until:
            # Free flight, or another support, begins at the edge.
            met, until = None, min(ends)
            passed += [plane for plane, end in zip(support, ends, strict=True) if end <= until]
        ball = _flown(ball, until, acceleration, acceleration_noise)
        contact |= bool(support) or met is not None
        left -= until
        if left <= 0.0:
            break
        if met is not None:
            ball = _bounced(ball, met.normal)
    return replace(ball, contact=contact)


def corrected(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    places: NDArray[np.intp],
    innovation: NDArray[np.float64],
    noise: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return an estimate (n,) and its covariance (n, n), given a measurement of some components.

    `mean` (n,) and `covariance` (n, n) of before; `places` (m,) of these components; `innovation`
    (m,), measured less estimated; `noise` (m, m), covariance of the measurement.
    """
    spread = covariance[np.ix_(places, places)] + noise
    gain = np.linalg.solve(spread, covariance[places]).T
    # Joseph's form keeps the covariance positive definite.
    keep = np.eye(len(mean))
    keep[:, places] -= gain
    return mean + gain @ innovation, keep @ covariance @ keep.T + gain @ noise @ gain.T


def carrying(
    mean: NDArray[np.float64], covariance: NDArray[np.float64], environment: Environment
) -> list[Plane]:
    """Return the surfaces that carry a ball as far as its place is known.

    `mean` (7,) and `covariance` (7, 7) of the ball.
    """
    radius = float(mean[RADIUS])
    widest = LIFT_SIGMAS * float(np.sqrt(np.trace(covariance[np.ix_(PLACED, PLACED)])))
    near = surfaces_of(environment).supporting(
        mean[POSITION], radius, SUPPORT_DISTANCE + min(widest, 0.5 * radius)
    )
    surfaces = []
    for plane in near:
        gap = np.append(plane.normal, -1.0)
        noise = np.sqrt(max(gap @ covariance[np.ix_(PLACED, PLACED)] @ gap, 0.0))
        lift = abs(float(plane.signed_distances(mean[POSITION])) - radius)
        if lift < SUPPORT_DISTANCE + LIFT_SIGMAS * noise:
            surfaces.append(plane)
    return surfaces


def _supported(
    ball: Prediction, environment: Environment, passed: list[Plane]
) -> tuple[Prediction, list[Plane]]:
    """Keep a ball on its planes: what is left of a bounce is a hop of millimetres."""
    mean = ball.mean.copy()
    support = [
        plane
        for plane in carrying(mean, ball.covariance, environment)
        if abs(plane.normal @ mean[VELOCITY]) < SUPPORT_SPEED and plane not in passed
    ]
    for plane in support:
        mean[VELOCITY] -= (plane.normal @ mean[VELOCITY]) * plane.normal
    return Prediction(mean, ball.covariance, ball.transition), support


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

    `duration` in s; negative for a step back; `noise`: standard deviation of the acceleration's
    mean over `FRAME_TIME`, in m/s² or rad/s².
    """
    lasts = abs(duration)
    across = 0.5 * duration * lasts
    return noise**2 * FRAME_TIME * np.array([[lasts**3 / 3.0, across], [across, lasts]])


def _bounced(ball: Prediction, normal: NDArray[np.float64]) -> Prediction:
    speed = abs(float(normal @ ball.mean[VELOCITY]))
    across = np.outer(normal, normal)
    kept = 0.0 if speed < SUPPORT_SPEED else BOUNCE_RESTITUTION
    turn = np.eye(SIZE)
    turn[VELOCITY, VELOCITY] -= (1.0 + kept) * across
    turned = turn @ ball.covariance @ turn.T
    turned[VELOCITY, VELOCITY] += (NORMAL_UNCERTAINTY * speed) ** 2 * across
    turned[VELOCITY, VELOCITY] += (TANGENTIAL_UNCERTAINTY * speed) ** 2 * (np.eye(3) - across)
    return Prediction(turn @ ball.mean, turned, turn @ ball.transition)
