"""A flag that ends simulations while they run."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.errors import SimulationStoppedError


class StopFlag:
    """Set once, from any thread; simulators that were given it then end within some ms.

    Attributes
    ----------
    number : (1,) 0, and 1 once the flag is set, which compiled code reads
    """

    def __init__(self) -> None:
        self.number: NDArray[np.int64] = np.zeros(1, dtype=np.int64)

    def set(self) -> None:
        """End the simulations that have this flag, and all later ones."""
        self.number[0] = 1

    def check(self) -> None:
        """Raise `SimulationStoppedError` once it was set."""
        if self.is_set():
            raise SimulationStoppedError

    def is_set(self) -> bool:
        """Whether it was set."""
        return bool(self.number[0])
