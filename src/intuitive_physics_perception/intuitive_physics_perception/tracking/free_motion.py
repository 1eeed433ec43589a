"""Where in a record only gravity and planes act on an object: stretches of free motion.

A stretch is a matter of evidence. Its points fit the acceleration of flight, or of sliding on the
planes that the object touches, and they could tell that acceleration from none. It begins where
"anything a hand may do before, free motion from here on" is most likely of all points, and ends
where the next point contradicts it, the first sign of a bounce.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics_perception.tracking.attitude import Attitude
from intuitive_physics_perception.tracking.motion import (
    downward,
    supported_acceleration,
    supporting_planes,
)
from intuitive_physics_perception.tracking.settings import InitialStateSettings

SAME_TIME = 1e-9
"""s by which times of one frame may differ: numerical."""

RELEASE_ITERATIONS = 4
"""How often beginning and end of a stretch are improved in turn at most: mostly once is enough."""

FREE_START = 5.0
"""m/s, standard deviation of the velocity of what is seen for the first time."""

MEDIAN_OF_CHI2_3 = 2.366
"""Median of χ² with three degrees of freedom."""


@dataclass(frozen=True, eq=False)
class Record:
    """Detections of one object.

    Parameters
    ----------
    object : what it is
    times : (n,) s, strictly increasing
    positions : (n, 3) m, of the centre in the environment's frame
    covariances : (n, 3, 3) m², of the error that each has of its own
    bias : (3, 3) m², covariance of the error that is the same in all
    attitudes : of each, how a box or capsule lies and turns as far as was known then; None of a
        sphere
    path_times, path_positions : (m,) s and (m, 3) m, the same motion in the light of all frames
    """

    object: SceneObject
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    covariances: NDArray[np.float64]
    bias: NDArray[np.float64]
    attitudes: tuple[Attitude, ...] | None
    path_times: NDArray[np.float64]
    path_positions: NDArray[np.float64]

    def between(self, start: float, end: float) -> Record:
        """Return the part with start ≤ time < end."""
        inside = (self.times >= start) & (self.times < end)
        on_path = (self.path_times >= start) & (self.path_times < end)
        return Record(
            self.object,
            self.times[inside],
            self.positions[inside],
            self.covariances[inside],
            self.bias,
            _chosen(self.attitudes, inside),
            self.path_times[on_path],
            self.path_positions[on_path],
        )

    def covariance_at(self, k: int) -> NDArray[np.float64]:
        """Return the covariance (3, 3) in m² of the whole error of point k."""
        return self.covariances[k] + self.bias

    @property
    def travel(self) -> float:
        """Largest distance in m from the first position."""
        if not len(self.times):
            return 0.0
        return float(np.linalg.norm(self.positions - self.positions[0], axis=1).max())


def _chosen(
    attitudes: tuple[Attitude, ...] | None, which: NDArray[np.bool_]
) -> tuple[Attitude, ...] | None:
    if attitudes is None:
        return None
    return tuple(attitudes[k] for k in np.flatnonzero(which))


@dataclass(frozen=True, eq=False)
class Stretch:
    """Points of a record that move freely, start to end (exclusive).

    Parameters
    ----------
    start, end : indices
    time : s of the first point
    mean, covariance : (6,) and (6, 6) of position (m) and velocity (m/s) at `time`
    acceleration : (3,) m/s², the same all the time
    plane : that carried the object; None in flight
    goes_on : whether no point contradicts it: it is only too long, or the record ends
    """

    start: int
    end: int
    time: float
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    plane: Plane | None
    goes_on: bool

    def at(self, time: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (6,) and (6, 6) of position and velocity at a time in s."""
        since = time - self.time
        onward = np.eye(6)
        onward[:3, 3:] = since * np.eye(3)
        gained = np.concatenate([0.5 * since**2 * self.acceleration, since * self.acceleration])
        return onward @ self.mean + gained, onward @ self.covariance @ onward.T


