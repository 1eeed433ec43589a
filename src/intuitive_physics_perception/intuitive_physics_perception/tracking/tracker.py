"""Multi-object tracking: assignment of detections to tracks, recognition of known objects."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment, SceneObject
from intuitive_physics_perception.detection.detections import (
    Detection,
    frame_covariance,
    given_radius,
    kind_of,
)
from intuitive_physics_perception.detection.fitted_sphere import Start
from intuitive_physics_perception.frame import Scan
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.existence import (
    evidence_of_company,
    evidence_of_outline,
    log_odds,
)
from intuitive_physics_perception.tracking.kinds import (
    RADIUS_GATE,
    RADIUS_SLACK,
    as_part_of,
)
from intuitive_physics_perception.tracking.looking_back import earlier_place
from intuitive_physics_perception.tracking.motion import (
    GATE,
    PLACED,
    POSITION,
    RADIUS,
    VELOCITY,
    lasting,
)
from intuitive_physics_perception.tracking.motion_fits import fitted_motion
from intuitive_physics_perception.tracking.size_classes import SizeClasses
from intuitive_physics_perception.tracking.supports import surfaces_of
from intuitive_physics_perception.tracking.track import (
    INSTANT,
    FilterStep,
    Track,
    TrackFilter,
    detections_of,
    innovation_of,
    path_of,
)

COLOR_TIME = 0.116
"""Time in which a colour fades from a track's mean, as light changes, s: at 30 Hz the newest frame
has a weight of 0.25."""

COLOR_DEVIATION = 0.1
"""Standard deviation of an object's mean colour (0 to 1) from frame to frame, as light and shade
change."""

MAX_COLOR_COST = 25.0
"""Largest cost of another colour, in variances of position: a shadow costs no more than to be five
standard deviations off."""

CONFIRMING_HITS = 3
"""Detections at 30 Hz that make a track an object; at another rate those of the same time."""

COAST_TIME = 0.25
"""A track unseen for longer is closed, s."""

TENTATIVE_TIME = 0.08
"""A track that is not confirmed and unseen for longer is closed, s: at 30 Hz one frame may miss
it."""

FLIGHT_GAP = 0.01
"""Gap to every surface from which on an object is in free flight, m."""

LEAVING_GATE = 25.0
"""Squared velocity, in variances of a fit over half of `rest_time`, from which on it is no noise;
what is faster than `rest_speed` besides leaves its rest."""

RESTING_PART = 0.8
"""Part of `rest_speed` below which an object may come to rest: what has just left its rest does not
come to it for noise."""

HINDSIGHT_GATE = 16.0
"""Squared distance, in variances, up to which what was found in an earlier frame is the ball that
was expected there: as for a contact."""

LARGEST_BEND = 0.6
"""Standard deviation, in radii, of the place of a ball in an earlier frame up to which it is looked
for. Set by hand: at 30 Hz the next frame of a ball of 20 mm, at 90 Hz four frames."""

RECOGNITION_PATIENCE = 4
"""Multiple of `CONFIRMING_HITS` after which a track is confirmed though its radius does not yet
distinguish known objects."""

SMALLEST_LOG_DETERMINANT = -80.0
"""Lower bound of the logarithm of the determinant of an innovation's covariance, (4, 4) m²: costs
of pairs are not negative. A standard deviation of 0.05 mm in all four gives -79."""

KNOWN_RADIUS_DEVIATION = 1e-5
"""Standard deviation of a known radius in m: numerical, so that covariances stay regular."""


@dataclass(frozen=True, eq=False)
class ExpectedBefore:
    """A sphere that is expected in an earlier frame.

    Parameters
    ----------
    start : where it should be
    spread : (3, 3) m², of the difference between its centre and that
    """

    start: Start
    spread: NDArray[np.float64]


class Tracker:
    """Follows the objects of one environment from frame to frame.

    `first_number`: number of the first track, so that numbers stay unique over restarts;
    `identity`: the one object that is followed, where that is known; its detections are all that
    comes.
    """

    def __init__(
        self,
        environment: Environment,
        settings: PerceptionSettings,
        first_number: int = 1,
        identity: SceneObject | None = None,
    ) -> None:
        self.next_number = first_number
        self._settings = settings
        self._identity = identity
        self._environment = environment
        self._filter = TrackFilter(environment, settings)
        self._tracks: list[Track] = []
        # Of the last frame, by the identity of the detection that each took, and when that was.
        self._taken: dict[int, tuple[Track, float]] = {}
        self._prior = 0.0
        ratio = settings.material_radius_ratio
        self._sizes = SizeClasses(ratio) if ratio > 1.0 else None

    def take_environment(self, environment: Environment) -> None:
        """Take a revised environment, in the same frame; all tracks stay."""
        self._environment = environment
        self._filter = TrackFilter(environment, self._settings)

    @property
    def tracks(self) -> list[Track]:
        """Tracks that are alive and were seen often enough to be an object."""
        return [track for track in self._tracks if track.confirmed]

    @property
    def followed(self) -> list[Track]:
        """All tracks that are alive, those among them that are no object yet."""
        return list(self._tracks)

    def flies(self, track: Track, step: FilterStep) -> bool:
        """Return whether an object moves, and has touched nothing at a step of it nor since."""
        reach = float(step.mean[RADIUS]) + FLIGHT_GAP
        surfaces = surfaces_of(self._environment)
        touched = any(later.prediction.contact for later in track.after(step.time))
        return not (track.resting or touched or surfaces.touches(step.mean[POSITION], reach))

    def expected_spheres(self, time: float, scan: Scan | None = None) -> list[Start]:
        """Return each sphere that is followed, as expected in a frame.

        `time` of the frame in s, later than that of the frame before; `scan`: when its points were
        read; None where all are of that time.
        """
        self._carry_on(time)
        lasting = self._settings.exposure if scan is None else scan.duration
        middle = 0.0 if scan is None else 0.5 * scan.duration
        return [
            self._expected(
                track,
                track.mean[POSITION] + middle * track.mean[VELOCITY],
                track.mean[VELOCITY],
                lasting,
            )
            for track in self._tracks
            if track.kind == "sphere"
        ]

    def expected_before(self, track: Track, time: float) -> ExpectedBefore | None:
        """Return where a sphere must have been in a frame in which it was not seen, so that it can
        be looked for; None where it could have been anywhere.

        `time` in s.
        """
        later = track.seen_after(time)
        if track.kind != "sphere" or not later:
            return None
        before = earlier_place(later, time, self._environment.gravity)
        if before is None or before.bend > LARGEST_BEND * float(track.mean[RADIUS]):
            return None
        start = self._expected(track, before.place, before.velocity, self._settings.exposure)
        return ExpectedBefore(start, before.spread)

    def is_same(self, track: Track, detection: Detection, expected: ExpectedBefore) -> bool:
        """Return whether what was found in an earlier frame is the sphere expected there."""
        off = detection.center - expected.start.sphere[:3]
        spread = expected.spread + frame_covariance(detection)[:3, :3]
        deviation = np.sqrt(frame_covariance(detection)[3, 3] + track.covariance[RADIUS, RADIUS])
        same_size = abs(detection.radius - track.mean[RADIUS]) < RADIUS_GATE * deviation
        return bool(same_size and off @ np.linalg.solve(spread, off) < HINDSIGHT_GATE)

    def was_there(self, track: Track, time: float) -> bool:
        """Return whether a track was seen at a time and, as far as later detections determine that,
        where it must have been.

        `time` in s.
        """
        seen = track.seen_at(time)
        if seen is None:
            return False
        expected = self.expected_before(track, time)
        return expected is None or self.is_same(track, seen, expected)

    def add_earlier(
        self, track: Track, time: float, found: Detection, seen_at: float | None
    ) -> None:
        """Take what was found of a track in an earlier frame, at a time, s.

        Nothing is at two places: where it was seen elsewhere in that frame, it was another object
        until then, and all of that is dropped.

        `seen_at`: when, s, it was seen in that frame; None where it was not.
        """
        if track.earlier is None:
            return
        seen = None if seen_at is None else track.seen_at(seen_at)
        if seen_at is not None and seen is not None:
            if np.linalg.norm(seen.center - found.center) < found.radius:
                return
            track.forget_until(seen_at)
        track.earlier.append((time, found))

    def _expected(
        self,
        track: Track,
        place: NDArray[np.float64],
        velocity: NDArray[np.float64],
        lasting: float,
    ) -> Start:
        """A followed sphere as it is seen at a place (3,) m with a velocity (3,) m/s, in a frame
        that is read for `lasting` s."""
        spread = track.covariance[VELOCITY, VELOCITY]
        deviation = lasting * float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))
        radius = float(track.mean[RADIUS])
        # A swept surface shows the radius less well than the frames before did.
        known = self._settings.exposure > 0.0
        return Start(
            np.append(place, radius),
            lasting * velocity,
            deviation,
            size_is_known=known,
            is_object=track.confirmed,
        )

    def _carry_on(self, time: float) -> None:
        for track in self._tracks:
            if track.time < time:
                self._filter.predict(track, time)

    def update(
        self, time: float, detections: Sequence[Detection], camera: str = "", others: int = 0
    ) -> list[Track]:
        """Take what a frame shows, in the environment's frame; return tracks that ended.

        What was read later than at the frame's time is taken at its own, after all else. What was
        read earlier than a track was seen already, as a LiDAR does whose scan has lasted while
        frames of a camera came, is taken as if it had come then.

        `time` in s; `camera`: name of the one whose frame it is; `others`: what else is new in the
        frame.
        """
        likely = sum(evidence_of_outline(detection) > 0.0 for detection in detections)
        self._prior = evidence_of_company(likely, others)
        ended = [track for track in self._tracks if self._is_lost(track, time)]
        self._tracks = [track for track in self._tracks if not self._is_lost(track, time)]
        self._taken = {}
        for delay in sorted({0.0, *(detection.delay for detection in detections)}):
            self._take(
                time + delay,
                [detection for detection in detections if detection.delay == delay],
                camera,
            )
        self._carry_to_newest()
        for track in self._tracks:
            if track.camera == camera:
                track.missed = track.last_seen < time
        return [track for track in ended if track.confirmed]

    def _take(self, time: float, detections: Sequence[Detection], camera: str) -> None:
        """Take what was seen at one time, s."""
        self._carry_on(time)
        for track in self._tracks:
            if track.time == track.steps[-1].time and not is_after(track.time, time):
                # A step follows each, and their times increase.
                self._filter.predict(track, track.time + INSTANT)
        then = [self._at(track, time) for track in self._tracks] if detections else self._tracks
        matches = self._matches(then, detections)
        for k, (track, at_time) in enumerate(zip(self._tracks, then, strict=True)):
            n, detection = matches.get(track.number, (-1, None))
            seen_at = at_time.time
            if not is_after(track.time, time):
                self._see(track, detection, camera)
                self._follow_rest(track)
            elif detection is not None:
                track = self._tracks[k] = self._with_earlier(track, at_time, detection, camera)
            if detection is not None:
                self._taken[id(detections[n])] = track, seen_at
        taken = {n for n, _ in matches.values()}
        self._tracks += [
            self._new_track(time, detection, camera)
            for n, detection in enumerate(detections)
            if n not in taken
        ]

    def _see(self, track: Track, detection: Detection | None, camera: str) -> None:
        """Take what a camera's frame shows of a track at its time, None for nothing."""
        if detection is not None:
            unseen = track.time - track.last_seen
            if kind_of(detection) == track.kind:
                self._filter.correct(track, detection)
            else:
                self._filter.change_kind(track, detection)
            fading = unseen / COLOR_TIME
            track.take_color(detection.color, -float(np.expm1(-fading)))
            settle(track, self._settings, detection)
            self._classify(track)
            track.camera = camera
            _look_back_at_jump(track)
        track.close_step(detection)

    def _at(self, track: Track, time: float) -> Track:
        """A track at a time, s, which may be before it was seen last."""
        if not is_after(track.time, time):
            return track
        return self._filter.at_earlier(track, time) or self._filter.moved_back(track, time)

    def _with_earlier(
        self, track: Track, earlier: Track, detection: Detection, camera: str
    ) -> Track:
        """Return a track as if what was seen of it `earlier`, as it was then, had come in its turn.

        Where it does not follow from that, or would have been of another kind, it stays as it is.
        """
        before = earlier.steps[-1].time
        if before > earlier.time or kind_of(detection) != track.kind:
            return track
        since = track.after(before)
        self._see(earlier, detection, camera)
        self._filter.go_on(earlier, [(step.time, step.detection) for step in since])
        if earlier.covariance[RADIUS, RADIUS] > KNOWN_RADIUS_DEVIATION**2:
            # It was recognised since then.
            take_radius(earlier)
        earlier.surface = track.surface
        self._follow_rest(earlier)
        return earlier

    def _carry_to_newest(self) -> None:
        """Carry what began or was seen in the past on to the time of all others."""
        for track in self._tracks:
            newest = self.newest(track.time)
            if newest > track.time:
                self._filter.go_on(track, [(newest, None)])

    def newest(self, time: float) -> float:
        """Return the time, s, of all that is followed once a frame has shown it up to a time: that
        of another frame where it is later."""
        newest = max((track.time for track in self._tracks), default=time)
        return newest if is_after(newest, time) else time

    def seen_at(self, track: Track) -> float | None:
        """Return the time, s, at which the last frame showed a track; None where it did not."""
        times = (time for taken, time in self._taken.values() if taken.number == track.number)
        return max(times, default=None)

    @property
    def shown(self) -> dict[int, float]:
        """When, s, the tracks that the last frame showed were read, by their numbers."""
        return {track.number: time for track, time in self._taken.values()}

    def objects_among(self, detections: Sequence[Detection]) -> list[int]:
        """Return which detections of the last frame are of objects: those of tracks that are, and
        those that are on their own more likely objects than not."""
        taken = {key for key, (track, _) in self._taken.items() if track.confirmed}
        return [
            k
            for k, detection in enumerate(detections)
            if id(detection) in taken or evidence_of_outline(detection) > 0.0
        ]

    def take_earlier(self, track: Track) -> None:
        """Filter a track again from the earliest of what was found of it, and end the search for
        earlier ones.

        `track`: with at most as many steps as it keeps.
        """
        if track.earlier:
            detections, since = track.detections, track.steps[0].time
            first = min(time for time, _ in track.earlier)
            fresh = self._filter.before(track, first)
            if fresh is None:
                fresh = self._filter.begin(track.number, *detections[0])
                fresh.close_step(detections[0][1])
            begun = fresh.steps[-1].time
            by_time = dict(detections)
            times = sorted({*by_time, *(step.time for step in track.steps)})
            self._filter.go_on(fresh, [(time, by_time.get(time)) for time in times if time > begun])
            settle(fresh, self._settings)
            if fresh.covariance[RADIUS, RADIUS] > KNOWN_RADIUS_DEVIATION**2:
                # It was recognised since then.
                take_radius(fresh)
            track.mean, track.covariance = fresh.mean, fresh.covariance
            track.prediction, track.steps = fresh.prediction, fresh.steps
            if track.moving_since == since:
                track.moving_since = fresh.steps[0].time
        track.earlier = None

    def _matches(
        self, tracks: Sequence[Track], detections: Sequence[Detection]
    ) -> dict[int, tuple[int, Detection]]:
        """Pair numbers of tracks with detections of their time, by their index and as what they
        show of the track: by what is likely, then by what a hit or a hand could explain. Colour has
        a say in what is likely, never in what is possible."""
        likely = np.full((len(tracks), len(detections)), np.inf)
        possible = likely.copy()
        parts: dict[tuple[int, int], Detection] = {}
        doubted = lasting(CONFIRMING_HITS)
        for k, track in enumerate(tracks):
            for n, seen in enumerate(detections):
                detection = as_part_of(track, seen, doubted)
                if detection is None:
                    continue
                parts[k, n] = detection
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
                    possible[k, n] = away + reach * unlike / MAX_COLOR_COST
        pairs = cheapest_pairs(likely)
        for k, n in pairs:
            possible[k, :] = possible[:, n] = np.inf
        pairs += cheapest_pairs(possible)
        return {tracks[k].number: (n, parts[k, n]) for k, n in pairs}

    def _reach(self, track: Track, spread: NDArray[np.float64]) -> float:
        """Largest distance, m, of a track from where it is expected: what is no object yet and is
        seen farther off than it is large is something else."""
        if not track.confirmed:
            return float(track.mean[RADIUS])
        duration = abs(track.time - track.last_seen)
        spread_of_place = 3.0 * float(np.sqrt(np.trace(spread[:3, :3])))
        return self._settings.max_speed * duration + spread_of_place

    def _follow_rest(self, track: Track) -> None:
        """See whether a track comes to rest or leaves it."""
        settings = self._settings
        detections = detections_of(track.recent(0.5 * settings.rest_time))
        if len(detections) < 3 or not (track.resting or self._has_come_to_rest(track)):
            return
        path = path_of(detections)
        motion, spread = fitted_motion(path, np.zeros(3))
        velocity, covariance = motion[3:], spread[3:, 3:]
        speed = float(np.linalg.norm(velocity))
        moves = velocity @ np.linalg.solve(covariance, velocity) > LEAVING_GATE
        if not track.resting:
            slow = speed < RESTING_PART * settings.rest_speed
            track.resting = bool(slow or not moves)
        elif moves and speed > settings.rest_speed:
            track.leave_rest(float(path.times[0]), velocity, covariance)

    def _has_come_to_rest(self, track: Track) -> bool:
        """Whether it stayed, within noise and `rest_speed`, where it was for `rest_time`."""
        settings = self._settings
        detections = detections_of(track.recent(settings.rest_time))
        if len(detections) < 3 or detections[-1][0] - detections[0][0] < 0.7 * settings.rest_time:
            return False
        places = np.stack([detection.center for _, detection in detections])
        noise = np.sqrt(max(np.trace(detection.covariance[:3, :3]) for _, detection in detections))
        away = np.linalg.norm(places - places.mean(axis=0), axis=1).max()
        return bool(away < 0.5 * settings.rest_speed * settings.rest_time + 2.0 * noise)

    def _is_lost(self, track: Track, time: float) -> bool:
        unseen = time - track.last_seen
        # At a low rate the next frame may be the first that could have shown it again.
        if not track.confirmed and track.missed and unseen > TENTATIVE_TIME:
            return True
        return unseen > COAST_TIME

    def _new_track(self, time: float, detection: Detection, camera: str) -> Track:
        track = self._filter.begin(self.next_number, time, detection)
        track.identity, track.camera, track.prior = self._identity, camera, self._prior
        track.take_color(detection.color, 1.0)
        settle(track, self._settings, detection)
        self._classify(track)
        track.close_step(detection)
        self._taken[id(detection)] = track, time
        self.next_number += 1
        return track

    def _classify(self, track: Track) -> None:
        """Give a sphere that is no known object the material of its size."""
        if self._sizes is not None and track.confirmed and track.attitude is None:
            deviation = float(np.sqrt(track.radius_variance))
            track.size = self._sizes.class_of(float(track.mean[RADIUS]), deviation, track.size)


