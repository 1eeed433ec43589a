"""Where up is, from an accelerometer that rests."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.scene import STANDARD_GRAVITY
from intuitive_physics.validation import finite_array, finite_float
from intuitive_physics_perception.environment.settings import RestSettings


class RestingAccelerometer:
    """Averages accelerations while a sensor rests: it then feels only what holds it up."""

    def __init__(self, settings: RestSettings) -> None:
        self._settings = settings
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
        time : s; an earlier time than the last one starts again
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
        settings = self._settings
        held = strength < 2.0 * standard and (
            abs(float(np.linalg.norm(felt)) - standard) < settings.max_strength_error * standard
        )
        if not held or np.abs(turn).max() > settings.max_angular_velocity:
            self._forget()
            return
        if time < self._newest or np.linalg.norm(felt - self._mean) > settings.max_change:
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
        settings = self._settings
        self._newest = time
        self._count += 1
        # The plain mean at first, then one that forgets, so that it follows a slow drift.
        self._mean += (felt - self._mean) / min(self._count, settings.averaged_samples)
        if time - self._since >= settings.rest_time and self._count >= settings.min_samples:
            self._up = self._mean / np.linalg.norm(self._mean)
