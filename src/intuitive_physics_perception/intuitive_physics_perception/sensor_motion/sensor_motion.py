"""Where a sensor is whose pose nobody gives, frame after frame, by the view that was modelled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.frames.change_of_frame import RigidTransform
from intuitive_physics_perception.environment.environment_model import EnvironmentModel
from intuitive_physics_perception.environment.noise import RangeNoise
from intuitive_physics_perception.environment.standing import AwayClock, is_same_view
from intuitive_physics_perception.sensor_motion.comparison import Comparison, compare
from intuitive_physics_perception.sensor_motion.landmarks import Landmarks, landmarks_of
from intuitive_physics_perception.sensor_motion.motion_fit import (
    fit_motion,
    motions_in_words,
    undetermined,
)
from intuitive_physics_perception.settings import PerceptionSettings

SIGNIFICANT = 38.3
"""χ² of a motion against none from which on a sensor has moved: noise exceeds it once in a million
frames, nine hours at 30 Hz (six degrees of freedom)."""

MOST_HIDDEN = 0.9
"""Part of the landmarks in view that something may hide: with more nothing can be said."""

WIDE_GATE = 0.1
"""m up to which residuals count where something may have moved by more than noise."""

ASSUMED_FRAMES = 2.0
"""Frames that the assumed deviation of an edge counts as, beside those in which it is measured."""


class SensorMotion:
    """Follows a sensor by the landmarks of the view from which its environment was modelled.

    It stays where it was last until a frame shows significantly that it has moved, so that a sensor
    that stands where the environment was modelled does not jitter, and what moves in front of it
    does not move it. Elsewhere errors of the landmarks are significant too, and the pose of each
    frame is its own, some 2 mm off.

    Parameters
    ----------
    landmarks : of the view
    frames : (height, width, 3) m each, in which nothing has moved: they show the noise of landmarks
    model : of the environment in the same view
    settings : of perception

    Attributes
    ----------
    way : from the sensor's frame to that of the view, as it was last known; none where noise at 2 m
        hides it
    doubt : why it is not known in the newest frame, part of a sentence; empty where it is
    unseen : motions that this view does not show, in words; empty where it shows all
    """

    def __init__(
        self,
        landmarks: Landmarks,
        frames: Sequence[NDArray[np.float32]],
        model: EnvironmentModel,
        settings: PerceptionSettings,
    ) -> None:
        self._noise, self._axes = model.noise, model.rotation
        self._least_share = settings.moved_fraction
        self._landmarks, self._scale = _at_rest(landmarks, frames, model.noise)
        self.restart()
        at_rest = compare(frames[-1], self._landmarks, self.way, self._noise, self._scale)
        self.unseen = self._in_words(at_rest.determined())

    def restart(self) -> None:
        """Begin again where the environment was modelled, as when time goes back."""
        self.way, self.doubt = RigidTransform(), ""
        self._guess, self._is_covered = self.way, False
        self._lost = AwayClock()

    def follow(self, points: NDArray[np.float32], time: float) -> None:
        """Find where the sensor is.

        `points` (height, width, 3) m of a frame, NaN where nothing was read; `time` in s.
        """
        self.doubt = self._follow(points)
        self._lost.take(time, is_away=bool(self.doubt))

    @property
    def is_at_home(self) -> bool:
        """Whether the sensor is where the environment was modelled, as far as noise shows."""
        return is_same_view(self.way, self._noise)

    def lost_for(self, time: float) -> float:
        """Return since how long, s, it is not known where the sensor is, at a `time` in s."""
        return self._lost.lasting(time)

    def is_lost(self, time: float) -> bool:
        """Return whether that lasts so long that the environment has to be modelled again."""
        return self._lost.has_moved(time, is_covered=self._is_covered)

    def fit(self, points: NDArray[np.float32]) -> tuple[Comparison, str]:
        """Return a frame compared from where it alone shows the sensor, near where it was last, and
        why that cannot be relied on, empty where it can.

        `points` (height, width, 3) m, NaN where nothing was read.
        """
        return fit_motion(
            points, self._landmarks, self._guess, self._noise, self._scale, self._least_share
        )

    def _follow(self, points: NDArray[np.float32]) -> str:
        """Find where the sensor is; return why that is not possible, empty where it is."""
        self._is_covered = False
        still = compare(points, self._landmarks, self.way, self._noise, self._scale)
        # What moves by itself counts only while the sensor moves.
        if not self._has_moved(points, still, of_all=not self.is_at_home):
            self._guess = self.way
            return ""
        self._is_covered = still.hidden > MOST_HIDDEN
        if self._is_covered:
            return "something hides nearly all that was modelled"
        fit, doubt = self.fit(points)
        if doubt:
            return "" if self._is_back(points) else doubt
        self._guess = fit.way
        if is_same_view(fit.way, self._noise):
            self.way = RigidTransform()
            return ""
        if words := self._in_words(fit.determined()):
            return f"what is seen does not determine {words}"
        self.way = fit.way
        return ""

    def _is_back(self, points: NDArray[np.float32]) -> bool:
        """Whether a sensor that has moved is where the environment was modelled, and take that."""
        there = compare(points, self._landmarks, RigidTransform(), self._noise, self._scale)
        if self._has_moved(points, there, of_all=True):
            return False
        self.way = self._guess = RigidTransform()
        return True

    def _has_moved(self, points: NDArray[np.float32], still: Comparison, *, of_all: bool) -> bool:
        """Whether a frame may show a motion against where it was compared from."""
        if still.share < self._least_share or still.significance(of_all=of_all) > SIGNIFICANT:
            return True
        # What has moved by more than noise counts in this one alone.
        wide = compare(points, self._landmarks, still.way, self._noise, self._scale, WIDE_GATE)
        return wide.significance(of_all=of_all) > SIGNIFICANT

    def _in_words(self, information: NDArray[np.float64]) -> str:
        """Motions that information (6, 6) in 1/m² leaves open."""
        return motions_in_words(undetermined(information, self._noise), self._axes)


def sensor_motion_in(
    fused: NDArray[np.float32],
    frames: Sequence[NDArray[np.float32]],
    model: EnvironmentModel,
    settings: PerceptionSettings,
) -> SensorMotion | None:
    """Return what follows a sensor by a view; None where that is not possible or not asked for.

    `fused` (height, width, 3) m: the medians of `frames` (height, width, 3) m each, from which the
    environment was modelled.
    """
    if settings.moved_fraction == 0.0:
        return None
    landmarks = landmarks_of(fused, len(frames), model, settings)
    return None if landmarks is None else SensorMotion(landmarks, frames, model, settings)


def _at_rest(
    landmarks: Landmarks, frames: Sequence[NDArray[np.float32]], noise: RangeNoise
) -> tuple[Landmarks, float]:
    """Landmarks where single frames (height, width, 3) m of a sensor at rest show them on average,
    and the scale of all residuals there; a plane is known better than a frame shows its patches."""
    here = RigidTransform()
    seen = [compare(frame, landmarks, here, noise, gate=WIDE_GATE) for frame in frames]
    residuals = np.stack([one.residuals for one in seen])
    counts = np.isfinite(residuals).sum(axis=0)
    means = np.nansum(residuals, axis=0) / np.maximum(counts, 1)
    edges, planes = landmarks.is_edge, landmarks.is_on_plane
    # Of an edge the errors are measured, of a patch those of a reading are known.
    squares = np.nansum(np.square(residuals - means), axis=0)
    freedom = np.maximum(counts - 1, 0) + ASSUMED_FRAMES
    of_edge = (squares + ASSUMED_FRAMES * landmarks.variances) / freedom
    of_reading = np.max([one.variances for one in seen], axis=0) - landmarks.variances
    shares = 1.0 / np.maximum(counts, 1)
    variances = np.where(edges, of_edge * (1.0 + shares), of_reading * shares)
    placed = replace(
        landmarks,
        places=landmarks.places + np.where(planes, 0.0, means)[:, None] * landmarks.normals,
        variances=np.where(planes, landmarks.variances, variances),
    )
    kept = placed.chosen(planes | (2 * counts >= len(frames)))
    scale = float(np.median([compare(frame, kept, here, noise).residual_scale for frame in frames]))
    return kept, max(scale, 1.0) if np.isfinite(scale) else 1.0
