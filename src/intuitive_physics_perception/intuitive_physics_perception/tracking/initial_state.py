"""The initial state θ_d of an observed ball: least squares over a stretch without a contact."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.scene import Environment, Plane, SceneObject
from intuitive_physics.state import (
    ANGULAR_VELOCITY,
    ERROR_SIZE,
    LINEAR_VELOCITY,
    POSITION,
    ObjectState,
)
from intuitive_physics_perception.settings import PerceptionSettings
from intuitive_physics_perception.tracking.attitude import Attitude, with_attitude
from intuitive_physics_perception.tracking.motion import (
    downward,
    supported_acceleration,
    supporting_planes,
)
from intuitive_physics_perception.tracking.rolling import (
    rolling_angular_velocity,
    unknown_angular_velocity,
)
from intuitive_physics_perception.tracking.settings import InitialStateSettings


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


def state_at(
    record: Record, time: float, environment: Environment, settings: PerceptionSettings
) -> ObjectState | None:
    """Estimate a ball's state at `time` from the longest stretch about it that gravity explains.

    A stretch is flight, or sliding on the planes that the ball touches; it ends where the next
    point contradicts it, the first sign of a bounce. Position and velocity come from weighted least
    squares with the acceleration known; their covariance grows with the misfit.

    Returns
    -------
    None where no stretch of at least three points holds `time`.
    """
    first = int(np.searchsorted(record.times, time - 1e-9))
    fit = settings.initial_state
    best: _Stretch | None = None
    for start in range(max(first - fit.points_before, 0), min(first + 1, len(record.times))):
        for plane, acceleration in _accelerations(record, start, environment, fit):
            stretch = _longest_stretch(record, start, time, acceleration, plane, environment, fit)
            if (
                stretch is not None
                and record.times[stretch.end - 1] >= time
                and (best is None or stretch.end - stretch.start > best.end - best.start)
            ):
                best = stretch
    if best is None:
        return None
    covariance = np.zeros((ERROR_SIZE, ERROR_SIZE))
    covariance[POSITION, POSITION] = best.covariance[:3, :3]
    covariance[POSITION, LINEAR_VELOCITY] = best.covariance[:3, 3:]
    covariance[LINEAR_VELOCITY, POSITION] = best.covariance[3:, :3]
    covariance[LINEAR_VELOCITY, LINEAR_VELOCITY] = best.covariance[3:, 3:]
    if record.attitudes is not None:
        # The end of the stretch knows the angular velocity best, and nothing changed it before.
        last = record.attitudes[best.end - 1].after(
            time - float(record.times[best.end - 1]), settings.motion.angular_acceleration_noise
        )
        return with_attitude(best.mean[:3], best.mean[3:], covariance, last)
    angular_velocity, angular_covariance = _angular_velocity(record, best, settings)
    covariance[ANGULAR_VELOCITY, ANGULAR_VELOCITY] = angular_covariance
    return ObjectState(
        best.mean[:3],
        linear_velocity=best.mean[3:],
        angular_velocity=angular_velocity,
        covariance=covariance,
    )


def _angular_velocity(
    record: Record, stretch: _Stretch, settings: PerceptionSettings
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Angular velocity of a ball that keeps its speed on a plane, where it rolls; else unknown."""
    lasted = record.times[stretch.end - 1] - record.times[stretch.start]
    if stretch.plane is None or lasted < settings.motion.rolling_time:
        return unknown_angular_velocity(settings.angular_velocity_deviation)
    return rolling_angular_velocity(
        stretch.mean[3:],
        stretch.covariance[3:, 3:],
        record.object.shape.bounding_radius,
        stretch.plane.normal,
        settings.angular_velocity_deviation,
        settings.motion.rolling_slip,
    )


@dataclass(frozen=True, eq=False)
class _Stretch:
    """Points start to end (exclusive), (position, velocity) at the time asked for, and the plane
    that carried the ball; None in flight."""

    start: int
    end: int
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    plane: Plane | None


