"""Laws of motion that hold for every θ_s, tested on tracks.

What touches nothing is in free flight. Whatever is touched, positions are continuous. What rests
does so at one of the heights of its shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, chdtri, log_ndtr

from intuitive_physics_learner.assessment.reasons import Reason
from intuitive_physics_learner.assessment.tracks import Track

FLIGHT_POINTS = (7, 12, 24)
"""Numbers of neighbouring points to which a free flight is fitted."""

CLEARANCE = 0.02
"""Smallest gap between an object in free flight and all that it may touch, set by hand, m."""

CLEAR_NOISES = 2.0
"""Gap that a free flight keeps beyond `CLEARANCE`, in standard deviations of the noise."""

FLIGHT_ACCELERATION = 0.5
"""Standard deviation of an acceleration beyond g, m/s²: drag of a tennis ball at 5 m/s, or a
vertical that is 3 degrees off."""

AIR_ACCELERATION = 10.0
"""Standard deviation of an acceleration beyond g of an object with drag or Magnus force, which may
be as light as a balloon, m/s²."""

JUMP_DURATION = 0.15
"""Longest time between points of a jump, s."""

STEADY_P = 0.01
"""P value of the scatter of points above which these are steady."""

REST_POINTS = 24
"""Points over which an object rests."""

SIDE_GAP = 0.1
"""Gap to walls and other objects that a test of what rests asks for, m."""

HEIGHT_ERROR = 0.05
"""Error of a resting object's height, of shape and plane, m."""

HOLD_DURATION = 1.0
"""Time that a hand takes to catch and carry an object, s."""

JUMP_ENDS = ((0, 1), (-1, 1), (0, 2))
"""Pairs of points, from the one before the jump on, between which a jump shows. Each leaves out a
point that may be an outlier."""

LARGEST_BEND = 3.0
"""Distance, in g Δt², of a step Δt from what velocities one interval away make of it: gravity makes
1.5 of it over two intervals, and a ball that bounces with g Δt / 2 in each as much again."""


def flight_violation(track: Track) -> Violation | None:
    """Fit free flights to windows of points between which nothing can be touched, if there are any.

    The acceleration is gravity plus an unknown one, normal about 0. What is left must be noise. One
    point of each window does not count, the one that fits worst, so that an outlier alone violates
    nothing.
    """
    free = free_intervals(track)
    begins, ends, log_ps = [], [], []
    for count in FLIGHT_POINTS:
        if count > len(track.times):
            continue
        starts = np.flatnonzero(
            np.lib.stride_tricks.sliding_window_view(free, count - 1).all(axis=1)
        )
        if starts.size == 0:
            continue
        log_p = _log_chi2_tail(flight_losses(track, starts, count), 3 * (count - 3))
        # There are as many ways to leave out the worst point as there are points.
        log_ps.append(log_p + np.log(count))
        begins.append(track.times[starts])
        ends.append(track.times[starts + count - 1])
    if not log_ps:
        return None
    return worst_violation(
        np.concatenate(log_ps), np.concatenate(begins), np.concatenate(ends), Reason.NOT_FREE
    )


def _log_chi2_tail(values: NDArray[np.float64], freedom: int) -> NDArray[np.float64]:
    """Return what `scipy.stats.chi2.logsf` does, in a fifth of its time for some hundred values."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(chdtrc(freedom, values)))


def free_intervals(track: Track) -> NDArray[np.bool_]:
    """Return whether nothing can be touched from each point to the next, (n - 1,).

    A contact between two points takes the gap to zero and back. The speed at which it can do so is
    taken from the intervals beside, which a jump leaves as they are.
    """
    durations = np.diff(track.times)
    gaps = np.minimum(track.support_gaps, track.side_gaps)
    speeds = np.abs(_differences(gaps)) / durations
    beside = np.pad(speeds, 1, mode="edge")
    fastest = np.maximum(beside[:-2], beside[2:])
    reach = (fastest + np.linalg.norm(track.gravity) * durations) * durations
    clear = gaps - CLEARANCE - CLEAR_NOISES * track.noise
    return (clear[1:] > 0.0) & (clear[:-1] > 0.0) & (clear[1:] + clear[:-1] > reach)


def _differences(gaps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return differences (n - 1,) of gaps (n,), 0 between infinite ones."""
    finite = np.isfinite(gaps)
    distances = np.where(finite, gaps, 0.0)
    return np.where(finite[1:] & finite[:-1], np.diff(distances), 0.0)


def flight_losses(track: Track, starts: NDArray[np.int64], count: int) -> NDArray[np.float64]:
    """Least sums of squares (w,), without the worst point, of windows begun at `starts` (w,)."""
    index = starts[:, None] + np.arange(count)
    times = track.times[index]
    times = times - times.mean(axis=1, keepdims=True)
    whitening = track.whitening[index]
    places = track.positions[index] - 0.5 * track.gravity * times[..., None] ** 2
    places = places - places.mean(axis=1, keepdims=True)
    whitened = (whitening @ places[..., None])[..., 0]
    basis = np.stack([np.ones_like(times), times, 0.5 * times**2], axis=-1)
    # Products of matrices (…, 3, 3 b) of each point, and of all points of a window below another.
    design = (whitening[..., None, :] * basis[..., None, :, None]).reshape(len(starts), count, 3, 9)
    every = design.reshape(len(starts), 3 * count, 9)
    spread = AIR_ACCELERATION if track.in_air else FLIGHT_ACCELERATION
    prior = np.diag(np.repeat([0.0, 0.0, spread**-2], 3))
    inverse = np.linalg.inv(every.swapaxes(1, 2) @ every + prior)
    projected = every.swapaxes(1, 2) @ whitened.reshape(len(starts), -1, 1)
    solution = inverse @ projected
    residuals = whitened - (every @ solution).reshape(whitened.shape)
    losses = (whitened**2).sum(axis=(1, 2)) - (projected * solution).sum(axis=(1, 2))
    # Without a point, the loss is less by rᵀ (1 - H)⁻¹ r, H its own block of the hat matrix.
    left = np.eye(3) - design @ inverse[:, None] @ design.swapaxes(2, 3)
    gains = (residuals * np.linalg.solve(left, residuals[..., None])[..., 0]).sum(axis=2)
    return np.maximum(losses - gains.max(axis=1, initial=0.0), 0.0)