def is_after(later: float, time: float) -> bool:
    """Return whether a time (s) is after another by more than steps of one time are apart."""
    return later - time > 2.0 * INSTANT


def cheapest_pairs(costs: NDArray[np.float64]) -> list[tuple[int, int]]:
    """Return pairs (row, column): as many as can be, and of these the cheapest together.

    `costs` (n, m), not negative; inf where a pair is impossible.
    """
    from scipy.optimize import linear_sum_assignment

    possible = np.isfinite(costs)
    if not possible.any():
        return []
    # One impossible pair costs more than all possible ones, so none is chosen without need.
    impossible = 1.0 + 2.0 * min(costs.shape) * float(costs[possible].max())
    rows, columns = linear_sum_assignment(np.where(possible, costs, impossible))
    return [(int(r), int(c)) for r, c in zip(rows, columns, strict=True) if possible[r, c]]


def color_cost(first: NDArray[np.float64] | None, second: NDArray[np.float64] | None) -> float:
    """Return the squared distance of two colours in variances, at most `MAX_COLOR_COST`.

    0 where one is unknown: then position alone decides.

    `first` (3,) and `second` (3,) red, green and blue, 0 to 1.
    """
    if first is None or second is None:
        return 0.0
    distance2 = float(np.sum(np.square((first - second) / COLOR_DEVIATION)))
    return min(distance2, MAX_COLOR_COST)


