"""Which object of this frame is which of the last one, and a filter for each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment
from intuitive_physics_perception.detection.detection import Detection, kind_of
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.association import (
    MOST_FOR_COLOR,
    cheapest_pairs,
    color_cost,
)
from intuitive_physics_perception.tracking.capsule_ends import is_in_capsule
from intuitive_physics_perception.tracking.motion import POSITION
from intuitive_physics_perception.tracking.recognition import settle
from intuitive_physics_perception.tracking.track import Track
from intuitive_physics_perception.tracking.track_filter import GATE, TrackFilter, innovation_of

SMALLEST_LOG_DETERMINANT = -80.0
RADIUS_GATE = 4.0
RADIUS_SLACK = 0.003
TENTATIVE_MISSES = 1


class Tracker:
    """Follows the objects of one environment from frame to frame.

    Parameters
    ----------
    environment : what the objects bounce off
    first_number : number of the first track, so that numbers stay unique over restarts
    """

    def __init__(
        self, environment: Environment, settings: PerceptionSettings, first_number: int = 1
    ) -> None:
        self.next_number = first_number
        self._settings = settings
        self._filter = TrackFilter(environment, settings)
        self._tracks: list[Track] = []

    @property
    def tracks(self) -> list[Track]:
        """Tracks that are alive and were seen often enough to be an object."""
        return [track for track in self._tracks if track.confirmed]

    def update(self, time: float, detections: Sequence[Detection]) -> list[Track]:
        """Take what a frame shows, in the environment's frame; return tracks that ended.

        Parameters
        ----------
        time : s, later than that of the frame before
        """
        ended = [track for track in self._tracks if self._is_lost(track, time)]
        self._tracks = [track for track in self._tracks if not self._is_lost(track, time)]
        for track in self._tracks:
            self._filter.predict(track, time)
        seen = self._matches(detections)
        for track in self._tracks:
            detection = seen.get(track.number)
            if detection is None:
                track.misses += 1
            else:
                self._filter.correct(track, detection)
                track.take_color(detection.color)
                settle(track, self._settings)
            track.close_step(detection)
            track.resting = track.resting or self._has_come_to_rest(track)
        taken = [id(detection) for detection in seen.values()]
        self._tracks += [
            self._new_track(time, detection)
            for detection in detections
            if id(detection) not in taken and not self._is_end_of_capsule(detection)
        ]
        self._tracks = [track for track in self._tracks if not self._was_no_ball(track)]
        return [track for track in ended if track.confirmed]

    def _matches(self, detections: Sequence[Detection]) -> dict[int, Detection]:
        """Pair numbers of tracks and detections: by what is likely, then by what a hit or a hand
        could explain. Colour has a say in what is likely, never in what is possible."""
        likely = np.full((len(self._tracks), len(detections)), np.inf)
        possible = likely.copy()
        for k, track in enumerate(self._tracks):
            for n, detection in enumerate(detections):
                if kind_of(detection) != track.kind:
                    continue
                innovation, spread = innovation_of(track, detection)
                unlike = color_cost(track.color, detection.color)
                distance2 = float(innovation @ np.linalg.solve(spread, innovation)) + unlike
                if distance2 < GATE:
                    # As the likelihood has it: a wide guess must not win by its width.
                    width = float(np.linalg.slogdet(spread)[1]) - SMALLEST_LOG_DETERMINANT
                    likely[k, n] = distance2 + max(width, 0.0)
                away, reach = float(np.linalg.norm(innovation[:3])), self._reach(track, spread)
                slack = RADIUS_GATE * np.sqrt(spread[3, 3]) + RADIUS_SLACK
                if away < reach and abs(innovation[3]) < slack:
                    # Another colour is worse than any place where it could be.
                    possible[k, n] = away + reach * unlike / MOST_FOR_COLOR
        pairs = cheapest_pairs(likely)
        for k, n in pairs:
            possible[k, :] = possible[:, n] = np.inf
        pairs += cheapest_pairs(possible)
        return {self._tracks[k].number: detections[n] for k, n in pairs}

    def _reach(self, track: Track, spread: NDArray[np.float64]) -> float:
        """m from where a track is expected within which it can be."""
        duration = track.time - track.last_seen
        spread_of_place = 3.0 * float(np.sqrt(np.trace(spread[:3, :3])))
        return self._settings.max_speed * duration + spread_of_place

    def _has_come_to_rest(self, track: Track) -> bool:
        """Whether it stayed, within noise and `rest_speed`, where it was for `rest_time`."""
        settings = self._settings
        recent = [step for step in track.recent(settings.rest_time) if step.seen is not None]
        if len(recent) < 4 or recent[-1].time - recent[0].time < 0.7 * settings.rest_time:
            return False
        detections = [step.seen for step in recent if step.seen is not None]
        places = np.stack([detection.center for detection in detections])
        noise = np.sqrt(max(np.trace(detection.covariance[:3, :3]) for detection in detections))
        away = np.linalg.norm(places - places.mean(axis=0), axis=1).max()
        return bool(away < 0.5 * settings.rest_speed * settings.rest_time + 2.0 * noise)

    def _is_lost(self, track: Track, time: float) -> bool:
        if not track.confirmed:
            return track.misses > TENTATIVE_MISSES
        return time - track.last_seen > self._settings.coast_time

    def _is_end_of_capsule(self, detection: Detection) -> bool:
        return kind_of(detection) == "sphere" and is_in_capsule(detection.center, self.tracks)

    def _was_no_ball(self, track: Track) -> bool:
        """Whether it was the end of a capsule, whose side has been seen long enough to be sure:
        then nothing is learned from it."""
        return (
            track.kind == "sphere"
            and track.misses >= self._settings.confirming_hits
            and is_in_capsule(track.mean[POSITION], self.tracks)
        )

    def _new_track(self, time: float, detection: Detection) -> Track:
        track = self._filter.begin(self.next_number, time, detection)
        track.take_color(detection.color)
        settle(track, self._settings)
        track.close_step(detection)
        self.next_number += 1
        return track