def _accelerations(
    record: Record, start: int, environment: Environment, fit: InitialStateSettings
) -> list[tuple[Plane | None, NDArray[np.float64]]]:
    """Flight, and sliding where the ball touches planes; with the first plane that carries it."""
    noise = float(np.sqrt(np.trace(record.covariance_at(start))))
    touched = supporting_planes(
        environment,
        record.positions[start],
        _height(record, start, environment),
        fit.touch_sigmas * noise + fit.touch_slack,
    )
    found: list[tuple[Plane | None, NDArray[np.float64]]] = [(None, environment.gravity)]
    if touched:
        found.append((touched[0], supported_acceleration(environment, touched)))
    return found


def _height(record: Record, k: int, environment: Environment) -> float:
    """m of the centre above the lowest point, at point k."""
    if record.attitudes is None:
        return record.object.shape.bounding_radius
    return record.attitudes[k].reach(downward(environment))


def _chosen(
    attitudes: tuple[Attitude, ...] | None, which: NDArray[np.bool_]
) -> tuple[Attitude, ...] | None:
    if attitudes is None:
        return None
    return tuple(attitudes[k] for k in np.flatnonzero(which))


def _longest_stretch(
    record: Record,
    start: int,
    time: float,
    acceleration: NDArray[np.float64],
    plane: Plane | None,
    environment: Environment,
    fit: InitialStateSettings,
) -> _Stretch | None:
    """Grow a stretch from `start` until a point shows a contact or it is long enough.

    A few points obey gravity by chance, as in a hand; they count only where a plane ends them.
    """
    information, right, squares = np.zeros((6, 6)), np.zeros(6), 0.0
    grown: list[_Stretch] = []
    stop = min(len(record.times), start + fit.max_points)
    for k in range(start, stop):
        t = record.times[k] - time
        if record.times[k] - record.times[start] > fit.max_duration:
            break
        # x(t) = x₀ + v₀ t + a t² / 2, linear in x₀ and v₀ once the last term is taken off.
        row = np.hstack([np.eye(3), t * np.eye(3)])
        seen = record.positions[k] - 0.5 * t * t * acceleration
        alone = record.covariance_at(k)
        weight = np.linalg.inv(alone)
        if grown:
            spread = row @ grown[-1].covariance @ row.T + alone
            surprise = seen - row @ grown[-1].mean
            if surprise @ np.linalg.solve(spread, surprise) > fit.contact_gate:
                expected = row @ grown[-1].mean + 0.5 * t * t * acceleration
                if k - start < fit.sure_points and not _touches(
                    record, k, expected, environment, fit
                ):
                    return None
                # The bounce may have begun before the point that shows it.
                return grown[-2] if len(grown) > 2 else grown[-1]
        information += row.T @ weight @ row
        right += row.T @ weight @ seen
        squares += float(seen @ weight @ seen)
        count = k + 1 - start
        if count < fit.min_points:
            continue
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        mean = covariance @ right
        freedom = 3 * count - 6
        misfit = max(squares - float(right @ mean), 0.0) / freedom
        # χ² has the mean `freedom` and the variance 2 `freedom`.
        if misfit > 1.0 + fit.misfit_sigmas * np.sqrt(2.0 / freedom):
            return grown[-1] if grown else None
        grown.append(_Stretch(start, k + 1, mean, covariance * max(misfit, 1.0), plane))
    return grown[-1] if grown else None


def _touches(
    record: Record,
    k: int,
    position: NDArray[np.float64],
    environment: Environment,
    fit: InitialStateSettings,
) -> bool:
    """Whether a ball expected at `position` at point k would have met a plane by then."""
    reach = record.object.shape.bounding_radius + fit.touch_slack
    reach += fit.touch_sigmas * float(np.sqrt(np.trace(record.covariance_at(k))))
    return any(plane.signed_distances(position) < reach for plane in environment.planes)
