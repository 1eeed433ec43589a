"""First times at which distances that are polynomials in time fall to zero."""

from __future__ import annotations

from math import inf, sqrt

from intuitive_physics.kernels import entry, inlined, kernel

MOST_ITERATIONS = 100
"""Iterations for a bracketed root; bisection alone needs about 60."""


@entry
def first_fall_quadratic(gap, speed, acceleration):
    """First τ ≥ 0 at which gap + speed τ + acceleration τ²/2 falls through zero, else infinity.

    A gap that is zero and rising has no fall at τ = 0: so a contact that was just left is not
    found again. A gap below zero that falls counts as falling now.
    """
    if acceleration >= 0.0 and speed >= 0.0:
        return inf
    under_root = speed * speed - 2.0 * acceleration * gap
    if acceleration < 0.0:
        if under_root <= 0.0:
            return 0.0
        root = sqrt(under_root)
        if speed > 0.0:
            return (speed + root) / -acceleration
        return max(0.0, 2.0 * gap / (root - speed))
    if under_root <= 0.0:
        return inf
    return max(0.0, 2.0 * gap / (sqrt(under_root) - speed))


@inlined
def evaluate(c, t):
    """Value of the polynomial of degree 4 with ascending coefficients c."""
    return c[0] + t * (c[1] + t * (c[2] + t * (c[3] + t * c[4])))


@inlined
def slope(c, t):
    """Its derivative."""
    return c[1] + t * (2.0 * c[2] + t * (3.0 * c[3] + t * 4.0 * c[4]))


@kernel
def next_fall(c, low, end):
    """First fall through zero of a polynomial of degree 4, from τ = `low` to `end`.

    Returns τ of the fall, else infinity, and up to where it falls on: from there further falls are
    to be sought. Where the polynomial is below zero and falls already, τ is from where it falls.
    """
    first, second = _inflections(c, low, end)
    at_low, slope_low = evaluate(c, low), slope(c, low)
    if low > 0.0 and at_low <= 0.0:
        # The last fall ended here, at a turning point: a slope below zero is rounding.
        slope_low = max(slope_low, 0.0)
    for piece in range(3):
        high = first if piece == 0 else second if piece == 1 else end
        if high <= low:
            continue
        # Between inflections the slope is monotone: one turning point at most.
        slope_high = slope(c, high)
        turn = high if slope_low < 0.0 else low
        if (slope_low < 0.0) != (slope_high < 0.0):
            derivative = (c[1], 2.0 * c[2], 3.0 * c[3], 4.0 * c[4], 0.0)
            turn = _bracketed_root(derivative, low, high)
        at_high = evaluate(c, high)
        if slope_low < 0.0:
            at_turn = evaluate(c, turn)
            if at_turn <= 0.0:
                return (low if at_low <= 0.0 else _bracketed_root(c, low, turn)), turn
        elif slope_high < 0.0 and at_high <= 0.0:
            at_turn = evaluate(c, turn)
            return (turn if at_turn <= 0.0 else _bracketed_root(c, turn, high)), high
        low, at_low, slope_low = high, at_high, slope_high
    return inf, end


@kernel
def _inflections(c, low, end):
    """Roots of the second derivative, ascending, moved into [low, end]."""
    half = 3.0 * c[3]
    under_root = half * half - 24.0 * c[4] * c[2]
    if under_root <= 0.0:
        return low, low
    # Of the two ways to write a root of a quadratic, for each the one that cancels nothing.
    sum_of_both = -half - sqrt(under_root) if half > 0.0 else sqrt(under_root) - half
    one = sum_of_both / (12.0 * c[4]) if c[4] != 0.0 else inf
    other = 2.0 * c[2] / sum_of_both if sum_of_both != 0.0 else inf
    one = min(max(one, low), end)
    other = min(max(other, low), end)
    return min(one, other), max(one, other)


@kernel
def _bracketed_root(c, low, high):
    """The root in [low, high], where the polynomial is monotone and changes sign.

    Newton's method, kept inside a bracket that bisection halves when Newton leaves it.
    """
    rising = evaluate(c, high) > evaluate(c, low)
    t = 0.5 * (low + high)
    for _ in range(MOST_ITERATIONS):
        value, gradient = evaluate(c, t), slope(c, t)
        if (value > 0.0) == rising:
            high = t
        else:
            low = t
        following = t - value / gradient if gradient != 0.0 else low - 1.0
        if not low <= following <= high:
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * (1.0 + abs(t)):
            return following
        t = following
    return t
