"""Evidence of points of a path: fits with a known acceleration, noise, the change from a
hand to free motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from intuitive_physics.geometry.path_differences import difference_weights, path_differences

MIN_POINTS = 3
"""Smallest number of points of a stretch."""

CONTACT_GATE = 16.0
"""Squared distance, in variances, from which on the next point shows a contact."""

MISFIT_SIGMAS = 5.0
"""Standard deviations by which χ² of a stretch may exceed its mean."""

HAND_ACCELERATION = 10.0
"""Standard deviation of the acceleration that a hand gives, m/s²: from rest to 2 m/s in 0.2 s."""

HAND_TIME = 0.1
"""Correlation time of that acceleration, s."""

HOLDING_TIME = 2.0
"""Time for which a hand is seen to hold an object, s."""

RELEASE_CHANCE = 0.8
"""Probability with which the object is free where a stretch begins: a point too few costs little, a
point of the hand spoils the velocity."""

NOISE_WINDOW = 0.15
"""Time in which a path is a cubic but for noise, by which the noise is measured, s: five frames at
30 Hz."""

FREE_START = 5.0
"""m/s, standard deviation of the velocity of what is seen for the first time."""

MEDIAN_OF_CHI2_3 = 2.366
"""Median of χ² with three degrees of freedom."""


@dataclass(frozen=True, eq=False)
class SeenPath:
    """Points of a path as they were seen.

    Parameters
    ----------
    times : (n,) s
    places : (n, 3) m
    noise : (n, 3, 3) m², covariances of the points
    """

    times: NDArray[np.float64]
    places: NDArray[np.float64]
    noise: NDArray[np.float64]

    def __getitem__(self, part: slice | NDArray[np.int_]) -> SeenPath:
        return SeenPath(self.times[part], self.places[part], self.noise[part])

    @property
    def since(self) -> NDArray[np.float64]:
        """Times (n,) s after the first point."""
        return self.times - self.times[0]

    def with_shown_noise(self) -> SeenPath:
        """Return the path with covariances as large as its errors show that they are."""
        return replace(self, noise=noise_factor(self) * self.noise)


def noise_factor(path: SeenPath) -> float:
    """Return the factor, at least 1, by which errors have larger variances than their covariances.

    Five points in a row differ from a cubic in time by their errors alone, unless there is a bounce
    among them, hence the median over all.
    """
    weights = difference_weights(path.times, 4)
    differences = path_differences(path.places, weights)
    misfits = []
    for k in np.flatnonzero(path.times[4:] - path.times[:-4] <= NOISE_WINDOW).tolist():
        spread = np.einsum("n,nij->ij", weights[k] ** 2, path.noise[k : k + 5])
        misfits.append(float(differences[k] @ np.linalg.solve(spread, differences[k])))
    return max(1.0, float(np.median(misfits)) / MEDIAN_OF_CHI2_3) if misfits else 1.0


def spoilt_points(path: SeenPath) -> NDArray[np.bool_]:
    """Return which points (n,) are not where the object was, though their covariances say so.

    Such is a point beside a hand whose readings drew it away. It differs from the cubic through
    the two points before and after it by more than noise and a hand's acceleration explain, and
    without it all others agree. After a bounce they do not, as the velocity is another.
    """
    suspects = 2 + np.flatnonzero(_misfits(path) > CONTACT_GATE)
    spoilt = np.zeros(len(path.times), dtype=bool)
    for k in suspects.tolist():
        near = np.r_[max(k - 4, 0) : k, k + 1 : min(k + 5, len(path.times))]
        left = _misfits(path[near])
        # Without five points nothing shows whether they agree.
        spoilt[k] = left.size > 0 and left.max() <= CONTACT_GATE
    return spoilt


def _misfits(path: SeenPath) -> NDArray[np.float64]:
    """Squared distances (n - 4,), in variances, of each third of five points from a cubic through
    the others: of noise and a hand."""
    weights = difference_weights(path.times, 4)
    differences = path_differences(path.places, weights)
    if not len(weights):
        return np.empty(0)
    five = sliding_window_view(np.arange(len(path.times)), 5)
    spread = np.einsum("kn,knij->kij", weights**2, path.noise[five])
    gaps = np.abs(path.times[five][:, :, None] - path.times[five][:, None, :]) / HAND_TIME
    # Fourfold integral of the acceleration's correlation: what a difference that annuls uniform
    # motion has of it is of this covariance.
    swung = HAND_ACCELERATION**2 * HAND_TIME**4 * (np.exp(-gaps) + gaps + gaps**3 / 6.0)
    bent = np.einsum("kn,knm,km->k", weights, swung, weights)
    spread += bent[:, None, None] * np.eye(3)
    off = np.linalg.solve(spread, differences[..., None])[..., 0]
    return np.asarray(np.einsum("ki,ki->k", differences, off))


def grown_count(
    path: SeenPath, acceleration: NDArray[np.float64]
) -> tuple[int, NDArray[np.float64] | None]:
    """Fit position and velocity, with the acceleration known, to ever more points; return how many
    agree.

    `acceleration` (3,) m/s². Returns points up to the first that contradicts those before, and
    where that was expected (3,) m; None without one.
    """
    since, noise = path.since, path.noise
    # x(t) = x₀ + v₀ t + a t² / 2, linear in x₀ and v₀ once the last term is taken off.
    reduced = path.places - path.places[0] - 0.5 * since[:, None] ** 2 * acceleration
    information, right = _sums(np.column_stack([np.ones_like(since), since]), reduced, noise)
    squares = np.cumsum(np.einsum("ni,nij,nj->n", reduced, np.linalg.inv(noise), reduced))
    fewest = MIN_POINTS
    covariances = np.linalg.inv(information[fewest - 1 :])
    means = np.einsum("nij,nj->ni", covariances, right[fewest - 1 :])
    counts = np.arange(fewest, len(since) + 1)
    freedom = 3.0 * counts - 6.0
    chi2 = squares[fewest - 1 :] - np.einsum("ni,ni->n", right[fewest - 1 :], means)
    # χ² has the mean `freedom` and the variance 2 `freedom`.
    bad = chi2 > freedom + MISFIT_SIGMAS * np.sqrt(2.0 * freedom)
    # Row k is of the point after fit k.
    rows = np.zeros((len(counts) - 1, 3, 6))
    rows[:, :, :3] = np.eye(3)
    rows[:, :, 3:] = since[fewest:, None, None] * np.eye(3)
    surprises = reduced[fewest:] - np.einsum("nij,nj->ni", rows, means[:-1])
    spreads = rows @ covariances[:-1] @ rows.swapaxes(1, 2) + noise[fewest:]
    distances = np.einsum(
        "ni,ni->n", surprises, np.linalg.solve(spreads, surprises[..., None])[..., 0]
    )
    bad[1:] |= distances > CONTACT_GATE
    if not bad.any():
        return len(since), None
    first = int(np.argmax(bad))
    if first == 0:
        return 0, None
    count = int(counts[first - 1])
    expected = rows[first - 1] @ means[first - 1] + 0.5 * since[count] ** 2 * acceleration
    return count, path.places[0] + expected


def fitted_motion(
    path: SeenPath, acceleration: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return position and velocity (6,) at the first of some points, three at least, and their
    covariance, which grows with the misfit.

    `acceleration` (3,) m/s², known.
    """
    since = path.since
    reduced = path.places - path.places[0] - 0.5 * since[:, None] ** 2 * acceleration
    straight = np.column_stack([np.ones_like(since), since])
    mean, covariance, chi2 = _fitted(straight, reduced, path.noise)
    mean[:3] += path.places[0]
    return mean, covariance * max(1.0, chi2 / (3 * len(since) - 6))


