"""The predictor node's messages as the library's inputs, and predictions as messages."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from intuitive_physics_msgs.msg import Environment as EnvironmentMessage
from intuitive_physics_msgs.msg import ObjectStates
from intuitive_physics_msgs.msg import TrajectoryDistribution as DistributionMessage
from std_msgs.msg import Header

from intuitive_physics_predictor.live.live_prediction import LivePrediction, SeenStates
from intuitive_physics_ros.conversions import (
    DistributionFields,
    DistributionWriter,
    detections_from_messages,
    environment_from_message,
    object_states_from_messages,
    seconds_from_stamp,
    stamp_from_seconds,
)


@dataclass(frozen=True)
class Arrival:
    """When a message arrived.

    Parameters
    ----------
    stamp : s, on the node's clock
    monotonic : s, on a clock that never stops (`time.monotonic`)
    """

    stamp: float
    monotonic: float


def environment_inputs(message: EnvironmentMessage, _: Arrival) -> dict[str, Any]:
    """Return the fields of the inputs that an environment changes."""
    return {
        "environment": environment_from_message(message),
        "environment_version": message.version,
    }


def states_inputs(message: ObjectStates, arrival: Arrival) -> dict[str, Any]:
    """Return the fields of the inputs that object states change."""
    objects, states = object_states_from_messages(message.objects)
    stamp = seconds_from_stamp(message.header.stamp)
    seen = SeenStates(
        tuple(objects),
        tuple(states),
        stamp,
        arrived=arrival.monotonic,
        delay=arrival.stamp - stamp,
        frame_id=message.header.frame_id,
        detections=detections_from_messages(message, stamp),
    )
    return {"seen": seen}


def header_of(made: LivePrediction) -> Header:
    """Return the start of a prediction, and its frame."""
    return Header(stamp=stamp_from_seconds(made.start), frame_id=made.scene.environment.frame_id)


def distribution_message(
    writer: DistributionWriter, made: LivePrediction, most_samples: int | None = None
) -> DistributionMessage:
    """Write a prediction as a message with `most_samples` of its samples; default: all.

    Samples are independent of one another, so the first ones are a fair choice.
    """
    distribution, header = made.distribution, header_of(made)
    weights = distribution.weights[:most_samples]
    fields = DistributionFields(
        frame_id=header.frame_id,
        stamp=header.stamp,
        states_stamp=stamp_from_seconds(made.states_stamp),
        object_ids=distribution.object_ids,
        times=distribution.times,
        positions=distribution.positions[:most_samples],
        weights=weights / weights.sum(),
        simulated_count=distribution.weights.size,
        mean=distribution.mean,
        covariance=distribution.covariance,
        static_parameters_version=made.static_parameters_version,
        environment_version=made.environment_version,
        seed=made.seed,
        computation_time=0.0,
    )
    return writer.write(fields)
