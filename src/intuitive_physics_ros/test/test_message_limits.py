"""Messages that are too large are refused before anything is made in proportion to them."""

from __future__ import annotations

import tracemalloc

import pytest
from intuitive_physics_msgs.msg import (
    Environment,
    ObjectState,
    Observation,
    ObservedTrajectory,
    PairCoefficients,
    StaticParameters,
    StaticPrimitive,
)

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_ros.conversions import (
    environment_from_message,
    object_states_from_messages,
    observation_from_message,
    static_parameters_from_message,
)

LITTLE = 20_000_000
"""bytes that a refusal may take at most."""


def refused(read, message):
    """The words with which a message is refused."""
    tracemalloc.start()
    try:
        with pytest.raises(InvalidInputError) as caught:
            read(message)
        assert tracemalloc.get_traced_memory()[1] < LITTLE
    finally:
        tracemalloc.stop()
    assert len(str(caught.value)) < 500
    return str(caught.value)


def test_materials_are_counted_before_their_pairs():
    message = StaticParameters(materials=[str(i) for i in range(20_000)])
    assert "materials: got 20000, expected at most 32" in refused(
        static_parameters_from_message, message
    )


def test_pairs_are_not_searched_for_where_the_materials_are_too_many():
    message = StaticParameters(
        materials=[str(i) for i in range(33)], pairs=[PairCoefficients()] * 561
    )
    assert "got 33" in refused(static_parameters_from_message, message)


def test_long_names():
    message = StaticParameters(materials=["x" * 10**6])
    assert "of 1000000 characters" in refused(static_parameters_from_message, message)
    message = Environment()
    message.header.frame_id = "x" * 10**6
    assert "of 1000000 characters" in refused(environment_from_message, message)


def test_primitives_and_corners():
    message = Environment(primitives=[StaticPrimitive()] * 1025)
    assert "planes and boxes: got 1025, expected at most 1024" in refused(
        environment_from_message, message
    )
    floor = StaticPrimitive(id="floor", kind=StaticPrimitive.PLANE, material="floor")
    floor.normal.z = 1.0

    floor.boundary = [floor.pose.position] * 1025
    assert "corners of plane floor: got 1025" in refused(
        environment_from_message, Environment(primitives=[floor])
    )


def test_objects_and_points():
    assert "objects: got 257, expected at most 256" in refused(
        object_states_from_messages, [ObjectState()] * 257
    )
    assert "objects: got 257" in refused(
        observation_from_message, Observation(objects=[ObservedTrajectory()] * 257)
    )
    many = ObservedTrajectory(times=[0.0] * 60_000)
    assert "points: got 120000, expected at most 100000" in refused(
        observation_from_message, Observation(objects=[many, many])
    )
