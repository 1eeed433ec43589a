"""Falls of the polynomials that tell when a sphere in flight meets an edge or corner."""

from __future__ import annotations

import numpy as np
from numba import njit

from intuitive_physics.simulation.spheres.detection import MOST_FALLS
from intuitive_physics.simulation.spheres.roots import next_fall


@njit
def falls(c, end, found):
    """Write the falls on [0, end] that as many calls find as the engine makes; return how many."""
    low = 0.0
    for k in range(found.size):
        found[k], low = next_fall(c, low, end)
        if found[k] > end:
            return k
    return found.size


def test_all_falls_are_found():
    # |w + v τ + a τ²/2|² - r² of balls thrown past a point. Its falls are the real roots at which
    # the slope is below zero; numpy finds the roots as eigenvalues. Where the distance shrinks
    # again before it is above r, that counts as a fall too: it is found besides.
    rng = np.random.default_rng(4)
    g, radius, end = np.array([0.0, -9.81]), 0.05, 1.5
    found = np.empty(MOST_FALLS)
    several = 0
    for _ in range(5000):
        w = rng.uniform(-0.5, 0.5, 2)
        top = rng.uniform(-0.1, 0.1) - w[0]
        v = np.array([top / rng.uniform(0.2, 1.0), rng.uniform(0.5, 4.5)])
        c = np.array([w @ w - radius**2, 2 * w @ v, v @ v + w @ g, v @ g, 0.25 * g @ g])
        slope = np.polynomial.Polynomial(c).deriv()
        roots = np.roots(c[::-1])
        # Double roots, where the ball grazes the point, are ill-conditioned.
        real = np.sort(roots[np.abs(roots.imag) < 1e-12].real)
        if (
            c[0] <= 1e-6
            or (np.abs(slope(roots)) < 1e-2).any()
            or np.abs(real - end).min(initial=1) < 1e-6
        ):
            continue
        expected = [t for t in real if 0 <= t <= end and slope(t) < 0]
        count = falls(tuple(c), end, found)
        several += len(expected) > 1
        for fall in expected:
            assert np.abs(found[:count] - fall).min(initial=1.0) < 1e-9
    assert several > 20
