"""Direction of up: from the support, from an accelerometer at rest, from free flights."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import STANDARD_GRAVITY
from intuitive_physics.validation import finite_array, finite_float
from intuitive_physics_perception.environment.planes import DetectedPlane
from intuitive_physics_perception.tracking.motion_fits import SeenPath, fitted_acceleration

MAX_ROLL = 30.0
"""Turn about the optical axis between the image's upward direction and the normal of a support at
most, degrees: people and robots hold cameras with the horizon about level."""

MAX_TILT = 65.0
"""Tilt of the camera at most, degrees: one that looks down more steeply sees a floor as one that
looks ahead sees a wall."""

UP_TOLERANCE = 20.0
"""Angle between up, as it is given or measured, and the normal of the support at most, degrees."""

MIN_WIDTH = 1.2
"""Width at least of a support that is not the largest plane, m: the side of a box is narrower."""

FROM_LEVEL = 10.0
"""Angle by which it may be off a right angle to the largest plane, which is a wall then,
degrees."""

FLIGHT_TIME = 0.25
"""Duration of a part of a flight from which gravity is measured, s: with 2 mm of noise at 30 Hz the
acceleration is then known to 0.5 m/s², 3 degrees."""

FLIGHT_MISFIT = 2.0
"""Mean square of what a constant acceleration leaves of it, in variances, at most: 18 coordinates
less 9 unknowns exceed it once in 30 times."""

GRAVITY_ERROR = 0.03
"""Part by which drag and spin may change the acceleration of a flight."""

FLIGHTS = 2
"""Parts of flights that must agree before they count."""

MIN_TURN = 3.0
"""Angle between gravity as measured on flights and as modelled from which on the environment is
modelled again, where it is known to a third of that, degrees: drag of 3 % turns an acceleration by
up to 1.7 degrees."""

REST_TIME = 0.5
"""Time that the sensor must have rested, s."""

AVERAGED_SAMPLES = 1000
"""Largest number of samples that are averaged."""

MIN_SAMPLES = 10
"""Smallest number of samples that are averaged."""

MAX_ANGULAR_VELOCITY = 0.05
"""Angular velocity of a sensor at rest at most, rad/s: the bias of a cheap gyroscope is below
0.02."""

MAX_CHANGE = 0.5
"""Difference of an acceleration at rest from the mean at most, m/s²: the noise of a cheap
accelerometer is 0.1."""

MAX_STRENGTH_ERROR = 0.1
"""Part by which the acceleration at rest may differ from gravity: biases are below 3 %."""

IMAGE_UP = (0.0, -1.0, 0.0)
"""The image's upward direction in a camera's optical frame (REP 103)."""

KEPT_PARTS = 30
"""Newest parts of flights that are compared, each with each: where they never agree (a magnet, a
fan), a day of throws must not make every episode slower than the one before."""


@dataclass(frozen=True, eq=False)
class Upward:
    """Up in the sensor's frame, and the plane that supports objects.

    Parameters
    ----------
    up : (3,) unit vector against gravity
    planes : the support first, where there is one
    has_support : whether the first plane supports objects
    doubt : one sentence on why gravity may be elsewhere; empty where nothing speaks for that
    """

    up: NDArray[np.float64]
    planes: tuple[DetectedPlane, ...]
    has_support: bool
    doubt: str = ""


def facing(
    planes: Sequence[DetectedPlane], up: NDArray[np.float64]
) -> tuple[DetectedPlane, ...] | None:
    """Return planes, first the largest that faces up; None where none does.

    `up` (3,) unit vector in the sensor's frame.
    """
    for plane in planes:
        if plane.normal @ up >= np.cos(np.radians(UP_TOLERANCE)):
            return _with_first(planes, plane)
    return None


def upright(planes: Sequence[DetectedPlane]) -> Upward:
    """Return what supports objects before a camera that is held about upright.

    The largest plane, unless it faces sideways in the image, as a wall does, and another one faces
    up that stands square on it and is as wide as a floor or table: then the largest of these.
    """
    if not planes:
        return Upward(
            np.array(IMAGE_UP),
            (),
            False,
            "no plane was found: gravity is taken to point down in the image; turn the sensor to a "
            "floor or table, give up_hint, use an IMU, or throw something",
        )
    largest = planes[0]
    if _is_upright(largest):
        return Upward(largest.normal, tuple(planes), True)
    for plane in planes:
        level = abs(plane.normal @ largest.normal) <= np.sin(np.radians(FROM_LEVEL))
        if level and _is_upright(plane) and plane.width >= MIN_WIDTH:
            return Upward(plane.normal, _with_first(planes, plane), True)
    angle = degrees_between(largest.normal, np.array(IMAGE_UP))
    return Upward(
        largest.normal,
        tuple(planes),
        True,
        f"the largest plane is taken for the support and faces {angle:.0f}° away from the image's "
        "upward direction: if it is a wall, give up_hint, use an IMU, or throw something",
    )


def _is_upright(plane: DetectedPlane) -> bool:
    x, y, z = plane.normal
    roll = np.degrees(np.arctan2(abs(x), -y))
    tilt = np.degrees(np.arctan2(abs(z), np.hypot(x, y)))
    return bool(roll <= MAX_ROLL and tilt <= MAX_TILT)


def _with_first(planes: Sequence[DetectedPlane], first: DetectedPlane) -> tuple[DetectedPlane, ...]:
    return (first, *(plane for plane in planes if plane is not first))


class FlightGravity:
    """Takes the direction of gravity from what falls freely, whatever was assumed of it.

    In flight the acceleration is constant and as strong as gravity. No other motion is, for as long
    as a part of a flight lasts, but by chance: what rolls or is held does not fall, and a hand does
    not accelerate that evenly. Parts must agree on the direction before it counts.

    `strength` in m/s², of gravity.
    """

    def __init__(self, strength: float) -> None:
        self._strength = strength
        self._found = deque[tuple[NDArray[np.float64], NDArray[np.float64]]](maxlen=KEPT_PARTS)

    def up(self) -> tuple[NDArray[np.float64], float] | None:
        """Return the unit vector (3,) against gravity in the flights' frame, and its standard
        deviation in degrees; None while too few agree."""
        best: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
        for mean, spread in self._found:
            agreeing = [
                (other, other_spread)
                for other, other_spread in self._found
                if degrees_between(mean, other)
                < MIN_TURN + 3.0 * self._degrees(spread + other_spread)
            ]
            best = max(best, agreeing, key=len)
        # Most of what seemed to fly must agree, too.
        if len(best) < max(FLIGHTS, 0.5 * len(self._found) + 0.5):
            return None
        weights = [np.linalg.inv(spread) for _, spread in best]
        covariance = np.linalg.inv(np.sum(weights, axis=0))
        total = np.sum([w @ mean for w, (mean, _) in zip(weights, best, strict=True)], axis=0)
        gravity = covariance @ total
        return -gravity / np.linalg.norm(gravity), self._degrees(covariance)

    def _degrees(self, covariance: NDArray[np.float64]) -> float:
        """Standard deviation of the direction of an acceleration with a covariance (3, 3)."""
        return float(np.degrees(_deviation(covariance) / self._strength))

    def take(self, path: SeenPath) -> None:
        """Look for parts of a motion that are flights."""
        times, first = path.times, 0
        while first < len(times):
            last = int(np.searchsorted(times, times[first] + FLIGHT_TIME))
            if last >= len(times):
                return
            flight = self._acceleration(path[first : last + 1])
            if flight is not None:
                self._found.append(flight)
            first = last if flight is not None else first + 1

    def _acceleration(
        self, path: SeenPath
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Acceleration (3,), with covariance, of a part that is a flight; else None."""
        n = len(path.times)
        if n < 5:
            return None
        mean, spread, chi2 = fitted_acceleration(path)
        misfit = chi2 / (3 * n - 9)
        covariance = spread * max(misfit, 1.0)
        error = GRAVITY_ERROR * self._strength + 3.0 * _deviation(covariance)
        off = abs(float(np.linalg.norm(mean)) - self._strength)
        falls = off < error < 0.5 * self._strength and misfit < FLIGHT_MISFIT
        return (mean, covariance) if falls else None


