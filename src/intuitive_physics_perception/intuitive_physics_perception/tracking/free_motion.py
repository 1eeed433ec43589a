"""Stretches of free motion in a record: only gravity and planes act on the object.

A stretch is a matter of evidence. Its points fit the acceleration of flight, or of sliding on the
planes that the object touches, and they distinguish it from no acceleration. It begins where
"anything a hand may do before, free motion from here on" is most likely of all points, and ends
where the next point contradicts it, the first sign of a bounce.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Detections
from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.state import ObjectState
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.attitude import (
    ROLLING_TIME,
    Attitude,
    object_state,
    rolling_angular_velocity,
    unknown_angular_velocity,
)
from intuitive_physics_perception.tracking.motion import ROLLING_INERTIA, downward
from intuitive_physics_perception.tracking.motion_fits import (
    MIN_POINTS,
    SeenPath,
    fitted_motion,
    free_evidence,
    grown_count,
    release_point,
    shows_acceleration,
    spoilt_points,
)
from intuitive_physics_perception.tracking.supports import supported_acceleration, surfaces_of

MAX_DURATION = 0.4
"""Longest duration of a stretch, s."""

SURE_EVIDENCE = 7.0
"""Logarithm of how much likelier points must be in free motion than in a hand: 1,000 times. A swing
falls like a free ball for moments, and 30 to 90 beginnings are tried a second."""

TOUCHING_EVIDENCE = -1.0
"""`SURE_EVIDENCE` where a plane ends the flight or carries the object, as a hop may last for three
frames at 30 Hz; an object that is held still above a plane is at -5 then."""

HAND_MEMORY = 0.4
"""Time before a stretch, as it was found first, in which its beginning is looked for, s."""

TOUCH_SIGMAS = 3.0
"""Standard deviations of its position within which an object touches a plane."""

TOUCH_SLACK = 0.005
"""Gap beyond that up to which it touches, m."""

SAME_TIME = 1e-9
"""Largest difference, s, of times of one frame: numerical."""

RELEASE_ITERATIONS = 4
"""Largest number of rounds in which beginning and end of a stretch are improved: one mostly."""


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
        on_path = (self.path_times >= start) & (self.path_times < end)
        return replace(
            self._of((self.times >= start) & (self.times < end)),
            path_times=self.path_times[on_path],
            path_positions=self.path_positions[on_path],
        )

    def without_spoilt(self) -> Record:
        """Return it without detections that contradict those before and after them."""
        return self._of(~spoilt_points(self.seen_path.with_shown_noise()))

    def _of(self, kept: NDArray[np.bool_]) -> Record:
        """The record of some detections (n,), on the same path."""
        attitudes = self.attitudes
        if attitudes is not None:
            attitudes = tuple(attitudes[k] for k in np.flatnonzero(kept))
        return replace(
            self,
            times=self.times[kept],
            positions=self.positions[kept],
            covariances=self.covariances[kept],
            attitudes=attitudes,
        )

    @property
    def seen_path(self) -> SeenPath:
        """Times, positions and covariances, to be fitted."""
        return SeenPath(self.times, self.positions, self.covariances)

    @property
    def detections(self) -> Detections:
        """Times, positions and covariances, as observations have them."""
        return Detections(self.times, self.positions, self.covariances, self.bias)

    def covariance_at(self, k: int) -> NDArray[np.float64]:
        """Return the covariance (3, 3) in m² of the whole error of point k."""
        return self.covariances[k] + self.bias

    @property
    def travel(self) -> float:
        """Largest distance in m from the first position."""
        if not len(self.times):
            return 0.0
        return float(np.linalg.norm(self.positions - self.positions[0], axis=1).max())


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


@dataclass(frozen=True, eq=False)
class _Growth:
    """End of a stretch, the index after its last point; where (3,) m the first point was expected
    that contradicts those before, None without one; and the index of that."""

    end: int
    expected: NDArray[np.float64] | None
    contact: int = -1


class FreeMotion:
    """Finds the stretches of a record in which only gravity and planes act on the object.

    A stretch is searched when it is asked for.

    Parameters
    ----------
    record : detections of the object
    environment : it moved in
    """

    def __init__(self, record: Record, environment: Environment) -> None:
        self._record = record.without_spoilt()
        self._environment = environment
        self._path = self._record.seen_path.with_shown_noise()
        self._stretches: list[Stretch] = []
        self._searched = 0

    def stretch_at(self, time: float) -> Stretch | None:
        """Return the stretch that holds a time in s, None where there is none."""
        times = self._record.times
        while self._searched < len(times) and times[self._searched] <= time + SAME_TIME:
            stretch = self._next(self._searched)
            if stretch is None:
                self._searched = len(times)
            else:
                self._searched = stretch.end
                self._stretches.append(stretch)
        for stretch in self._stretches:
            if stretch.time <= time + SAME_TIME and times[stretch.end - 1] >= time:
                return stretch
        return None

    def state_at(self, time: float, settings: PerceptionSettings) -> ObjectState | None:
        """Estimate the object's state θ_d from the stretch that holds a time in s.

        Position and velocity come from weighted least squares with the acceleration known; their
        covariance grows with the misfit. Returns None where no stretch holds the time.
        """
        stretch = self.stretch_at(time)
        if stretch is None:
            return None
        mean, spread = stretch.at(time)
        attitudes = self._record.attitudes
        if attitudes is not None:
            # The end of the stretch knows the angular velocity best, and nothing changed it before.
            since = time - float(self._record.times[stretch.end - 1])
            return object_state(mean, spread, attitudes[stretch.end - 1].after(since))
        spin = self._angular_velocity(stretch, mean[3:], spread[3:, 3:], settings)
        return object_state(mean, spread, spin)

    def _angular_velocity(
        self,
        stretch: Stretch,
        velocity: NDArray[np.float64],
        covariance: NDArray[np.float64],
        settings: PerceptionSettings,
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Angular velocity of a ball that rolls on a plane for a while; else unknown."""
        lasted = self._record.times[stretch.end - 1] - self._record.times[stretch.start]
        if stretch.plane is None or lasted < ROLLING_TIME:
            return unknown_angular_velocity(settings.angular_velocity_deviation)
        return rolling_angular_velocity(
            velocity,
            covariance,
            self._record.object.shape.bounding_radius,
            stretch.plane.normal,
            settings.angular_velocity_deviation,
        )

    def _next(self, first: int) -> Stretch | None:
        """The first stretch that begins at point `first` or later."""
        if self._stretches and self._stretches[-1].goes_on:
            before = self._stretches[-1]
            further = self._grown(first, before.acceleration)
            if further.end - first >= MIN_POINTS:
                return self._stretch(first, further, before.plane, before.acceleration)
        for start in range(first, len(self._record.times) - MIN_POINTS + 1):
            sure = [
                (grown, plane, acceleration)
                for plane, acceleration in self._accelerations(start)
                if (grown := self._sure_growth(start, plane, acceleration)) is not None
            ]
            if sure:
                stretch = self._from_its_release(
                    first, start, *max(sure, key=lambda candidate: candidate[0].end)
                )
                if self._is_evident(stretch, TOUCHING_EVIDENCE):
                    return stretch
        return None

    def _from_its_release(
        self,
        first: int,
        start: int,
        grown: _Growth,
        plane: Plane | None,
        acceleration: NDArray[np.float64],
    ) -> Stretch:
        """The stretch from the point at which all else ceased to move the object.

        The end may move with the beginning, so both are improved in turn until they stay.
        """
        times = self._path.times
        earliest = int(np.searchsorted(times, times[start] - HAND_MEMORY))
        for _ in range(RELEASE_ITERATIONS):
            part = slice(max(first, earliest), grown.end)
            start = part.start + release_point(
                self._path[part], acceleration, comes_into_view=part.start == 0
            )
            further = self._grown(start, acceleration)
            if further.end <= grown.end:
                break
            grown = further
        return self._stretch(start, grown, plane, acceleration)

    def _stretch(
        self, start: int, grown: _Growth, plane: Plane | None, acceleration: NDArray[np.float64]
    ) -> Stretch:
        mean, covariance = fitted_motion(self._path[start : grown.end], acceleration)
        covariance[:3, :3] += self._record.bias
        return Stretch(
            start=start,
            end=grown.end,
            time=float(self._path.times[start]),
            mean=mean,
            covariance=covariance,
            acceleration=acceleration,
            plane=plane,
            goes_on=grown.expected is None,
        )

    def _accelerations(self, start: int) -> list[tuple[Plane | None, NDArray[np.float64]]]:
        """Flight; and rolling, of a solid sliding, where it touches surfaces, with the first that
        carries it."""
        noise = float(np.sqrt(np.trace(self._record.covariance_at(start))))
        height = _height(self._record, start, self._environment)
        # A place that is less sure than the object is high says nothing of what it touches.
        touched = noise < height and surfaces_of(self._environment).supporting(
            self._record.positions[start], height, TOUCH_SIGMAS * noise + TOUCH_SLACK
        )
        candidates: list[tuple[Plane | None, NDArray[np.float64]]] = [
            (None, self._environment.gravity)
        ]
        if touched:
            inertia = ROLLING_INERTIA if self._record.attitudes is None else None
            gravity = self._environment.gravity
            candidates.append((touched[0], supported_acceleration(gravity, touched, inertia)))
        return candidates

    def _grown(self, start: int, acceleration: NDArray[np.float64]) -> _Growth:
        """Grow a stretch from `start` until a point shows a contact or it is long enough."""
        times = self._record.times
        stop = int(np.searchsorted(times, times[start] + MAX_DURATION, side="right"))
        if stop - start < MIN_POINTS:
            return _Growth(start, None)
        count, expected = grown_count(self._path[start:stop], acceleration)
        if expected is None:
            return _Growth(start + count, None)
        # The bounce may have begun before the point that shows it.
        kept = count - 1 if count > MIN_POINTS + 1 else count
        return _Growth(start + kept, expected, start + count)

    def _sure_growth(
        self, start: int, plane: Plane | None, acceleration: NDArray[np.float64]
    ) -> _Growth | None:
        """The stretch from `start`; None where the points may as well have moved otherwise."""
        grown = self._grown(start, acceleration)
        if grown.end - start < MIN_POINTS:
            return None
        touches = plane is not None or (
            grown.expected is not None and self._touches(grown.contact, grown.expected)
        )
        needed = TOUCHING_EVIDENCE if touches else SURE_EVIDENCE
        stretch = self._stretch(start, grown, plane, acceleration)
        return grown if self._is_evident(stretch, needed) else None

    def _is_evident(self, stretch: Stretch, needed: float) -> bool:
        """Whether its points are evidence of free motion.

        Those of a flight must show its acceleration, too: where a plane ends it, no evidence would
        do as well, and three points in 22 ms, or a scatter about the edge of a hand, are none.
        """
        points, acceleration = self._path[stretch.start : stretch.end], stretch.acceleration
        if stretch.plane is None and not shows_acceleration(points):
            return False
        return free_evidence(points, acceleration) > needed

    def _touches(self, k: int, position: NDArray[np.float64]) -> bool:
        """Whether a ball expected at `position` at point k would have met a plane by then."""
        reach = self._record.object.shape.bounding_radius + TOUCH_SLACK
        reach += TOUCH_SIGMAS * float(np.sqrt(np.trace(self._record.covariance_at(k))))
        return surfaces_of(self._environment).touches(position, reach)


def _height(record: Record, k: int, environment: Environment) -> float:
    """Height, m, of the centre above the lowest point, at point k."""
    if record.attitudes is None:
        return record.object.shape.bounding_radius
    return record.attitudes[k].reach(downward(environment))
