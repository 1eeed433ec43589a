"""Laws of motion that hold for every θ_s, tested on tracks.

What touches nothing is in free flight. Whatever is touched, positions are continuous. In steady
contact with its support an object neither leaves it nor changes its velocity at once: friction is
bounded. What rests does so at one of the heights of its shape.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2, norm

from intuitive_physics_learner.assessment.settings import AssessmentSettings
from intuitive_physics_learner.assessment.tracks import Track
from intuitive_physics_learner.assessment.violation import Violation, violations_of

JUMP_ENDS = ((0, 1), (-1, 1), (0, 2))
"""Pairs of points, from the one before the jump on, between which a jump shows. Each leaves out a
point that may be an outlier."""


LARGEST_BEND = 3.0
"""Distance, in g Δt², of a step Δt from what velocities one interval away make of it: gravity makes
1.5 of it over two intervals, and a ball that bounces with g Δt / 2 in each as much again."""

OUTLIER_LENGTH = 6.4
"""Distance in σ of a point from the mean of its neighbours from which on it is an outlier: noise
has √1.5 σ on each axis, and exceeds this length with the probability of 4e-6."""


def flight_violation(track: Track, settings: AssessmentSettings) -> Violation | None:
    """Fit free flights to windows of points between which nothing can be touched.

    The acceleration is gravity plus an unknown one, normal about 0. What is left must be noise, and
    an impulse in the middle must not explain more of it than of noise. One point of each window
    does not count, the one that fits worst, so that an outlier alone violates nothing.

    Returns None where there is no such window.
    """
    free = free_intervals(track, settings)
    begins, ends, log_ps = [], [], []
    for count in settings.flight_points:
        if count > len(track.times):
            continue
        starts = np.flatnonzero(
            np.lib.stride_tricks.sliding_window_view(free, count - 1).all(axis=1)
        )
        if starts.size == 0:
            continue
        losses = flight_losses(track, starts, count, settings)
        log_p = chi2.logsf(losses, 3 * (count - 3))
        if count >= settings.impulse_points:
            gains = losses - flight_losses(track, starts, count, settings, impulse=True)
            log_p = np.minimum(log_p, chi2.logsf(gains, 3))
        # Two tests, and as many ways to leave out the worst point as there are points.
        log_ps.append(log_p + np.log(2.0 * count))
        begins.append(track.times[starts])
        ends.append(track.times[starts + count - 1])
    if not log_ps:
        return None
    return violations_of(
        np.concatenate(log_ps), np.concatenate(begins), np.concatenate(ends), "not in free flight"
    )


def free_intervals(track: Track, settings: AssessmentSettings) -> NDArray[np.bool_]:
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
    clear = gaps - settings.clearance - settings.clear_noises * track.noise
    return (clear[1:] > 0.0) & (clear[:-1] > 0.0) & (clear[1:] + clear[:-1] > reach)


def _differences(gaps: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return differences (n - 1,) of gaps (n,), 0 between infinite ones."""
    finite = np.isfinite(gaps)
    known = np.where(finite, gaps, 0.0)
    return np.where(finite[1:] & finite[:-1], np.diff(known), 0.0)


def flight_losses(
    track: Track,
    starts: NDArray[np.int64],
    count: int,
    settings: AssessmentSettings,
    *,
    impulse: bool = False,
) -> NDArray[np.float64]:
    """Return the least sums of squares (w,), without a unit, that remain without the worst point.

    `starts` (w,) index of the first point of each window.
    """
    index = starts[:, None] + np.arange(count)
    times = track.times[index]
    times = times - times.mean(axis=1, keepdims=True)
    whitening = track.whitening[index]
    places = track.positions[index] - 0.5 * track.gravity * times[..., None] ** 2
    places = places - places.mean(axis=1, keepdims=True)
    seen = np.einsum("wlij,wlj->wli", whitening, places)
    columns = [np.ones_like(times), times, 0.5 * times**2]
    if impulse:
        columns.append(np.abs(times))
    basis = np.stack(columns, axis=-1)
    design = np.einsum("wlij,wlb->wlibj", whitening, basis).reshape(
        len(starts), count, 3, 3 * len(columns)
    )
    spread = settings.air_acceleration if track.in_air else settings.flight_acceleration
    prior = np.diag(np.repeat([0.0, 0.0, spread**-2, 0.0][: len(columns)], 3))
    inverse = np.linalg.inv(np.einsum("wlip,wliq->wpq", design, design) + prior)
    projected = np.einsum("wlip,wli->wp", design, seen)
    found = np.einsum("wpq,wq->wp", inverse, projected)
    residuals = seen - np.einsum("wlip,wp->wli", design, found)
    losses = (seen**2).sum(axis=(1, 2)) - (projected * found).sum(axis=1)
    # Without a point, the loss is less by rᵀ (1 - H)⁻¹ r, H its own block of the hat matrix.
    left = np.eye(3) - np.einsum("wlip,wpq,wljq->wlij", design, inverse, design, optimize=True)
    gains = np.einsum("wli,wli->wl", residuals, np.linalg.solve(left, residuals[..., None])[..., 0])
    return np.maximum(losses - gains.max(axis=1, initial=0.0), 0.0)