def _fitted(
    basis: NDArray[np.float64], places: NDArray[np.float64], noise: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Factors (3 b,) of basis functions by least squares, their covariance, and χ² of the rest."""
    information, right = _sums(basis, places, noise)
    covariance = np.linalg.inv(information[-1])
    mean = covariance @ right[-1]
    chi2 = np.einsum("ni,nij,nj->", places, np.linalg.inv(noise), places) - right[-1] @ mean
    return mean, covariance, float(chi2)


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


def fitted_acceleration(path: SeenPath) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Fit a constant acceleration to points, three at least.

    Returns the acceleration (3,) m/s², its covariance (3, 3) and χ² of what it leaves.
    """
    since = path.times - path.times.mean()
    basis = np.column_stack([np.ones_like(since), since, 0.5 * since**2])
    centred = path.places - path.places.mean(axis=0)
    motion, covariance, chi2 = _fitted(basis, centred, path.noise)
    return motion[6:], covariance[6:, 6:], chi2


def free_evidence(path: SeenPath, acceleration: NDArray[np.float64]) -> float:
    """Return the logarithm of how much likelier some points are in free motion than in a hand.

    A constant acceleration is fitted freely. In free motion it has a known mean and the covariance
    of the fit alone; a hand may give any, independent in each component. So points that cannot
    distinguish one acceleration from another are no evidence, whatever they fit.

    `acceleration` (3,) m/s² of free motion.
    """
    fitted, spread, _ = fitted_acceleration(path)
    off, wide = fitted - acceleration, spread + HAND_ACCELERATION**2 * np.eye(3)
    free = off @ np.linalg.solve(spread, off) + np.linalg.slogdet(spread)[1]
    held = fitted @ np.linalg.solve(wide, fitted) + np.linalg.slogdet(wide)[1]
    return 0.5 * float(held - free)


def shows_acceleration(path: SeenPath) -> bool:
    """Return whether points, three at least, tell the acceleration better than one knows it of a
    hand: the volume of its error is less."""
    _, spread, _ = fitted_acceleration(path)
    return bool(np.linalg.slogdet(spread)[1] < 6.0 * np.log(HAND_ACCELERATION))


def release_point(
    path: SeenPath, acceleration: NDArray[np.float64], *, comes_into_view: bool
) -> int:
    """Return from which point on an object has most likely moved freely, as it does at the last.

    For each point k the likelihood of all points is computed where a hand moves the object before k
    and the acceleration is the known one from k on. Returned is the k before which the object has
    become free with the probability `RELEASE_CHANCE`. The hand's acceleration is a stationary
    random process with the standard deviation `HAND_ACCELERATION` and the correlation time
    `HAND_TIME` (Singer, "Estimating optimal tracking filter performance for manned maneuvering
    targets", 1970). A hand may let go at any time within `HOLDING_TIME`; but every second object
    that comes into view is free by then.

    `acceleration` (3,) m/s² of free motion.
    """
    times, places, noise = path.times, path.places, path.noise
    last = len(times) - MIN_POINTS
    if last <= 0:
        return 0
    mean = np.concatenate([places[0], np.zeros(6)])
    deviations = np.repeat([1.0, FREE_START, HAND_ACCELERATION], 3)
    covariance = np.asarray(np.diag(deviations**2), dtype=np.float64)
    log_before, logs = 0.0, []
    for k in range(last + 1):
        if k:
            mean, covariance = _swung(mean, covariance, times[k] - times[k - 1])
        logs.append(log_before + _log_free(mean[:6], covariance[:6, :6], path[k:], acceleration))
        spread = covariance[:3, :3] + noise[k]
        off = places[k] - mean[:3]
        gain = np.linalg.solve(spread, covariance[:3]).T
        mean, covariance = mean + gain @ off, covariance - gain @ spread @ gain.T
        log_before -= 0.5 * float(off @ np.linalg.solve(spread, off) + np.linalg.slogdet(spread)[1])
    chance = np.exp(np.array(logs) - max(logs))
    if comes_into_view:
        chance[0] *= HOLDING_TIME * last / (times[last] - times[0])
    return int(np.searchsorted(np.cumsum(chance), RELEASE_CHANCE * chance.sum()))


def _swung(
    mean: NDArray[np.float64], covariance: NDArray[np.float64], duration: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Position, velocity and acceleration (9,), with covariance, in a hand some s later."""
    kept = float(np.exp(-duration / HAND_TIME))
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
    variance = HAND_ACCELERATION**2 * (1.0 - kept**2)
    added = np.kron(variance * np.outer(gain, gain), np.eye(3))
    return transition @ mean, transition @ covariance @ transition.T + added


def _log_free(
    mean: NDArray[np.float64],
    covariance: NDArray[np.float64],
    path: SeenPath,
    acceleration: NDArray[np.float64],
) -> float:
    """Logarithm of the likelihood of points in free motion, but for terms that all hands share.

    Position and velocity (6,) at the first point have a mean and covariance from the hand before.
    """
    since, noise = path.since, path.noise
    falls = 0.5 * since[:, None] ** 2 * acceleration
    reduced = path.places - falls - mean[:3] - since[:, None] * mean[3:]
    straight = np.column_stack([np.ones_like(since), since])
    off, fitted, chi2 = _fitted(straight, reduced, noise)
    chi2 += float(off @ np.linalg.solve(covariance + fitted, off))
    logs = np.linalg.slogdet(covariance + fitted)[1] - np.linalg.slogdet(fitted)[1]
    return -0.5 * float(chi2 + logs + np.linalg.slogdet(noise)[1].sum())
