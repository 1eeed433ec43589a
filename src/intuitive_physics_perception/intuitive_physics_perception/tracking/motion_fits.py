"""What points of a path are evidence of: fits with a known acceleration, noise, the change from a
hand to free motion."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics_perception.tracking.settings import InitialStateSettings

FREE_START = 5.0
"""m/s, standard deviation of the velocity of what is seen for the first time."""

MEDIAN_OF_CHI2_3 = 2.366
"""Median of χ² with three degrees of freedom."""


def noise_factor(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    window: float,
) -> float:
    """Return the factor, at least 1, by which errors have larger variances than their covariances.

    Five points in a row differ from a cubic in time by their errors alone, unless there is a bounce
    among them, hence the median over all.

    Parameters
    ----------
    times : (n,) s
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    window : s that five points may last
    """
    misfits = []
    for k in range(len(times) - 4):
        five = slice(k, k + 5)
        if times[k + 4] - times[k] > window:
            continue
        since = (times[five] - times[k]) / (times[k + 4] - times[k])
        # What is orthogonal to all cubics has one component in five points.
        across = np.linalg.qr(np.vander(since, 4), mode="complete")[0][:, 4]
        off = across @ places[five]
        spread = np.einsum("n,nij->ij", across**2, noise[five])
        misfits.append(float(off @ np.linalg.solve(spread, off)))
    return max(1.0, float(np.median(misfits)) / MEDIAN_OF_CHI2_3) if misfits else 1.0


def grown_count(
    since: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    fit: InitialStateSettings,
) -> tuple[int, NDArray[np.float64] | None]:
    """Fit position and velocity, with the acceleration known, to ever more points; return how many
    agree.

    Parameters
    ----------
    since : (n,) s after the first point
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    acceleration : (3,) m/s²
    fit : tuned numbers

    Returns
    -------
    points up to the first that contradicts those before, and where that was expected (3,) m; None
    without one
    """
    # x(t) = x₀ + v₀ t + a t² / 2, linear in x₀ and v₀ once the last term is taken off.
    seen = places - 0.5 * since[:, None] ** 2 * acceleration
    information, right = _sums(np.column_stack([np.ones_like(since), since]), seen, noise)
    squares = np.cumsum(np.einsum("ni,nij,nj->n", seen, np.linalg.inv(noise), seen))
    fewest = fit.min_points
    covariances = np.linalg.inv(information[fewest - 1 :])
    means = np.einsum("nij,nj->ni", covariances, right[fewest - 1 :])
    counts = np.arange(fewest, len(since) + 1)
    freedom = 3.0 * counts - 6.0
    chi2 = squares[fewest - 1 :] - np.einsum("ni,ni->n", right[fewest - 1 :], means)
    # χ² has the mean `freedom` and the variance 2 `freedom`.
    bad = chi2 > freedom + fit.misfit_sigmas * np.sqrt(2.0 * freedom)
    # Row k is of the point after fit k.
    rows = np.zeros((len(counts) - 1, 3, 6))
    rows[:, :, :3] = np.eye(3)
    rows[:, :, 3:] = since[fewest:, None, None] * np.eye(3)
    surprises = seen[fewest:] - np.einsum("nij,nj->ni", rows, means[:-1])
    spreads = rows @ covariances[:-1] @ rows.swapaxes(1, 2) + noise[fewest:]
    distances = np.einsum(
        "ni,ni->n", surprises, np.linalg.solve(spreads, surprises[..., None])[..., 0]
    )
    bad[1:] |= distances > fit.contact_gate
    if not bad.any():
        return len(since), None
    first = int(np.argmax(bad))
    if first == 0:
        return 0, None
    count = int(counts[first - 1])
    return count, rows[first - 1] @ means[first - 1] + 0.5 * since[count] ** 2 * acceleration


def fitted_motion(
    since: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    acceleration: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position and velocity (6,) at the first of some points, and their covariance, which
    grows with the misfit.

    Parameters
    ----------
    since : (n,) s after the first point, n at least 3
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    acceleration : (3,) m/s², known
    """
    seen = places - places[0] - 0.5 * since[:, None] ** 2 * acceleration
    information, right = _sums(np.column_stack([np.ones_like(since), since]), seen, noise)
    covariance = np.linalg.inv(information[-1])
    mean = covariance @ right[-1]
    chi2 = np.einsum("ni,nij,nj->", seen, np.linalg.inv(noise), seen) - right[-1] @ mean
    mean[:3] += places[0]
    return mean, covariance * max(1.0, float(chi2) / (3 * len(since) - 6))


