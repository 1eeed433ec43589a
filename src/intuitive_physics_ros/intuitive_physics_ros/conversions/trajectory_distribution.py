"""`TrajectoryDistribution` messages and the arrays of a predicted distribution."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from intuitive_physics_msgs.msg import PredictedTrajectory
from intuitive_physics_msgs.msg import TrajectoryDistribution as TrajectoryDistributionMessage
from numpy.typing import ArrayLike, NDArray
from std_msgs.msg import Header

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.messages.fields import flat_array, float32_field, in_field
from intuitive_physics.validation import increasing_times

ROWS, COLUMNS = np.triu_indices(3)
"""Elements of a covariance in the order of the message: xx, xy, xz, yy, yz, zz."""


@dataclass(frozen=True, eq=False)
class DistributionFields:
    """What a message says of a distribution; received numbers have the precision of float32.

    Parameters
    ----------
    frame_id : of everything below
    stamp : time that `times` count from
    states_stamp : when the states were seen that it was made from
    object_ids : n_objects names
    times : (n_times,) s after `stamp`
    positions : (n_samples, n_objects, n_times, 3) m; NaN from where on a sample went astray
    weights : (n_samples,), summing to one
    simulated_count : samples that mean and covariance are of; `positions` may hold but a part
    mean : (n_objects, n_times, 3) m
    covariance : (n_objects, n_times, 3, 3) m²
    static_parameters_version, environment_version : what it was made from
    seed : of the noise
    computation_time : s
    """

    frame_id: str
    stamp: Time
    states_stamp: Time
    object_ids: tuple[str, ...]
    times: NDArray[np.float64]
    positions: NDArray[np.float64]
    weights: NDArray[np.float64]
    simulated_count: int
    mean: NDArray[np.float64]
    covariance: NDArray[np.float64]
    static_parameters_version: int
    environment_version: int
    seed: int
    computation_time: float


class DistributionWriter:
    """Writes distributions into one message after another, in the same memory while they fit.

    A message of 500 samples holds 3 MB, which setting its fields would copy three times, each time
    into memory that is new. What `write` answered is overwritten by the next call, so publish it
    before.
    """

    def __init__(self) -> None:
        self._room = _Room(0, 0, 0)

    def write(self, fields: DistributionFields) -> TrajectoryDistributionMessage:
        """Return a distribution as a message.

        Raises
        ------
        InvalidInputError
            When the shapes of the arrays do not fit together.
        """
        shape = (np.size(fields.weights), len(fields.object_ids), np.size(fields.times))
        n_samples, n_objects, n_times = shape
        samples = _shaped(fields.positions, "positions", (n_samples, n_objects, n_times, 3))
        means = _shaped(fields.mean, "mean", (n_objects, n_times, 3))
        covariances = _shaped(fields.covariance, "covariance", (n_objects, n_times, 3, 3))
        if shape != self._room.shape:
            self._room = _Room(*shape)
        room, message = self._room, self._room.message
        message.header = Header(stamp=fields.stamp, frame_id=fields.frame_id)
        message.states_stamp = fields.states_stamp
        message.simulated_count = fields.simulated_count
        room.times[...] = fields.times
        room.weights[...] = fields.weights
        for i, predicted in enumerate(message.objects):
            predicted.object_id = fields.object_ids[i]
            room.means[i][...] = means[i]
            room.covariances[i][...] = covariances[i][:, ROWS, COLUMNS]
            room.samples[i][...] = samples[:, i]
        message.static_parameters_version = fields.static_parameters_version
        message.environment_version = fields.environment_version
        message.seed = fields.seed
        message.computation_time = float(fields.computation_time)
        return message


def trajectory_distribution_to_message(fields: DistributionFields) -> TrajectoryDistributionMessage:
    """Return a distribution as a message of its own, as `DistributionWriter.write` does."""
    return DistributionWriter().write(fields)


def trajectory_distribution_from_message(
    message: TrajectoryDistributionMessage,
) -> DistributionFields:
    """Return the distribution that a message carries.

    Raises
    ------
    InvalidInputError
        When a list has another length than the times, samples and objects ask for, or holds
        numbers that are not finite.
    """
    n_samples, n_times, n_objects = message.sample_count, len(message.times), len(message.objects)
    with in_field("times"):
        times = increasing_times(message.times, "list")
    with in_field("weights"):
        weights = flat_array(message.weights, (n_samples,))
    mean = np.empty((n_objects, n_times, 3))
    covariance = np.empty((n_objects, n_times, 3, 3))
    positions = np.empty((n_samples, n_objects, n_times, 3))
    for i, predicted in enumerate(message.objects):
        with in_field(f"objects[{i}].mean"):
            mean[i] = flat_array(predicted.mean, (n_times, 3))
        with in_field(f"objects[{i}].covariance"):
            triangle = flat_array(predicted.covariance, (n_times, 6))
        covariance[i][:, ROWS, COLUMNS] = covariance[i][:, COLUMNS, ROWS] = triangle
        with in_field(f"objects[{i}].samples"):
            positions[:, i] = flat_array(predicted.samples, (n_samples, n_times, 3))
    return DistributionFields(
        frame_id=message.header.frame_id,
        stamp=message.header.stamp,
        states_stamp=message.states_stamp,
        object_ids=tuple(predicted.object_id for predicted in message.objects),
        times=times,
        positions=positions,
        weights=weights,
        simulated_count=message.simulated_count,
        mean=mean,
        covariance=covariance,
        static_parameters_version=message.static_parameters_version,
        environment_version=message.environment_version,
        seed=message.seed,
        computation_time=message.computation_time,
    )


def _shaped(values: ArrayLike, name: str, shape: tuple[int, ...]) -> NDArray[Any]:
    array = np.asarray(values)
    if array.shape != shape:
        raise InvalidInputError(f"{name} has shape {array.shape}; expected {shape}")
    return array


class _Room:
    """A message whose lists have the lengths they need, and its lists as arrays."""

    def __init__(self, n_samples: int, n_objects: int, n_times: int) -> None:
        self.shape = (n_samples, n_objects, n_times)
        self.message = TrajectoryDistributionMessage(
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
        self.times = _as_array(self.message.times, n_times)
        self.weights = _as_array(self.message.weights, n_samples)
        self.means = [_as_array(one.mean, n_times, 3) for one in objects]
        self.covariances = [_as_array(one.covariance, n_times, ROWS.size) for one in objects]
        self.samples = [_as_array(one.samples, n_samples, n_times, 3) for one in objects]


def _as_array(field: Any, *shape: int) -> NDArray[np.float32]:
    """Return a `float32[]` field as an array that shares its memory."""
    if math.prod(shape) == 0:
        return np.empty(shape, dtype=np.float32)
    return np.frombuffer(field, dtype=np.float32).reshape(shape)