def jump_violation(track: Track, settings: AssessmentSettings) -> Violation | None:
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
    near = track.times[places + 2] - track.times[places - 1] <= settings.jump_duration
    return violations_of(
        chi2.logsf(away[near] ** 2, 3),
        track.times[places[near]],
        track.times[places[near] + 1],
        "mistracked",
    )


def _away(
    track: Track,
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    bent: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return how far steps are from what velocities make of them, (w,) σ, less `bent` (w,) m."""
    times, positions, noise = track.times, track.positions, track.noise
    duration = (times[last] - times[first])[:, None]
    step = positions[last] - positions[first]
    found = np.full(len(first), np.inf)
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
            found = np.minimum(found, np.maximum(off - bent, 0.0) / spread)
    return found


def impulse_violations(track: Track, settings: AssessmentSettings) -> list[Violation]:
    """Test whether velocities change at once in steady contact, and whether objects hop off.

    Points before and after a place are fitted by a parabola each that go on from one another, with
    accelerations that friction may cause, and with an impulse between.
    """
    half = settings.impulse_points
    places = np.arange(half, len(track.times) - half + 1)
    if places.size == 0 or not track.gravity.any():
        return []
    index = places[:, None] + np.arange(-half, half)
    track = replace(track, positions=_without_outliers(track))
    resting, sliding = _contact_states(track, index, settings)
    known = resting | sliding
    places, index, resting, sliding = places[known], index[known], resting[known], sliding[known]
    begins, ends = track.times[places - 1], track.times[places]
    changes, spreads = _impulses(track, index, settings)
    up = track.up
    upward = changes @ up
    level = np.linalg.norm(changes - upward[:, None] * up, axis=1)

    def lengths(sizes: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.maximum(sizes - settings.natural_impulse, 0.0) / spreads

    tests = [
        (resting, chi2.logsf(lengths(np.linalg.norm(changes, axis=1)) ** 2, 3)),
        (sliding, chi2.logsf(lengths(level) ** 2, 2)),
        (sliding, norm.logsf(lengths(upward))),
        (sliding, _hops(track, index, settings)),
    ]
    found = [
        violations_of(log_ps[where], begins[where], ends[where], "kicked")
        for where, log_ps in tests
    ]
    return [one for one in found if one is not None]


def _contact_states(
    track: Track, index: NDArray[np.int64], settings: AssessmentSettings
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where an object rests, or keeps its height on its support, before a place (w,).

    Nothing that could push it is near: no other object, and while it moves no wall.

    `index` (w, l) of the points about each place.
    """
    before = index[:, : index.shape[1] // 2]
    short = track.times[index[:, -1]] - track.times[index[:, 0]] <= settings.impulse_duration
    unhit = short & (track.object_gaps[index].min(axis=1) > settings.side_gap)
    resting = _steady(track.positions[before], track.noise[before], settings)
    steady = _steady((track.positions @ track.up)[before][..., None], track.noise[before], settings)
    # What hovers at the top of a bounce is not in contact.
    touching = track.support_gaps[before].max(axis=1) <= settings.side_gap
    apart = track.wall_gaps[index].min(axis=1) > settings.side_gap
    return resting & unhit, steady & touching & apart & unhit


def _without_outliers(track: Track) -> NDArray[np.float64]:
    """Return positions (n, 3), in m, with points far from both neighbours put between these."""
    between = 0.5 * (track.positions[:-2] + track.positions[2:])
    off = np.linalg.norm(track.positions[1:-1] - between, axis=1)
    found = track.positions.copy()
    far = np.flatnonzero(off > OUTLIER_LENGTH * track.noise[1:-1])
    # Beside an outlier a point is far from the mean of its neighbours too, by half as much.
    worst = [k for k in far if off[k] >= off[max(k - 1, 0) : k + 2].max()]
    found[1:-1][worst] = between[worst]
    return found


def _impulses(
    track: Track, index: NDArray[np.int64], settings: AssessmentSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return changes of velocity (w, 3) in m/s, and the standard deviation (w,) on each axis."""
    half = index.shape[1] // 2
    times = track.times[index] - track.times[index[:, half - 1]][:, None]
    early, late = np.minimum(times, 0.0), np.maximum(times, 0.0)
    basis = [np.ones_like(times), times, 0.5 * early**2, 0.5 * late**2, late]
    design = np.stack(basis, axis=-1) / track.noise[index][..., None]
    seen = track.positions[index] - track.positions[index[:, half - 1]][:, None]
    seen = seen / track.noise[index][..., None]
    prior = np.diag([0.0, 0.0, *[settings.contact_acceleration**-2] * 2, 0.0])
    inverse = np.linalg.inv(np.einsum("wlp,wlq->wpq", design, design) + prior)
    found = inverse @ np.einsum("wlp,wli->wpi", design, seen)
    return found[:, 4], np.sqrt(inverse[:, 4, 4])


def _steady(
    values: NDArray[np.float64], noise: NDArray[np.float64], settings: AssessmentSettings
) -> NDArray[np.bool_]:
    """Return whether points (w, l, d), in m, scatter by their noise (w, l) alone, (w,)."""
    off = (values - values.mean(axis=1, keepdims=True)) / noise[..., None]
    freedom = values.shape[2] * (values.shape[1] - 1)
    return np.asarray((off**2).sum(axis=(1, 2)) <= chi2.isf(settings.steady_p, freedom))


def _hops(
    track: Track, index: NDArray[np.int64], settings: AssessmentSettings
) -> NDArray[np.float64]:
    """Return the log p values (w,) that heights after a place are those before it.

    What is looked for are free flights up and down again, of several durations.
    """
    half = index.shape[1] // 2
    heights = (track.positions @ track.up)[index]
    rises = heights[:, half:] - heights[:, :half].mean(axis=1, keepdims=True) - settings.hop_height
    times = track.times[index[:, half:]] - track.times[index[:, half - 1]][:, None]
    least = np.zeros(len(index))
    counts = [half // 2, 3 * half // 4, half]
    for count in counts:
        flight = times[:, :count] * (times[:, [count - 1]] * (1.0 + 1.0 / count) - times[:, :count])
        spread = np.sqrt((flight**2).sum(axis=1) + flight.sum(axis=1) ** 2 / half)
        score = (flight * rises[:, :count]).sum(axis=1) / (spread * track.noise[index[:, half]])
        least = np.minimum(least, norm.logsf(score) + np.log(len(counts)))
    return least


def rest_violation(track: Track, settings: AssessmentSettings) -> Violation | None:
    """Test whether what rests does so at a height that its shape can have on a plane.

    Where a wall or another object is within reach it may lean.
    """
    count = settings.rest_points
    places = np.arange(len(track.times) - count + 1)
    if len(track.times) < count or not track.gravity.any():
        return None
    index = places[:, None] + np.arange(count)
    noise = track.noise[index]
    where = _steady(track.positions[index], noise, settings)
    where &= track.side_gaps[index].min(axis=1) > settings.side_gap
    heights = track.heights[index].mean(axis=1)
    where &= np.isfinite(heights)
    off = np.abs(heights[:, None] - track.resting_heights).min(axis=1) - settings.height_error
    scores = np.maximum(off, 0.0) / np.sqrt((noise**2).mean(axis=1) / count)
    begins = track.times[index[:, 0]]
    return violations_of(
        (norm.logsf(scores) + np.log(2.0))[where],
        (begins - settings.hold_duration)[where],
        begins[where],
        "held",
    )
