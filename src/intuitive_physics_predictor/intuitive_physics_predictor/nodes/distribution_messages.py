"""Predictions as `TrajectoryDistribution` messages."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from intuitive_physics_msgs.msg import PredictedTrajectory
from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from numpy.typing import NDArray
from std_msgs.msg import Header

from intuitive_physics_predictor.live.live_prediction import LivePrediction
from intuitive_physics_ros.conversions import float32_field, stamp_from_seconds

ROWS, COLUMNS = np.triu_indices(3)
"""Elements of a covariance in the order of the message: xx, xy, xz, yy, yz, zz."""


def header_of(made: LivePrediction) -> Header:
    """Return the start of a prediction, and its frame."""
    return Header(stamp=stamp_from_seconds(made.start), frame_id=made.scene.environment.frame_id)


class DistributionWriter:
    """Writes predictions into one message after another, in the same memory while they fit.

    A message of 500 samples holds 3 MB. Setting its fields would copy them three times, each time
    into new memory. The next call of `write` overwrites the message, so publish it before.
    """

    def __init__(self) -> None:
        self._buffer = _Buffer(0, 0, 0)

    def write(self, made: LivePrediction, most_samples: int | None = None) -> DistributionMessage:
        """Return a prediction as a message; its computation time is left to the caller.

        Parameters
        ----------
        most_samples : samples in the message at most; they are independent, so the first ones are
            a fair choice. Mean and covariance are of all samples
        """
        distribution = made.distribution
        weights = distribution.weights[:most_samples]
        shape = (weights.size, len(distribution.object_ids), distribution.times.size)
        if shape != self._buffer.shape:
            self._buffer = _Buffer(*shape)
        buffer, message = self._buffer, self._buffer.message
        message.header = header_of(made)
        message.states_stamp = stamp_from_seconds(made.states_stamp)
        message.simulated_count = distribution.weights.size
        buffer.times[...] = distribution.times
        buffer.weights[...] = weights / weights.sum()
        for i, trajectory in enumerate(message.objects):
            trajectory.object_id = distribution.object_ids[i]
            buffer.means[i][...] = distribution.mean[i]
            buffer.covariances[i][...] = distribution.covariance[i][:, ROWS, COLUMNS]
            buffer.samples[i][...] = distribution.positions[:most_samples, i]
        message.static_parameters_version = made.static_parameters_version
        message.environment_version = made.environment_version
        message.seed = made.seed
        message.computation_time = 0.0
        return message


class _Buffer:
    """A message with lists of the lengths needed, and these lists as arrays in the same memory."""

    def __init__(self, n_samples: int, n_objects: int, n_times: int) -> None:
        self.shape = (n_samples, n_objects, n_times)
        self.message = DistributionMessage(
            times=float32_field(np.zeros(n_times)),
            sample_count=n_samples,
            weights=float32_field(np.zeros(n_samples)),
            objects=[
                PredictedTrajectory(
                    mean=float32_field(np.zeros(3 * n_times)),
                    covariance=float32_field(np.zeros(ROWS.size * n_times)),
                    samples=float32_field(np.zeros(3 * n_samples * n_times)),
                )
                for _ in range(n_objects)
            ],
        )
        objects = self.message.objects
        self.times = _shared_array(self.message.times, n_times)
        self.weights = _shared_array(self.message.weights, n_samples)
        self.means = [_shared_array(each.mean, n_times, 3) for each in objects]
        self.covariances = [_shared_array(each.covariance, n_times, ROWS.size) for each in objects]
        self.samples = [_shared_array(each.samples, n_samples, n_times, 3) for each in objects]


def _shared_array(field: Any, *shape: int) -> NDArray[np.float32]:
    """Return a `float32[]` field as an array that shares its memory."""
    if math.prod(shape) == 0:
        return np.empty(shape, dtype=np.float32)
    return np.frombuffer(field, dtype=np.float32).reshape(shape)
