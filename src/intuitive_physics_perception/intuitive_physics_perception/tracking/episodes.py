"""From tracks to observations: when something moves, and which parts of it are informative.

An *episode* lasts from the first motion until nothing moves any more. All balls of an observation
must have a state at its start, so an episode is cut where a ball appears: each piece is an
observation of the balls that are there at its beginning, and ends where the next one begins.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.scene import Environment
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_perception.detection.detections import (
    DetectedSolid,
    DetectedSphere,
    frame_covariance,
)
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.free_motion import FreeMotion, Record
from intuitive_physics_perception.tracking.motion import POSITION, RADIUS, lasting
from intuitive_physics_perception.tracking.track import (
    FilterStep,
    Track,
    detections_of,
    path_of,
)

FEWEST_POINTS = 6
"""Points at 30 Hz that an object needs to be part of an observation; at another rate those of the
same time, and at least three."""

PATH_WIDENING = 1.5
"""Multiple of the largest standard deviation where an object was seen, up to which its smoothed
path is part of an observation where it was not."""

RIDGE = 1e-12
"""Term added to a correlation matrix's diagonal so that it can be inverted: numerical."""


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode that is over.

    Its observations take longer to work out than a frame may, so it is kept until they are asked
    for.

    Parameters
    ----------
    tracks : all that were followed, as they were at its end
    start : s
    environment : they moved in
    """

    tracks: tuple[Track, ...]
    start: float
    environment: Environment
    settings: PerceptionSettings

    def observations(self) -> list[Observation]:
        """Smooth the tracks and return what can be learned from."""
        records = [
            record_of(track, self.settings).between(self.start, np.inf) for track in self.tracks
        ]
        return observations_of(records, self.environment, self.settings)


def observations_from(episodes: Iterable[Episode]) -> tuple[Observation, ...]:
    """Return the observations of all episodes."""
    return tuple(observation for episode in episodes for observation in episode.observations())


class EpisodeRecorder:
    """Watches tracks and knows when each episode is over."""

    def __init__(self, environment: Environment, settings: PerceptionSettings) -> None:
        self._environment = environment
        self._settings = settings
        self._start: float | None = None
        self._last_end = -np.inf
        self._ended: list[Track] = []

    def take_environment(self, environment: Environment) -> None:
        """Take a revised environment, in the same frame."""
        self._environment = environment

    def update(
        self, time: float, alive: Sequence[Track], ended: Sequence[Track]
    ) -> tuple[Episode, ...]:
        """Take the confirmed tracks of a frame and those that ended; return what is over."""
        moving = [track for track in alive if not track.resting]
        since = [track.moving_since for track in moving if track.moving_since > self._last_end]
        if self._start is None:
            if not moving:
                return ()
            self._start = min(since, default=time)
        # A ball may be found in earlier frames once it is followed.
        self._start = min([self._start, *since])
        self._ended += ended
        if moving and time - self._start < self._settings.max_duration:
            return ()
        over = self.finish(alive)
        self._last_end = time
        if moving:
            # Time is out for what still moves: a new episode begins.
            self._start = time
        return over

    def finish(self, alive: Sequence[Track]) -> tuple[Episode, ...]:
        """End the episode now and return it, where there is one."""
        if self._start is None:
            return ()
        # Tracks that are alive change with later frames.
        tracks = [*self._ended, *(replace(track, steps=track.steps.copy()) for track in alive)]
        episode = Episode(tuple(tracks), self._start, self._environment, self._settings)
        self._start, self._ended = None, []
        return (episode,)


def record_of(track: Track, settings: PerceptionSettings) -> Record:
    """Return what was seen of a track, given the radius its average found.

    A sphere's detection has a centre c and a radius r with errors e of its own (covariance F), and
    errors s that are the same in all frames (covariance S, `systematic`). The average r̄ has the
    error ē + s_r, where ē has the variance P_rr that the filter knows. Knowing the radius better
    moves the centre: c' = c + g (r̄ - r) with g = F_cr / F_rr. What remains is (e_c - g e_r) + g ē
    + s_c, for r̄ - r is free of s. The first part is independent from frame to frame, of covariance
    F_cc - F_rr g gᵀ; the others are the same in all frames. As the line of sight turns, so does g:
    its mean ḡ makes the bias P_rr ḡ ḡᵀ + S_cc, of the mean S over all frames, and what differs from
    it counts as an error of the frame, (g - ḡ) ē.

    A box's or capsule's centre is not moved: it is the middle of what the frame shows, F_cc its own
    covariance and S_cc the bias.
    """
    kind = DetectedSphere if track.attitude is None else DetectedSolid
    steps = [step for step in track.steps if isinstance(step.detection, kind)]
    seen = path_of(detections_of(steps))
    times, positions, frame_covariances = seen.times, seen.places, seen.noise
    detections = [detection for _, detection in detections_of(steps)]
    attitudes = tuple(step.attitude for step in steps if step.attitude is not None)
    covariances = np.stack([frame_covariance(detection) for detection in detections])
    bias = np.mean([detection.systematic[:3, :3] for detection in detections], axis=0)
    if not attitudes:
        gains = covariances[:, :3, 3] / covariances[:, 3, 3, None]
        off = track.mean[RADIUS] - np.array([detection.radius for detection in detections])
        positions = positions + gains * off[:, None]
        frame_covariances = frame_covariances - covariances[:, 3, 3, None, None] * _squares(gains)
        remaining = track.covariance[RADIUS, RADIUS]
        frame_covariances = frame_covariances + remaining * _squares(gains - gains.mean(axis=0))
        bias = bias + remaining * _squares(gains.mean(axis=0))
    path_times, path_positions = _path(track, times)
    return Record(
        object=track.scene_object(settings),
        times=times,
        positions=positions,
        covariances=frame_covariances,
        bias=bias,
        attitudes=attitudes or None,
        path_times=path_times,
        path_positions=path_positions,
    )


def detection_at(track: Track, time: float | None) -> Detections | None:
    """Return the detection of a track at a time, given the radius its average found.

    The centre of a sphere is moved as `record_of` does, with the gain of this frame alone. Its spin
    is that which the surface shows in this and earlier frames.

    Returns one detection in the environment's frame; None where the object was not seen then.
    `time` in s; None: it was not seen.
    """
    detection = None if time is None else track.seen_at(time)
    if time is None or detection is None:
        return None
    whole = frame_covariance(detection)
    position, covariance, bias = detection.center, whole[:3, :3], detection.systematic[:3, :3]
    if track.attitude is None:
        gain = whole[:3, 3] / whole[3, 3]
        position = position + gain * (track.mean[RADIUS] - detection.radius)
        covariance = covariance - whole[3, 3] * np.outer(gain, gain)
        bias = bias + track.covariance[RADIUS, RADIUS] * np.outer(gain, gain)
    return Detections([time], position[None], covariance[None], bias, track.seen_spin)


def _squares(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Outer products (…, 3, 3) of vectors (…, 3) with themselves."""
    return vectors[..., :, None] * vectors[..., None, :]


