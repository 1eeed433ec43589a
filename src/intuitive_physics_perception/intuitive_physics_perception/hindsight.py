"""Balls in the newest frames of a sensor that were first detected only later."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from intuitive_physics_perception.detection.detections import DetectedSphere
from intuitive_physics_perception.detection.fitted_sphere import EXPECTED_REACH
from intuitive_physics_perception.detection.foreground import Clusters
from intuitive_physics_perception.detection.frame_budget import FrameBudget
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.frame import Frame
from intuitive_physics_perception.stages import Stages
from intuitive_physics_perception.tracking.motion import POSITION
from intuitive_physics_perception.tracking.track import Track
from intuitive_physics_perception.tracking.tracker import ExpectedBefore, Tracker

HINDSIGHT = 0.2
"""s for which frames are kept, to search them for a ball before it was first detected: 50 to 80 ms
pass after the release before the ball is apart from the hand all round its outline."""

HINDSIGHT_FRAMES = 2
"""Old frames that are searched in each new one, which bounds its time."""

READING_STEPS = 4
"""Steps from when a ball is read to where it was then, and back: a scan that is four times as fast
as a ball leaves 1/256 of the first error."""


@dataclass(frozen=True, eq=False)
class RecentFrame:
    """A frame in which what is found only later was there already.

    Parameters
    ----------
    frame : of one sensor
    clusters : of what is new in it
    shown : when, s, the tracks that were seen in it were read, by their numbers
    """

    frame: Frame
    clusters: Clusters
    shown: Mapping[int, float] = field(default_factory=dict)


class Hindsight:
    """The newest frames of one sensor from one place, and how far back each track was searched in
    them.

    Beside the hand that releases it a ball is not yet an object of its own, but it is found where
    it must have been.
    """

    def __init__(self) -> None:
        self._recent: deque[RecentFrame] = deque()
        # Of each track's number, down to which frame, s, they were searched for it.
        self._searched_until: dict[int, float] = {}

    def forget(self) -> None:
        """Forget all frames: the sensor has moved, or time has gone back."""
        self._recent.clear()
        self._searched_until.clear()

    def keep(self, recent: RecentFrame) -> None:
        """Keep the newest frame, in which has been tracked."""
        self._recent.append(recent)
        while self._recent[0].frame.time < recent.frame.time - HINDSIGHT:
            self._recent.popleft()

    def search(self, tracker: Tracker, stages: Stages, budget: FrameBudget) -> None:
        """Search a few frames for each ball where it was not seen, and one where the budget of the
        newest frame is spent.

        `stages`: as the sensor sees what it looks for.
        """
        for track in tracker.tracks:
            for _ in range(1 if budget.is_spent else HINDSIGHT_FRAMES):
                if track.earlier is not None and not self._search_next(track, tracker, stages):
                    tracker.take_earlier(track)
        searched = {track.number for track in tracker.tracks if track.earlier is not None}
        self._searched_until = {
            number: until for number, until in self._searched_until.items() if number in searched
        }

    def before(self, time: float, track: Track, tracker: Tracker) -> RecentFrame | None:
        """Return the newest frame before a time, s, in which a track was not seen where it must
        have been, None where none is kept."""
        for recent in reversed(self._recent):
            if recent.frame.time >= time:
                continue
            seen_at = recent.shown.get(track.number)
            if seen_at is None or not tracker.was_there(track, seen_at):
                return recent
        return None

    def _search_next(self, track: Track, tracker: Tracker, stages: Stages) -> bool:
        """Search the next older frame for a track; False where it can be expected in none."""
        recent = self.before(self._searched_until.get(track.number, np.inf), track, tracker)
        if recent is None or track.earlier is None:
            return False
        frame, model = recent.frame, stages.model
        time, expected = _expected_in(frame, track, tracker, model)
        if expected is None and time < track.detections[0][0]:
            return False
        self._searched_until[track.number] = frame.time
        if expected is None:
            return True
        start = expected.start.seen_from(model)
        detected = stages.spheres.find_expected(frame.points, recent.clusters, start)
        if detected is not None:
            placed = detected.moved(model.rotation, model.translation)
            detection = replace(placed, delay=_delay_of(frame, detected))
            if tracker.is_same(track, detection, expected):
                found = frame.time + detection.delay, detection
                tracker.add_earlier(track, *found, recent.shown.get(track.number))
        return True


def _expected_in(
    frame: Frame, track: Track, tracker: Tracker, model: EnvironmentModel
) -> tuple[float, ExpectedBefore | None]:
    """When, s, a frame must have shown a track, and where it was expected then: a sensor reads each
    place at a time of its own."""
    later = track.seen_after(frame.time)
    place = later[0][1].center if later else track.mean[POSITION]
    time, expected = frame.time + frame.delay_towards(model.to_sensor(place)), None
    for _ in range(READING_STEPS if frame.offsets is not None else 1):
        expected = tracker.expected_before(track, time)
        if expected is None:
            break
        time = frame.time + frame.delay_towards(model.to_sensor(expected.start.sphere[:3]))
    return time, expected


def _delay_of(frame: Frame, sphere: DetectedSphere) -> float:
    """Mean time, s, after that of a frame, of the readings on a sphere in the sensor's frame."""
    if frame.offsets is None:
        return 0.0
    away = np.linalg.norm(frame.points - sphere.center.astype(np.float32), axis=2)
    readings = np.flatnonzero(away < EXPECTED_REACH * sphere.radius)
    return frame.delay_of(readings) if readings.size else frame.delay_towards(sphere.center)