def _sums(
    basis: NDArray[np.float64], places: NDArray[np.float64], noise: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normal equations (n, 3 b, 3 b) and their right sides (n, 3 b) of the first 1, 2, … points, of
    b basis functions (n, b) at the points (n, 3) with covariances (n, 3, 3)."""
    count, functions = basis.shape
    weights = np.linalg.inv(noise)
    each = np.einsum("na,nb,nij->naibj", basis, basis, weights)
    right = np.einsum("na,nij,nj->nai", basis, weights, places)
    size = 3 * functions
    information = np.cumsum(each.reshape(count, size, size), axis=0)
    return information, np.cumsum(right.reshape(count, size), axis=0)


def fitted_acceleration(
    times: NDArray[np.float64], places: NDArray[np.float64], noise: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the constant acceleration (3,) m/s² of some points, and its covariance (3, 3).

    Parameters
    ----------
    times : (n,) s, n at least 3
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    """
    since = times - times.mean()
    basis = np.column_stack([np.ones_like(since), since, 0.5 * since**2])
    information, right = _sums(basis, places - places.mean(axis=0), noise)
    covariance = np.linalg.inv(information[-1])
    return (covariance @ right[-1])[6:], covariance[6:, 6:]


def free_evidence(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    hand_acceleration: float,
) -> float:
    """Return the logarithm of how much likelier some points are in free motion than in a hand.

    A constant acceleration is fitted freely. In free motion it has a known mean and the covariance
    of the fit alone; a hand may give any, independent in each component. So points that cannot tell
    one acceleration from another are no evidence, whatever they fit.

    Parameters
    ----------
    times : (n,) s
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    acceleration : (3,) m/s² of free motion
    hand_acceleration : m/s², standard deviation of what a hand gives
    """
    found, spread = fitted_acceleration(times, places, noise)
    off, wide = found - acceleration, spread + hand_acceleration**2 * np.eye(3)
    free = off @ np.linalg.solve(spread, off) + np.linalg.slogdet(spread)[1]
    held = found @ np.linalg.solve(wide, found) + np.linalg.slogdet(wide)[1]
    return 0.5 * float(held - free)


def release_point(
    times: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    comes_into_view: bool,
    fit: InitialStateSettings,
) -> int:
    """Return from which point on an object has most likely moved freely.

    For each point k the likelihood of all points is computed where a hand moves the object before k
    and the acceleration is the known one from k on. Returned is the k before which the object has
    become free with the probability `release_chance`. The hand's acceleration is a stationary
    random process with the standard deviation `hand_acceleration` and the correlation time
    `hand_time` (Singer, "Estimating optimal tracking filter performance for manned maneuvering
    targets", 1970).
    A hand may let go at any time within `holding_time`; but every second object that comes into
    view is free by then.

    Parameters
    ----------
    times : (n,) s, of which the last have free motion
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    acceleration : (3,) m/s² of free motion
    comes_into_view : whether the object was never seen before
    fit : tuned numbers
    """
    last = len(times) - fit.min_points
    if last <= 0:
        return 0
    mean = np.concatenate([places[0], np.zeros(6)])
    deviations = np.repeat([1.0, FREE_START, fit.hand_acceleration], 3)
    covariance = np.asarray(np.diag(deviations**2), dtype=np.float64)
    seen, logs = 0.0, []
    for k in range(last + 1):
        if k:
            mean, covariance = _swung(mean, covariance, times[k] - times[k - 1], fit)
        free = slice(k, None)
        logs.append(
            seen
            + _log_free(
                mean[:6],
                covariance[:6, :6],
                times[free] - times[k],
                places[free],
                noise[free],
                acceleration,
            )
        )
        spread = covariance[:3, :3] + noise[k]
        off = places[k] - mean[:3]
        gain = np.linalg.solve(spread, covariance[:3]).T
        mean, covariance = mean + gain @ off, covariance - gain @ spread @ gain.T
        seen -= 0.5 * float(off @ np.linalg.solve(spread, off) + np.linalg.slogdet(spread)[1])
    chance = np.exp(np.array(logs) - max(logs))
    if comes_into_view:
        chance[0] *= fit.holding_time * last / (times[last] - times[0])
    return int(np.searchsorted(np.cumsum(chance), fit.release_chance * chance.sum()))


def _swung(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    duration: float,
    fit: InitialStateSettings,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position, velocity and acceleration (9,), with covariance, in a hand some s later."""
    kept = float(np.exp(-duration / fit.hand_time))
    # The acceleration is linear over the step, from a to kept · a + w.
    gain = np.array([duration**2 / 6.0, duration / 2.0, 1.0])
    step = np.array(
        [
            [1.0, duration, duration**2 / 3.0 + gain[0] * kept],
            [0.0, 1.0, duration / 2.0 + gain[1] * kept],
            [0.0, 0.0, kept],
        ]
    )
    transition = np.kron(step, np.eye(3))
    variance = fit.hand_acceleration**2 * (1.0 - kept**2)
    added = np.kron(variance * np.outer(gain, gain), np.eye(3))
    return transition @ mean, transition @ covariance @ transition.T + added


def _log_free(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    since: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    acceleration: NDArray[np.float64],
) -> float:
    """Logarithm of the likelihood of points in free motion, but for terms that all hands share.

    Position and velocity (6,) at the first point have a mean and covariance from the hand before.
    """
    seen = places - 0.5 * since[:, None] ** 2 * acceleration - mean[:3] - since[:, None] * mean[3:]
    information, right = _sums(np.column_stack([np.ones_like(since), since]), seen, noise)
    fitted = np.linalg.inv(information[-1])
    off = fitted @ right[-1]
    weights = np.linalg.inv(noise)
    chi2 = float(np.einsum("ni,nij,nj->", seen, weights, seen) - off @ right[-1])
    chi2 += float(off @ np.linalg.solve(covariance + fitted, off))
    logs = np.linalg.slogdet(covariance + fitted)[1] - np.linalg.slogdet(fitted)[1]
    return -0.5 * float(chi2 + logs + np.linalg.slogdet(noise)[1].sum())
