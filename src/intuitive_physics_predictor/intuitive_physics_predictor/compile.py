"""Compile and load the kernels ahead of time, so that no prediction ever waits for them."""

from __future__ import annotations

import time

import numpy as np

from intuitive_physics.simulation.compile import warm_up as warm_up_simulation
from intuitive_physics.state import ObjectState
from intuitive_physics_predictor.moments import weighted_moments
from intuitive_physics_predictor.noise import StateNoise, StateSpread


def warm_up() -> None:
    """Call once all that a prediction needs."""
    warm_up_simulation()
    weighted_moments(np.zeros((2, 1, 3)), np.full(2, 0.5))
    StateSpread.of([ObjectState((0.0, 0.0, 0.0))], StateNoise()).draw(1, np.random.default_rng(0))


def main() -> None:
    """Compile every kernel into Numba's cache."""
    start = time.perf_counter()
    warm_up()
    print(f"prediction kernels ready after {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
