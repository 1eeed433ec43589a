"""`Detections` messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from intuitive_physics.messages.fields import flat_array, float64_field, in_field
from intuitive_physics.messages.geometry import MakeMessage
from intuitive_physics.observation import Detections, SeenSpin, symmetric_matrices, unique_numbers


def detections_to_message(
    detections: Detections | None, start_time: float, make: MakeMessage
) -> Any:
    """Return the detections of one object as a message, without times where there are none.

    Parameters
    ----------
    start_time : s, which the message counts from
    """
    made = make("intuitive_physics_msgs/msg/Detections")
    if detections is None:
        empty = float64_field(())
        return made(
            times=empty,
            positions=empty,
            covariances=empty,
            bias=np.zeros(6),
            **_spin_fields(None, start_time),
        )
    return made(
        times=float64_field(detections.times - start_time),
        positions=float64_field(detections.positions),
        covariances=float64_field(unique_numbers(detections.covariances)),
        bias=unique_numbers(detections.bias),
        **_spin_fields(detections.spin, start_time),
    )


def detections_from_message(message: Any, start_time: float) -> Detections | None:
    """Return what a message says was detected; None where it says nothing.

    Parameters
    ----------
    start_time : s, which the message counts from

    Raises
    ------
    InvalidInputError
        When an array is too short, or a number is not what it must be.
    """
    if message is None or len(message.times) == 0:
        return None
    count = len(message.times)
    with in_field("times"):
        times = flat_array(message.times, (count,)) + start_time
    with in_field("positions"):
        positions = flat_array(message.positions, (count, 3))
    with in_field("covariances"):
        covariances = symmetric_matrices(flat_array(message.covariances, (count, 6)))
    with in_field("bias"):
        bias = symmetric_matrices(flat_array(message.bias, (6,)))
    return Detections(times, positions, covariances, bias, _spin(message, start_time))


def _spin_fields(spin: SeenSpin | None, start_time: float) -> dict[str, Any]:
    if spin is None:
        empty = float64_field(())
        return {"spin": empty, "spin_covariance": empty, "spin_since": 0.0}
    return {
        "spin": float64_field(spin.mean),
        "spin_covariance": float64_field(unique_numbers(spin.covariance)),
        "spin_since": spin.since - start_time,
    }


def _spin(message: Any, start_time: float) -> SeenSpin | None:
    """Return the spin that was seen; None where none was, and of a definition without spins."""
    numbers = getattr(message, "spin", ())
    if len(numbers) == 0:
        return None
    with in_field("spin"):
        mean = flat_array(numbers, (3,))
    with in_field("spin_covariance"):
        covariance = symmetric_matrices(flat_array(message.spin_covariance, (6,)))
        return SeenSpin(mean, covariance, message.spin_since + start_time)