class FreeMotion:
    """Finds the stretches of a record in which only gravity and planes act on the object.

    It looks no further than it is asked about.

    Parameters
    ----------
    record : what was seen of the object
    environment : it moved in
    fit : tuned numbers
    """

    def __init__(self, record: Record, environment: Environment, fit: InitialStateSettings) -> None:
        self._record = record
        self._environment = environment
        self._fit = fit
        self._noise = noise_factor(record, fit.noise_window) * record.covariances
        self._found: list[Stretch] = []
        self._looked = 0

    def stretch_at(self, time: float) -> Stretch | None:
        """Return the stretch that holds a time in s, None where there is none."""
        times = self._record.times
        while self._looked < len(times) and times[self._looked] <= time + SAME_TIME:
            found = self._next(self._looked)
            self._looked = len(times) if found is None else found.end
            if found is not None:
                self._found.append(found)
        for stretch in self._found:
            if stretch.time <= time + SAME_TIME and times[stretch.end - 1] >= time:
                return stretch
        return None

    def _next(self, first: int) -> Stretch | None:
        """The first stretch that begins at point `first` or later."""
        if self._found and self._found[-1].goes_on:
            before = self._found[-1]
            grown = self._grown(first, before.acceleration)
            if grown.end - first >= self._fit.min_points:
                return self._stretch(first, grown, before.plane, before.acceleration)
        for start in range(first, len(self._record.times) - self._fit.min_points + 1):
            sure = [
                (grown, plane, acceleration)
                for plane, acceleration in self._accelerations(start)
                if (grown := self._sure_growth(start, plane, acceleration)) is not None
            ]
            if sure:
                found = self._from_its_release(first, start, *max(sure, key=lambda one: one[0].end))
                if self._evidence(found) > self._fit.touching_evidence:
                    return found
        return None

    def _from_its_release(
        self,
        first: int,
        start: int,
        grown: _Growth,
        plane: Plane | None,
        acceleration: NDArray[np.float64],
    ) -> Stretch:
        """A stretch that was found, from where all else ceased to move the object.

        As the beginning moves, so may the end, hence both are found in turn until they stay.
        """
        record = self._record
        earliest = int(np.searchsorted(record.times, record.times[start] - self._fit.hand_memory))
        for _ in range(RELEASE_ITERATIONS):
            part = slice(max(first, earliest), grown.end)
            start = part.start + release_point(
                record.times[part],
                record.positions[part],
                self._noise[part],
                acceleration,
                part.start == 0,
                self._fit,
            )
            further = self._grown(start, acceleration)
            if further.end <= grown.end:
                break
            grown = further
        return self._stretch(start, grown, plane, acceleration)

    def _stretch(
        self, start: int, grown: _Growth, plane: Plane | None, acceleration: NDArray[np.float64]
    ) -> Stretch:
        record, points = self._record, slice(start, grown.end)
        mean, covariance = fitted_motion(
            record.times[points] - record.times[start],
            record.positions[points],
            self._noise[points],
            acceleration,
        )
        covariance[:3, :3] += record.bias
        return Stretch(
            start,
            grown.end,
            float(record.times[start]),
            mean,
            covariance,
            acceleration,
            plane,
            grown.expected is None,
        )

    def _evidence(self, stretch: Stretch) -> float:
        points = slice(stretch.start, stretch.end)
        return free_evidence(
            self._record.times[points],
            self._record.positions[points],
            self._noise[points],
            stretch.acceleration,
            self._fit.hand_acceleration,
        )

    def _accelerations(self, start: int) -> list[tuple[Plane | None, NDArray[np.float64]]]:
        """Flight, and sliding where the ball touches planes; with the first plane that carries
        it."""
        noise = float(np.sqrt(np.trace(self._record.covariance_at(start))))
        touched = supporting_planes(
            self._environment,
            self._record.positions[start],
            _height(self._record, start, self._environment),
            self._fit.touch_sigmas * noise + self._fit.touch_slack,
        )
        found: list[tuple[Plane | None, NDArray[np.float64]]] = [(None, self._environment.gravity)]
        if touched:
            found.append((touched[0], supported_acceleration(self._environment, touched)))
        return found

    def _grown(self, start: int, acceleration: NDArray[np.float64]) -> _Growth:
        """Grow a stretch from `start` until a point shows a contact or it is long enough."""
        fit, times = self._fit, self._record.times
        stop = int(np.searchsorted(times, times[start] + fit.max_duration, side="right"))
        points = slice(start, stop)
        if stop - start < fit.min_points:
            return _Growth(start, None)
        count, expected = _grown_count(
            times[points] - times[start],
            self._record.positions[points] - self._record.positions[start],
            self._noise[points],
            acceleration,
            fit,
        )
        if expected is None:
            return _Growth(start + count, None)
        # The bounce may have begun before the point that shows it.
        kept = count - 1 if count > fit.min_points + 1 else count
        return _Growth(start + kept, self._record.positions[start] + expected, start + count)

    def _sure_growth(
        self, start: int, plane: Plane | None, acceleration: NDArray[np.float64]
    ) -> _Growth | None:
        """The stretch from `start`; None where the points may as well have moved otherwise."""
        grown = self._grown(start, acceleration)
        if grown.end - start < self._fit.min_points:
            return None
        touches = plane is not None or (
            grown.expected is not None and self._touches(grown.contact, grown.expected)
        )
        needed = self._fit.touching_evidence if touches else self._fit.sure_evidence
        found = self._stretch(start, grown, plane, acceleration)
        return grown if self._evidence(found) > needed else None

    def _touches(self, k: int, position: NDArray[np.float64]) -> bool:
        """Whether a ball expected at `position` at point k would have met a plane by then."""
        reach = self._record.object.shape.bounding_radius + self._fit.touch_slack
        reach += self._fit.touch_sigmas * float(np.sqrt(np.trace(self._record.covariance_at(k))))
        return any(plane.signed_distances(position) < reach for plane in self._environment.planes)