def _path(
    track: Track, seen_times: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Times and positions of the smoothed track, where it is known as well as where it was seen.

    A ball that was hidden in mid-air is; one that bounced meanwhile is not.
    """
    times, means, covariances = smooth(list(track.steps))
    deviations = np.sqrt(np.trace(covariances[:, POSITION, POSITION], axis1=1, axis2=2))
    is_known = np.isin(times, seen_times)
    is_known |= deviations <= PATH_WIDENING * deviations[is_known].max()
    return times[is_known], means[is_known, POSITION]


def observations_of(
    records: Sequence[Record], environment: Environment, settings: PerceptionSettings
) -> list[Observation]:
    """Cut an episode where the state of one more object is known and return the pieces one can
    learn from.

    What is never known to move freely, such as a hand that passes for a ball, cuts nothing.
    """
    known_records = []
    for record in records:
        if _is_worth(record, settings):
            free = FreeMotion(record, environment)
            states = (free.state_at(float(time), settings) for time in record.times)
            begins = (time for time, state in zip(record.times, states, strict=True) if state)
            begin = next(begins, None)
            if begin is not None:
                known_records.append(_KnownRecord(record, free, float(begin)))
    starts = sorted({item.begin for item in known_records})
    pieces = [
        _piece(known_records, start, end, environment, settings)
        for start, end in pairwise([*starts, np.inf])
    ]
    return [observation for observation in pieces if observation is not None]


@dataclass(frozen=True, eq=False)
class _KnownRecord:
    """A record, its free motion, and the first time (s) at which its state is known."""

    record: Record
    free: FreeMotion
    begin: float


def _is_worth(record: Record, settings: PerceptionSettings) -> bool:
    times = record.times
    return (
        len(times) >= 3
        and times[-1] - times[0] >= lasting(FEWEST_POINTS)
        and record.travel >= settings.min_travel
    )


def _piece(
    records: Sequence[_KnownRecord],
    start: float,
    end: float,
    environment: Environment,
    settings: PerceptionSettings,
) -> Observation | None:
    """The observation of the balls that are known at `start`, None where it would be too short.

    It begins at the first time at which the state of each is known and one of them moves: before,
    a hand may have moved them.
    """
    known_records = [item for item in records if item.begin <= start <= item.record.times[-1]]
    present = [item.record for item in known_records]
    times = np.unique(np.concatenate([record.between(start, end).times for record in present]))
    for time in times:
        parts = [record.between(time, end) for record in present]
        members = [k for k, part in enumerate(parts) if _is_worth(part, settings)]
        if not members:
            return None
        states = [known_records[k].free.state_at(time, settings) for k in members]
        known_states = [state for state in states if state is not None]
        speeds = [np.linalg.norm(state.linear_velocity) for state in known_states]
        if len(known_states) == len(members) and max(speeds) > settings.rest_speed:
            return Observation(
                environment,
                tuple(
                    ObservedObject(
                        parts[k].object,
                        Trajectory(parts[k].path_times, parts[k].path_positions),
                        state,
                        parts[k].detections,
                    )
                    for k, state in zip(members, known_states, strict=True)
                ),
                float(time),
            )
    return None


def smooth(
    steps: Sequence[FilterStep],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Go back over the steps of a filter, from the last in which something was seen.

    Returns times (n,) s, means (n, 7) of position, velocity and radius, and their covariances
    (n, 7, 7) at every frame up to that.

    Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems" (1965).
    """
    last = max(k for k, step in enumerate(steps) if step.detection is not None)
    means = np.stack([step.mean for step in steps[: last + 1]])
    covariances = np.stack([step.covariance for step in steps[: last + 1]])
    for k in range(last - 1, -1, -1):
        later = steps[k + 1].prediction
        gain = _divided(covariances[k] @ later.transition.T, later.covariance)
        means[k] += gain @ (means[k + 1] - later.mean)
        covariances[k] += gain @ (covariances[k + 1] - later.covariance) @ gain.T
    times = np.array([step.time for step in steps[: last + 1]])
    return times, means, 0.5 * (covariances + covariances.swapaxes(1, 2))


def _divided(left: NDArray[np.float64], covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return left · covariance⁻¹; metres and metres a second differ by orders, so it is scaled."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    # A radius that is known exactly makes rows nearly dependent.
    correlation = covariance / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    return np.linalg.solve(correlation, (left / scale).T).T / scale
