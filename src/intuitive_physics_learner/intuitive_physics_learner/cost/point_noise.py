"""The noise of observed points: its covariance, its size for each track, errors that points share.

An observed position is the true one plus an error of its own, with the covariance C of its point
times a factor s² of its track, plus one error that all points of the object share. C is what the
detections carry; where an observation has none, it is the identity and s a length.

The factor is found without a model of the motion: free flight and uniform motion vanish in the
third differences of a track (`path_differences`), and the noise is left with its own variance. The
median of their lengths passes over contacts and outliers. A track of few points says little of its
noise, so its variance is averaged with that of all tracks.

Differences of a track that was smoothed say nothing of its error. White noise has a correlation of
-3/4 between neighbouring differences, which therefore have the same sign with the probability
½ - arcsin(¾) / π = 0.23; those of a smooth curve have it as often as not or more. A smoothed track
without detections is taken to be known no better than the initial state that came with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from intuitive_physics.geometry.path_differences import difference_weights, path_differences
from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.state import POSITION
from intuitive_physics.trajectory import Trajectory

SMALLEST_NOISE = 1e-4
"""Smallest noise of an observed position or of a residual, m: no camera measures better, and what
is divided by it stays well conditioned."""

POOLED_DIFFERENCES = 20.0
"""Differences as which the noise of all tracks counts beside a track's own: the median of as many
has a relative error of a quarter."""

MEDIAN_LENGTH_3 = 1.5381722544550522
"""Median of the length of three independent standard normal components: √(median of χ²₃)."""

SAME_SIGN_SHARE = 0.5 - np.arcsin(0.75) / np.pi
"""Share of neighbouring third differences of white noise that have the same sign."""


def detected(observation: Observation) -> Observation:
    """Return the observation with each track as it was detected, before any smoothing.

    Objects without detections keep their trajectory.
    """
    objects = tuple(
        replace(track, trajectory=Trajectory(track.detections.times, track.detections.positions))
        if track.detections is not None
        else track
        for track in observation.objects
    )
    return replace(observation, objects=objects)


@dataclass(frozen=True, eq=False)
class TrackNoise:
    """The noise of one object's track.

    Parameters
    ----------
    whitening : (n, 3, 3) 1/m, which makes the error of each point standard normal
    shared : (3, 3) m, symmetric root of the covariance of the error that all points share: a row
        for each of three independent amounts of unit variance. 0 where there is none.
    """

    whitening: NDArray[np.float64]
    shared: NDArray[np.float64]


def track_noises(observations: Sequence[Observation]) -> list[list[TrackNoise]]:
    """Find the noise of each object of each observation."""
    tracks = [track for observation in observations for track in observation.objects]
    units = [_unit_whitening(track) for track in tracks]
    lengths = [_difference_lengths(track, unit) for track, unit in zip(tracks, units, strict=True)]
    variances = _track_variances(tracks, lengths)
    noises = iter(
        _track_noise(track, unit, variance)
        for track, unit, variance in zip(tracks, units, variances, strict=True)
    )
    return [[next(noises) for _ in observation.objects] for observation in observations]


def position_noise(observations: Sequence[Observation]) -> float:
    """Estimate the standard deviation in m of an observed position on each axis, one for all."""
    lengths = [
        _difference_lengths(track, np.broadcast_to(np.eye(3), (len(track.trajectory.times), 3, 3)))
        for observation in observations
        for track in observation.objects
    ]
    return float(np.fmax(_pooled_noise(lengths), SMALLEST_NOISE))


def _detections_of(track: ObservedObject) -> Detections | None:
    """Return the detections where the trajectory is made of them, as by `detected`."""
    detections = track.detections
    if detections is None or not np.array_equal(detections.times, track.trajectory.times):
        return None
    return detections


def _unit_whitening(track: ObservedObject) -> NDArray[np.float64]:
    """Whitening (n, 3, 3) by the covariances C = L Lᵀ of the detections, L⁻¹; 1 without these."""
    count = len(track.trajectory.times)
    detections = _detections_of(track)
    if detections is None:
        return np.broadcast_to(np.eye(3), (count, 3, 3))
    return np.asarray(np.linalg.inv(np.linalg.cholesky(detections.covariances)))


def _differences(track: ObservedObject) -> NDArray[np.float64]:
    """Third differences (n - 3, 3) in m, normed so that they have the variance of the noise."""
    path = track.trajectory
    return path_differences(path.positions, difference_weights(path.times, 3))


def _is_smoothed(track: ObservedObject) -> bool:
    """Whether signs of differences are nearer to those of a smooth curve than to white noise's."""
    signs = np.sign(_differences(track))
    if len(signs) < 2:
        return False
    same = float(np.mean(signs[1:] * signs[:-1] > 0.0))
    return same > 0.5 * (SAME_SIGN_SHARE + 0.5)


def _difference_lengths(
    track: ObservedObject, whitening: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Lengths (n - 3,) of third differences, in the inverse unit of the whitening (n, 3, 3)."""
    differences = _differences(track)
    # Neighbours are seen alike, so the covariance of one stands for all four.
    middle = whitening[1 : len(differences) + 1]
    return np.asarray(np.linalg.norm(np.einsum("nij,nj->ni", middle, differences), axis=1))


def _pooled_noise(lengths: Sequence[NDArray[np.float64]]) -> float:
    """Standard deviation on each axis by the lengths of all tracks; NaN where there are none."""
    pooled = np.concatenate([*lengths, np.empty(0)])
    return float(np.median(pooled)) / MEDIAN_LENGTH_3 if pooled.size else np.nan


def _track_variances(
    tracks: Sequence[ObservedObject], lengths: Sequence[NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Variance (n_tracks,) of whitened errors; NaN where no track of that kind has differences."""
    variances = np.full(len(tracks), np.nan)
    has_detections = np.array([_detections_of(track) is not None for track in tracks])
    for kind in (False, True):
        members = np.flatnonzero(has_detections == kind).tolist()
        common = _pooled_noise([lengths[i] for i in members]) ** 2
        for i in members:
            count = lengths[i].size
            single = _pooled_noise([lengths[i]]) ** 2 if count else common
            total = count * single + POOLED_DIFFERENCES * common
            variances[i] = total / (count + POOLED_DIFFERENCES)
    return variances


def _track_noise(track: ObservedObject, unit: NDArray[np.float64], variance: float) -> TrackNoise:
    detections = _detections_of(track)
    if detections is None:
        state = np.trace(track.initial_state.covariance[POSITION, POSITION]) / 3.0
        smoothed = state if _is_smoothed(track) else 0.0
        length = np.sqrt(np.nanmax([variance, smoothed, SMALLEST_NOISE**2]))
        return TrackNoise(unit / length, np.zeros((3, 3)))
    factor = np.sqrt(1.0 if np.isnan(variance) else variance)
    values, axes = np.linalg.eigh(detections.bias)
    shared = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    # No component of an error is smaller than the smallest noise.
    left, scales, right = np.linalg.svd(unit / max(factor, np.finfo(float).tiny))
    return TrackNoise((left * np.minimum(scales, 1.0 / SMALLEST_NOISE)[:, None]) @ right, shared)