def settle(track: Track, settings: PerceptionSettings, newest: Detection | None = None) -> None:
    """Call a track an object as soon as that is clear, and a known one where it is.

    `newest`: detection of it that is in no step yet.
    """
    if track.confirmed or not _is_settled(track, settings):
        return
    detections = [detection for _, detection in detections_of(track.steps)]
    if newest is not None:
        detections.append(newest)
    if track.identity is not None or track.prior + log_odds(detections) > 0.0:
        track.confirmed = True
        _recognise(track, settings)


def _is_settled(track: Track, settings: PerceptionSettings) -> bool:
    """Whether it was seen often enough, and its radius distinguishes known objects."""
    deviation = np.sqrt(track.radius_variance)
    return track.seen_time >= lasting(CONFIRMING_HITS) and (
        not settings.known_objects
        or track.attitude is not None
        or 2.0 * deviation < settings.known_object_tolerance
        or track.seen_time >= lasting(RECOGNITION_PATIENCE * CONFIRMING_HITS)
    )


def _recognise(track: Track, settings: PerceptionSettings) -> None:
    """Give the track the known object nearest in radius, whose radius then holds."""
    known_object = min(
        settings.known_objects,
        key=lambda item: abs(item.radius - track.mean[RADIUS]),
        default=None,
    )
    if known_object is None or track.attitude is not None:
        return
    tolerance = settings.known_object_tolerance
    if abs(known_object.radius - track.mean[RADIUS]) > tolerance:
        return
    track.known_object = known_object
    take_radius(track)


def _look_back_at_jump(track: Track) -> None:
    """Search earlier frames for a track again once its motion since a jump is known: the object may
    have been elsewhere before."""
    if track.earlier is not None or track.jumped is None:
        return
    if track.time - track.jumped >= lasting(CONFIRMING_HITS):
        track.earlier, track.jumped = [], None


def take_radius(track: Track) -> None:
    """Give a track the radius of the known object that it is, if it is one."""
    if track.known_object is None:
        return
    track.mean, track.covariance, track.systematic = given_radius(
        track.mean,
        track.covariance,
        track.systematic,
        PLACED,
        track.known_object.radius,
        KNOWN_RADIUS_DEVIATION,
    )
