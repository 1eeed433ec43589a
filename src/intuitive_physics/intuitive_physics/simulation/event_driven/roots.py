"""First times at which distances that are polynomials in time fall to zero."""

from __future__ import annotations

from math import inf, sqrt

import numpy as np
from numba import njit


@njit(cache=True)
def first_fall_quadratic(gap, speed, acceleration):
    """First τ ≥ 0 at which gap + speed τ + acceleration τ²/2 falls through zero, else infinity.

    A gap that is zero and rising has no fall at τ = 0: so a contact that was just left is not
    found again. A gap below zero that falls counts as falling now.
    """
    if acceleration < 0.0:
        under_root = speed * speed - 2.0 * acceleration * gap
        if under_root <= 0.0:
            return 0.0
        root = sqrt(under_root)
        if speed > 0.0:
            return (speed + root) / -acceleration
        return max(0.0, 2.0 * gap / (root - speed))
    if speed >= 0.0:
        return inf
    under_root = speed * speed - 2.0 * acceleration * gap
    if under_root <= 0.0:
        return inf
    return max(0.0, 2.0 * gap / (sqrt(under_root) - speed))


@njit(cache=True)
def evaluate(polynomial, degree, t):
    """Horner's rule; coefficients ascend."""
    value = polynomial[degree]
    for k in range(degree - 1, -1, -1):
        value = value * t + polynomial[k]
    return value


@njit(cache=True)
def _bracketed_root(polynomial, degree, low, high):
    """The root in [low, high], where the polynomial is monotone and changes sign.

    Newton's method, kept inside a bracket that bisection halves when Newton leaves it.
    """
    rising = evaluate(polynomial, degree, high) > 0.0
    t = 0.5 * (low + high)
    for _ in range(100):
        value = polynomial[degree]
        slope = 0.0
        for k in range(degree - 1, -1, -1):
            slope = slope * t + value
            value = value * t + polynomial[k]
        if (value > 0.0) == rising:
            high = t
        else:
            low = t
        following = t - value / slope if slope != 0.0 else low - 1.0
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * (1.0 + abs(t)):
            return following
        t = following
    return t


@njit(cache=True)
def _turning_points(polynomial, degree, end, points):
    """Write the roots of the derivative in (0, end), ascending, into `points`; return how many.

    Each degree's roots are bracketed by those of its own derivative, starting from a line.
    """
    derivative = np.empty(5)
    brackets = np.empty(6)
    count = 0
    for lowered in range(1, degree):
        # The `degree - lowered`-fold derivative of the polynomial has the degree `lowered`.
        for k in range(lowered + 1):
            factor = polynomial[k + degree - lowered]
            for j in range(degree - lowered):
                factor *= k + degree - lowered - j
            derivative[k] = factor
        brackets[0] = 0.0
        for k in range(count):
            brackets[k + 1] = points[k]
        brackets[count + 1] = end
        pieces = count + 1
        count = 0
        for k in range(pieces):
            at_low = evaluate(derivative, lowered, brackets[k])
            at_high = evaluate(derivative, lowered, brackets[k + 1])
            if (at_low < 0.0) != (at_high < 0.0):
                points[count] = _bracketed_root(derivative, lowered, brackets[k], brackets[k + 1])
                count += 1
    return count


@njit(cache=True)
def first_fall(polynomial, degree, end):
    """First τ in [0, end] at which a polynomial of degree ≤ 4 falls through zero, else infinity.

    Parameters
    ----------
    polynomial : (5,) ascending coefficients
    """
    points = np.empty(6)
    count = _turning_points(polynomial, degree, end, points)
    points[count] = end
    low = 0.0
    at_low = polynomial[0]
    for k in range(count + 1):
        high = points[k]
        at_high = evaluate(polynomial, degree, high)
        if at_high < at_low and at_high <= 0.0:
            if at_low <= 0.0:
                return low
            return _bracketed_root(polynomial, degree, low, high)
        low, at_low = high, at_high
    return inf