def degrees_between(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    """Return the angle between two vectors, `first` (3,) and `second` (3,), degrees."""
    cosine = first @ second / (np.linalg.norm(first) * np.linalg.norm(second))
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _deviation(covariance: NDArray[np.float64]) -> float:
    """Largest standard deviation in any direction."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))


class RestingAccelerometer:
    """Averages accelerations while a sensor rests: it then feels only what holds it up.

    Attributes
    ----------
    up : (3,) unit vector against gravity; None until the sensor has rested, or while it moves
    """

    def __init__(self) -> None:
        self.up: NDArray[np.float64] | None = None
        self._forget()

    def add(
        self, time: float, acceleration: ArrayLike, angular_velocity: ArrayLike | None = None
    ) -> None:
        """Take one sample.

        `time` in s; an earlier time than the last one starts again; `acceleration` (3,) m/s², what
        an accelerometer feels: at rest it points up; `angular_velocity` (3,) rad/s; None where
        there is no gyroscope.

        Raises
        ------
        InvalidInputError
            When a number is not finite, or the acceleration is not in m/s².
        """
        time = finite_float(time, "time of the IMU")
        felt = finite_array(acceleration, "acceleration of the IMU", (3,))
        turn = np.zeros(3)
        if angular_velocity is not None:
            turn = finite_array(angular_velocity, "angular velocity of the IMU", (3,))
        standard, strength = abs(STANDARD_GRAVITY[2]), float(np.abs(felt).max())
        if strength < 0.1 * standard:
            self._forget()
            raise InvalidInputError(
                f"acceleration of the IMU is at most {strength:.2f} m/s² along any axis; expected "
                "9.81 with gravity in it (REP 145): is it in g, or was gravity taken out?"
            )
        held = strength < 2.0 * standard and (
            abs(float(np.linalg.norm(felt)) - standard) < MAX_STRENGTH_ERROR * standard
        )
        if not held or np.abs(turn).max() > MAX_ANGULAR_VELOCITY:
            self._forget()
            return
        if time < self._newest or np.linalg.norm(felt - self._mean) > MAX_CHANGE:
            self._forget()
        self._take(time, felt)

    def _forget(self) -> None:
        self._mean = np.zeros(3)
        self._count = 0
        self.up = None
        self._since = self._newest = -np.inf

    def _take(self, time: float, felt: NDArray[np.float64]) -> None:
        if not self._count:
            self._since = time
        self._newest = time
        self._count += 1
        # The plain mean at first, then one that forgets, so that it follows a slow drift.
        self._mean += (felt - self._mean) / min(self._count, AVERAGED_SAMPLES)
        if time - self._since >= REST_TIME and self._count >= MIN_SAMPLES:
            self.up = self._mean / np.linalg.norm(self._mean)
