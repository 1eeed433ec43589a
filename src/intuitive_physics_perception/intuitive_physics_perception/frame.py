"""One frame of one sensor, as all stages take it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform


@dataclass(frozen=True, eq=False)
class Scan:
    """When the readings of a cloud were taken that is no image.

    Parameters
    ----------
    offsets : (n,) s, of each reading after the time of the frame
    duration : s, from the first one to the last
    """

    offsets: NDArray[np.float32]
    duration: float


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame of one sensor.

    Parameters
    ----------
    time : s, of its first reading
    points : (height, width, 3) m in the sensor's frame, NaN where nothing was read
    colors : (height, width, 3) red, green and blue of the points; None where they are not known
    pose : of the sensor, in a frame that stands still; None where it is not known to move
    camera : name of a further camera, empty for the first
    offsets : (height, width) s, time of each reading after `time`; None: all are of that time
    duration : s, from the first reading to the last
    """

    time: float
    points: NDArray[np.float32]
    colors: NDArray[np.uint8] | None = None
    pose: RigidTransform | None = None
    camera: str = ""
    offsets: NDArray[np.float32] | None = None
    duration: float = 0.0

    @cached_property
    def scan(self) -> Scan | None:
        """Times of the readings; None where they are an image, or all of one time."""
        if self.offsets is None or self.duration == 0.0 or self.points.shape[0] > 1:
            return None
        return Scan(self.offsets.ravel(), self.duration)

    def delay_of(self, readings: NDArray[np.int64]) -> float:
        """Return the mean time, s, after that of the frame, of some readings.

        `readings` (n,) indices of points.
        """
        if self.offsets is None:
            return 0.0
        return float(self.offsets.reshape(-1)[readings].mean())

    def delay_towards(self, place: NDArray[np.float64]) -> float:
        """Return the time, s, after that of the frame, of the reading that lies nearest to the
        direction of a place (3,) m in the sensor's frame."""
        if self.offsets is None:
            return 0.0
        return float(self.offsets.flat[np.argmax(self._directions @ place.astype(np.float32))])

    @cached_property
    def _directions(self) -> NDArray[np.float32]:
        """Unit vectors (height, width, 3) to the readings, zero where nothing was read."""
        ranges = np.linalg.norm(self.points, axis=2, keepdims=True)
        return np.nan_to_num(self.points / ranges)