def _height(record: Record, k: int, environment: Environment) -> float:
    """m of the centre above the lowest point, at point k."""
    if record.attitudes is None:
        return record.object.shape.bounding_radius
    return record.attitudes[k].reach(downward(environment))


def noise_factor(record: Record, window: float) -> float:
    """Return the factor, at least 1, by which errors have larger variances than their covariances.

    Five points in a row differ from a cubic in time by their errors alone, unless there is a bounce
    among them, hence the median over all.

    Parameters
    ----------
    record : what was seen
    window : s that five points may last
    """
    times, misfits = record.times, []
    for k in range(len(times) - 4):
        five = slice(k, k + 5)
        if times[k + 4] - times[k] > window:
            continue
        since = (times[five] - times[k]) / (times[k + 4] - times[k])
        # What is orthogonal to all cubics has one component in five points.
        across = np.linalg.qr(np.vander(since, 4), mode="complete")[0][:, 4]
        off = across @ record.positions[five]
        spread = np.einsum("n,nij->ij", across**2, record.covariances[five])
        misfits.append(float(off @ np.linalg.solve(spread, off)))
    return max(1.0, float(np.median(misfits)) / MEDIAN_OF_CHI2_3) if misfits else 1.0


@dataclass(frozen=True, eq=False)
class _Growth:
    """How far a stretch goes.

    Parameters
    ----------
    end : index after its last point
    expected : (3,) m, where the first point was expected that contradicts those before; None
        without one
    contact : index of that point
    """

    end: int
    expected: NDArray[np.float64] | None
    contact: int = -1


def _grown_count(
    since: NDArray[np.float64],
    places: NDArray[np.float64],
    noise: NDArray[np.float64],
    acceleration: NDArray[np.float64],
    fit: InitialStateSettings,
) -> tuple[int, NDArray[np.float64] | None]:
    """Fit position and velocity, with the acceleration known, to ever more points.

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
    """Position and velocity (6,) at the first of some points, and their covariance, which grows
    with the misfit."""
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
    since = times - times.mean()
    basis = np.column_stack([np.ones_like(since), since, 0.5 * since**2])
    information, right = _sums(basis, places - places.mean(axis=0), noise)
    covariance = np.linalg.inv(information[-1])
    found, spread = (covariance @ right[-1])[6:], covariance[6:, 6:]
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
    covariance = np.kron(np.diag([1.0, FREE_START**2, fit.hand_acceleration**2]), np.eye(3))
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
