"""Where up is, from an accelerometer that rests."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import STANDARD_GRAVITY
from intuitive_physics.validation import finite_array, finite_float

REST_TIME = 0.5
"""s that the sensor must have rested."""

MAX_AVERAGED = 1000
"""Samples that are averaged."""

MIN_SAMPLES = 10
MAX_TURN = 0.05
"""rad/s of a sensor at rest: the bias of a cheap gyroscope is below 0.02."""

MAX_CHANGE = 0.5
"""m/s² between an acceleration at rest and the mean: noise of a cheap accelerometer is 0.1."""

MAX_STRENGTH_ERROR = 0.1
"""Part by which the acceleration at rest may differ from gravity: biases are below 3 %."""


class RestingAccelerometer:
    """Averages accelerations while a sensor rests: it then feels only what holds it up."""

    def __init__(self) -> None:
        self._up: NDArray[np.float64] | None = None
        self._forget()

    @property
    def up(self) -> NDArray[np.float64] | None:
        """Unit vector (3,) against gravity; None until the sensor has rested, or while it moves."""
        return self._up

    def add(
        self, time: float, acceleration: ArrayLike, angular_velocity: ArrayLike | None = None
    ) -> None:
        """Take one sample.

        Parameters
        ----------
        time : s; an earlier time than the last one begins anew
        acceleration : (3,) m/s², what an accelerometer feels: at rest it points up
        angular_velocity : (3,) rad/s; None where there is no gyroscope

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
        if not held or np.abs(turn).max() > MAX_TURN:
            self._forget()
            return
        if time < self._newest or np.linalg.norm(felt - self._mean) > MAX_CHANGE:
            self._forget()
        self._take(time, felt)

    def _forget(self) -> None:
        self._mean = np.zeros(3)
        self._count = 0
        self._up = None
        self._since = self._newest = -np.inf

    def _take(self, time: float, felt: NDArray[np.float64]) -> None:
        if not self._count:
            self._since = time
        self._newest = time
        self._count += 1
        # The plain mean at first, then one that forgets, so that it follows a slow drift.
        self._mean += (felt - self._mean) / min(self._count, MAX_AVERAGED)
        if time - self._since >= REST_TIME and self._count >= MIN_SAMPLES:
            self._up = self._mean / np.linalg.norm(self._mean)
