"""Whether a sensor stands still: by its pose, or by what it reads where the pose is not known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.environment_model import MIN_POINTS, EnvironmentModel
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.ray_planes import PlaneAgreement, RayPlanes
from intuitive_physics_perception.settings import PerceptionSettings

VIEW_DISTANCE = 2.0
"""Distance, m, at which a turn of the sensor counts as a shift. Our choice: objects that are
perceived well are about as far."""

STANDING_TIME = 1.0
"""Time for which a sensor stays where it is, as far as noise shows, until it stands, s: one that
drives at 5 cm/s has gone too far for that by then, and a frame is too short to tell."""

MIN_VISIBLE = 0.1
"""Part of the readings, relative to the first frames, that nothing may hide: with fewer the planes
cannot be checked."""

MOVED_TIME = 0.5
"""s for which too few readings lie on the planes until the sensor counts as moved."""

COVERED_TIME = 2.0
"""s for which nearly all is hidden until the sensor counts as moved."""

CHECKED_POINTS = 1200
"""Points of each frame, evenly over it, that are compared with the planes: bounds the time."""


class AwayClock:
    """For how long frames have not shown a sensor where it was."""

    def __init__(self) -> None:
        self._since: float | None = None

    def take(self, time: float, *, is_away: bool) -> None:
        """Take the next frame's time, s, and whether it does not show the sensor there."""
        if not is_away:
            self._since = None
        elif self._since is None or time < self._since:
            self._since = time

    def lasting(self, time: float) -> float:
        """Return for how long, s, up to a `time` in s."""
        return 0.0 if self._since is None else time - self._since

    def has_moved(self, time: float, *, is_covered: bool) -> bool:
        """Return whether that is so long that the sensor counts as moved.

        `time` in s; `is_covered`: whether something hides nearly all.
        """
        return self.lasting(time) >= (COVERED_TIME if is_covered else MOVED_TIME)


def is_same_view(way: RigidTransform, noise: RangeNoise) -> bool:
    """Return whether a sensor has moved by less than what its readings' noise hides."""
    shift, angle = RigidTransform().difference(way)
    return bool(shift + VIEW_DISTANCE * angle < noise.deviation(VIEW_DISTANCE))


class FramesFromOnePlace:
    """The newest frames of a sensor from where it is now, to model the environment from.

    `settings`: noise that is assumed, and how many frames are kept.

    Attributes
    ----------
    frames : (height, width, 3) m each
    """

    def __init__(self, settings: PerceptionSettings) -> None:
        self._noise = RangeNoise.from_settings(settings)
        self._most = settings.environment_frames
        self.forget()

    def forget(self) -> None:
        """Begin again with the next frame."""
        self.frames: list[NDArray[np.float32]] = []
        self._taken = 0
        self._since = np.inf
        self._place: RigidTransform | None = None

    def take(self, points: NDArray[np.float32], time: float, pose: RigidTransform | None) -> None:
        """Take a frame, and leave out those from where the sensor was before it moved.

        `points` (height, width, 3) m; `time` in s; `pose`: of the sensor, None where it is not
        known to move.
        """
        if not (self.frames and self._is_here(pose)):
            self.frames, self._since, self._place = [], time, pose
        self.frames.append(points)
        del self.frames[: -self._most]
        self._taken += 1

    @property
    def are_enough(self) -> bool:
        """Whether as many have been taken as a model needs, though the sensor may have moved."""
        return self._taken >= self._most

    def stands(self, time: float) -> bool:
        """Return whether the sensor stands, and there are enough frames from here.

        `time` in s, of the last frame.
        """
        return len(self.frames) == self._most and time - self._since >= STANDING_TIME

    def _is_here(self, pose: RigidTransform | None) -> bool:
        if pose is None or self._place is None:
            return True
        return is_same_view(self._place.inverse.after(pose), self._noise)


class EnvironmentCheck:
    """Compares how much of each frame lies on the modelled planes with how much did at first.

    What moves through the view hides a part of it and says nothing about the planes. What has gone
    shows something else behind it, while the rest of the view is as it was. A sensor that was
    moved, if only by half a degree, sees most planes elsewhere. A sensor that slides along its only
    plane, or turns about that plane's normal, sees no change: this is not noticed.
    """

    def __init__(
        self, model: EnvironmentModel, settings: PerceptionSettings, *, revised: bool = False
    ) -> None:
        self._model = model
        self._settings = settings
        self._planes = RayPlanes(model.detected, model.noise, settings)
        self._revised = revised
        self._away = AwayClock()

    def moved(self, points: NDArray[np.float32], time: float) -> str:
        """Say in a sentence that the sensor was moved; empty while it was not.

        `points` (height, width, 3) m in the sensor's frame, NaN where nothing was read; `time` in
        s.
        """
        if not self._model.detected:
            return ""
        now, was = self._agreement(points), self._model.agreement
        least = self._settings.moved_fraction
        covered = now.visible < MIN_VISIBLE * was.visible
        fraction = now.explained / max(was.explained, 1e-9)
        # With the support in its place, the sensor has its height and tilt: other changes came or
        # went, which a revision finds.
        stands = not covered and (
            fraction >= least or (self._revised and now.support >= least * was.support)
        )
        is_away = not stands and least > 0.0
        self._away.take(time, is_away=is_away)
        if not is_away or not self._away.has_moved(time, is_covered=covered):
            return ""
        lasting = self._away.lasting(time)
        if covered:
            return (
                f"for {lasting:.1f} s something before all planes has hidden them; the sensor was "
                "moved or covered: they are modelled again"
            )
        return (
            f"for {lasting:.1f} s {fraction:.0%} of the readings that should lie on the planes do; "
            "the sensor was moved: they are modelled again"
        )

    def _agreement(self, points: NDArray[np.float32]) -> PlaneAgreement:
        """Agreement of some readings, evenly over a frame, with the planes."""
        height, width = points.shape[:2]
        stride = max(1, int(np.sqrt(height * width / CHECKED_POINTS)))
        chosen = points[::stride, ::stride] if height > 1 else points[:, :: stride * stride]
        agreement = self._planes.agreement(np.ascontiguousarray(chosen).reshape(-1, 3))
        return agreement if agreement.readings >= MIN_POINTS else self._model.agreement
