"""A camera of few pixels, for bags that are written fast."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class SmallCamera:
    """Eight by six pixels."""

    width: int = 8
    height: int = 6
    frame_id: str = "small_optical_frame"

    def matrix(self) -> np.ndarray:
        """Return K, (3, 3) pixels."""
        return np.array([[6.0, 0.0, 3.5], [0.0, 6.0, 2.5], [0.0, 0.0, 1.0]])


SMALL = SmallCamera()