def jump_violation(track: Track) -> Violation | None:
    """Test whether positions are continuous: a step lies between those of the two velocities.

    An object that bounces between two points moves on with the velocity before, then with the one
    after; so the step is a mean of the two that these velocities make. The velocities are taken
    over one and over two intervals, and the smallest distance counts. What gravity and a second,
    low bounce make of a step meanwhile does not count.
    """
    count = len(track.times)
    places = np.arange(3, count - 4)
    if places.size == 0:
        return None
    duration = track.times[places + 1] - track.times[places]
    bent = LARGEST_BEND * float(np.linalg.norm(track.gravity)) * duration**2
    away = np.min([_away(track, places + a, places + b, bent) for a, b in JUMP_ENDS], axis=0)
    near = track.times[places + 2] - track.times[places - 1] <= JUMP_DURATION
    return worst_violation(
        _log_chi2_tail(away[near] ** 2, 3),
        track.times[places[near]],
        track.times[places[near] + 1],
        Reason.MISTRACKED,
    )


def _away(
    track: Track, first: NDArray[np.int64], last: NDArray[np.int64], bent: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return how far steps are from what velocities make of them, (w,) σ, less `bent` (w,) m."""
    times, positions, noise = track.times, track.positions, track.noise
    duration = (times[last] - times[first])[:, None]
    step = positions[last] - positions[first]
    smallest = np.full(len(first), np.inf)
    for before in (1, 2):
        for after in (1, 2):
            early = duration / (times[first] - times[first - before])[:, None]
            late = duration / (times[last + after] - times[last])[:, None]
            by_early = early * (positions[first] - positions[first - before])
            by_late = late * (positions[last + after] - positions[last])
            across = by_late - by_early
            length = np.maximum((across**2).sum(axis=1), np.finfo(float).tiny)
            place = np.clip(((step - by_early) * across).sum(axis=1) / length, 0.0, 1.0)
            off = np.linalg.norm(step - by_early - place[:, None] * across, axis=1)
            # The variance of a step less one velocity's, which share a point.
            ratio = np.maximum(early, late)[:, 0]
            spread = noise[first] * np.sqrt((1.0 + ratio) ** 2 + ratio**2 + 1.0)
            smallest = np.minimum(smallest, np.maximum(off - bent, 0.0) / spread)
    return smallest


def _steady(values: NDArray[np.float64], noise: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether points (w, l, d), in m, scatter by their noise (w, l) alone, (w,)."""
    off = (values - values.mean(axis=1, keepdims=True)) / noise[..., None]
    freedom = values.shape[2] * (values.shape[1] - 1)
    return np.asarray((off**2).sum(axis=(1, 2)) <= chdtri(freedom, STEADY_P))


def rest_violation(track: Track) -> Violation | None:
    """Test whether what rests, with nothing to lean on, has a height that its shape can have."""
    count = REST_POINTS
    places = np.arange(len(track.times) - count + 1)
    if len(track.times) < count or not track.gravity.any():
        return None
    index = places[:, None] + np.arange(count)
    noise = track.noise[index]
    where = _steady(track.positions[index], noise)
    where &= track.side_gaps[index].min(axis=1) > SIDE_GAP
    heights = track.heights[index].mean(axis=1)
    where &= np.isfinite(heights)
    off = np.abs(heights[:, None] - track.resting_heights).min(axis=1) - HEIGHT_ERROR
    scores = np.maximum(off, 0.0) / np.sqrt((noise**2).mean(axis=1) / count)
    begins = track.times[index[:, 0]]
    return worst_violation(
        (log_ndtr(-scores) + np.log(2.0))[where],
        (begins - HOLD_DURATION)[where],
        begins[where],
        Reason.HELD,
    )


@dataclass(frozen=True)
class Violation:
    """The worst violation of a law by a track.

    Parameters
    ----------
    log_p : logarithm of its p value among all places of the track that were tested
    time : s, at which the earliest violation as strong as its p value must be begins at the latest
    clean_until : s, the time up to which nothing is known against the track
    what : which law is violated
    """

    log_p: float
    time: float
    clean_until: float
    what: Reason


NOTABLE_LOG_P = -7.0
"""Logarithm of the p value of a place, 0.1 %, from which on a violation is taken to begin there
where the track as a whole violates the law."""


def worst_violation(
    log_ps: NDArray[np.float64],
    begins: NDArray[np.float64],
    ends: NDArray[np.float64],
    what: Reason,
) -> Violation | None:
    """Put together what a test found at w places; None where there was no place.

    `log_ps` (w,) logarithm of the p value at each; `begins` (w,) and `ends` (w,) s, between which a
    violation at each place lies.
    """
    if log_ps.size == 0:
        return None
    # Bonferroni's bound of the least of w p values.
    corrected = log_ps + np.log(log_ps.size)
    worst = float(min(corrected.min(), 0.0))
    notable = np.flatnonzero(corrected <= max(NOTABLE_LOG_P, worst))
    if notable.size == 0:
        notable = np.array([int(np.argmin(corrected))])
    first = notable[np.lexsort((-begins[notable], ends[notable]))[0]]
    return Violation(worst, float(ends[first]), float(begins[first]), what)
