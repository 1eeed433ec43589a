"""Whether what touches nothing is in free flight: no θ_s is needed to know its acceleration."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from intuitive_physics_learner.assessment.settings import AssessmentSettings
from intuitive_physics_learner.assessment.tracks import Track
from intuitive_physics_learner.assessment.violation import Violation, violations_of


def flight_violation(track: Track, settings: AssessmentSettings) -> Violation | None:
    """Fit free flights to windows of points between which nothing can be touched.

    The acceleration is gravity plus an unknown one, normal about 0. One point of each window does
    not count, the one that fits worst, so that an outlier alone violates nothing.

    Parameters
    ----------
    track : n points
    settings : of the windows

    Returns
    -------
    None where there is no such window.
    """
    free = free_intervals(track, settings)
    begins, ends, log_ps = [], [], []
    for count in settings.flight_points:
        if count > len(track.times):
            continue
        starts = np.flatnonzero(
            np.lib.stride_tricks.sliding_window_view(free, count - 1).all(axis=1)
        )
        losses = flight_losses(track, starts, count, settings)
        # The worst of `count` points is left out: as many ways to pick it.
        log_ps.append(chi2.logsf(losses, 3 * (count - 3)) + np.log(count))
        begins.append(track.times[starts])
        ends.append(track.times[starts + count - 1])
    if not log_ps:
        return None
    return violations_of(
        np.concatenate(log_ps), np.concatenate(begins), np.concatenate(ends), "not in free flight"
    )


def free_intervals(track: Track, settings: AssessmentSettings) -> NDArray[np.bool_]:
    """Return whether nothing can be touched from each point to the next, (n - 1,).

    The speed between two points is taken from the intervals beside, which a jump leaves as they
    are.

    Parameters
    ----------
    track : n points
    settings : of the clearance
    """
    durations = np.diff(track.times)
    speeds = np.linalg.norm(np.diff(track.positions, axis=0), axis=1) / durations
    beside = np.pad(speeds, 1, mode="edge")
    fastest = np.maximum(beside[:-2], beside[2:])
    reach = (fastest + np.linalg.norm(track.gravity) * durations) * durations
    clear = np.minimum(track.support_gaps, track.side_gaps)
    clear = clear - settings.clearance - settings.clear_noises * track.noise
    return (clear[1:] > 0.0) & (clear[:-1] > 0.0) & (clear[1:] + clear[:-1] > reach)


def flight_losses(
    track: Track, starts: NDArray[np.int64], count: int, settings: AssessmentSettings
) -> NDArray[np.float64]:
    """Return the least sums of squares (w,), without a unit, that remain without the worst point.

    Parameters
    ----------
    track : n points
    starts : (w,) index of the first point of each window
    count : points of a window
    settings : of the acceleration beyond gravity
    """
    index = starts[:, None] + np.arange(count)
    times = track.times[index]
    times = times - times.mean(axis=1, keepdims=True)
    whitening = track.whitening[index]
    places = track.positions[index] - 0.5 * track.gravity * times[..., None] ** 2
    places = places - places.mean(axis=1, keepdims=True)
    seen = np.einsum("wlij,wlj->wli", whitening, places)
    basis = np.stack([np.ones_like(times), times, 0.5 * times**2], axis=-1)
    design = np.einsum("wlij,wlb->wlibj", whitening, basis).reshape(len(starts), count, 3, 9)
    spread = settings.air_acceleration if track.in_air else settings.flight_acceleration
    prior = np.diag([0.0] * 6 + [spread**-2] * 3)
    inverse = np.linalg.inv(np.einsum("wlip,wliq->wpq", design, design) + prior)
    projected = np.einsum("wlip,wli->wp", design, seen)
    found = np.einsum("wpq,wq->wp", inverse, projected)
    residuals = seen - np.einsum("wlip,wp->wli", design, found)
    losses = (seen**2).sum(axis=(1, 2)) - (projected * found).sum(axis=1)
    # Without a point, the loss is less by rᵀ (1 - H)⁻¹ r, H its own block of the hat matrix.
    left = np.eye(3) - np.einsum("wlip,wpq,wljq->wlij", design, inverse, design, optimize=True)
    gains = np.einsum("wli,wli->wl", residuals, np.linalg.solve(left, residuals[..., None])[..., 0])
    return np.maximum(losses - gains.max(axis=1, initial=0.0), 0.0)
