"""Observations as MCAP: out and in again, and as ROS itself would write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.messages.environment import PrimitiveKind
from intuitive_physics.messages.object_states import ShapeKind
from intuitive_physics.messages.observation import observation_to_message
from intuitive_physics.observation import Detections, Observation, ObservedObject
from intuitive_physics.scene import Environment, Plane, SceneObject, StaticBox
from intuitive_physics.shapes import Box, Capsule, Shape, Sphere
from intuitive_physics.state import ERROR_SIZE, ObjectState
from intuitive_physics.trajectory import Trajectory
from intuitive_physics_recordings.bag_reader import BagReader
from intuitive_physics_recordings.bag_writing import mcap_writer
from intuitive_physics_recordings.observation_bag import (
    DEFINITIONS,
    OBSERVATION_TYPE,
    PACKAGE,
    TOPIC,
    message_maker,
    read_observation_bag,
    suite_typestore,
    write_observation_bag,
)

SHAPES: tuple[Shape, ...] = (Sphere(0.05), Box((0.1, 0.2, 0.3)), Capsule(0.04, 0.2))


def make_observation(seed: int, start: float = 1_750_000_000.123456) -> Observation:
    """Return what uses every field: three shapes, a plane with edges, a box, full covariances,
    an object without detections and two with them."""
    generator = np.random.default_rng(seed)
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    environment = Environment(
        [Plane("floor", "wood", [0, 0, 1], -0.5), Plane("table", "felt", [0, 0, 1], 0.0, corners)],
        [StaticBox("step", "stone", [1, 2, 0.1], [0, 0, 0.6, 0.8], [0.5, 0.4, 0.2])],
        [0.1, 0.0, -9.8],
        "environment",
    )
    objects = []
    for k, shape in enumerate(SHAPES):
        root, turned = generator.normal(size=(ERROR_SIZE, ERROR_SIZE)), generator.normal(size=4)
        state = ObjectState(
            generator.normal(size=3),
            turned / np.linalg.norm(turned),
            generator.normal(size=3),
            generator.normal(size=3),
            root @ root.T,
        )
        times = start + np.cumsum(generator.uniform(0.01, 0.1, 5 + k))
        trajectory = Trajectory(times, generator.normal(size=(5 + k, 3)))
        roots = generator.normal(size=(4 + k, 3, 3))
        squares = roots @ roots.swapaxes(1, 2)
        detections = Detections(
            times[: 3 + k], generator.normal(size=(3 + k, 3)), squares[1:], squares[0]
        )
        thing = SceneObject(f"{k}", "cork", shape)
        objects.append(ObservedObject(thing, trajectory, state, detections if k else None))
    return Observation(environment, tuple(objects), start, f"seen {seed}")


def numbers(value: object) -> list[float]:
    """All numbers of plain data, in order."""
    if isinstance(value, dict):
        return [number for key in sorted(value) for number in numbers(value[key])]
    if isinstance(value, list):
        return [number for one in value for number in numbers(one)]
    return [float(value)] if isinstance(value, (int, float)) else []


def assert_same(got: Observation, expected: Observation) -> None:
    """Equal to rounding; times to the nanosecond that a stamp has."""
    assert got.id == expected.id
    assert got.environment.frame_id == expected.environment.frame_id
    assert got.start_time == pytest.approx(expected.start_time, abs=1e-9)
    ours, theirs = (numbers(one.environment.to_dict()) for one in (got, expected))
    np.testing.assert_allclose(ours, theirs, rtol=1e-15, atol=1e-15)
    for mine, its in zip(got.objects, expected.objects, strict=True):
        assert mine.object == its.object
        np.testing.assert_array_equal(mine.trajectory.positions, its.trajectory.positions)
        np.testing.assert_allclose(mine.trajectory.times, its.trajectory.times, rtol=0, atol=3e-7)
        a, b = (numbers(one.initial_state.to_dict()) for one in (mine, its))
        np.testing.assert_allclose(a, b, rtol=1e-14, atol=1e-14)
        assert_same_detections(mine.detections, its.detections)


def assert_same_detections(got: Detections | None, expected: Detections | None) -> None:
    """Equal to the last bit but for the times, which are relative in a message."""
    assert (got is None) == (expected is None)
    if got is not None and expected is not None:
        np.testing.assert_allclose(got.times, expected.times, rtol=0, atol=3e-7)
        np.testing.assert_array_equal(got.positions, expected.positions)
        np.testing.assert_array_equal(got.covariances, expected.covariances)
        np.testing.assert_array_equal(got.bias, expected.bias)


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return tmp_path / "observations.mcap"


def test_reads_what_it_wrote_in_order_of_time(bag: Path) -> None:
    late, early = make_observation(0), make_observation(1, start=3.25)
    write_observation_bag([late, early], bag)
    got = read_observation_bag(bag)
    assert_same(got[0], early)
    assert_same(got[1], late)
    assert [path.name for path in bag.parent.iterdir()] == [bag.name]


def test_others_can_read_it_without_our_definitions(bag: Path) -> None:
    write_observation_bag([make_observation(0)], bag)
    with AnyReader([bag]) as reader:
        ((connection, time, data),) = reader.messages()
        message = reader.deserialize(data, connection.msgtype)
    assert (connection.topic, connection.msgtype) == (TOPIC, OBSERVATION_TYPE)
    assert time == 1_750_000_000_123_456_000
    assert message.id == "seen 0"
    assert [len(seen.times) for seen in message.objects] == [5, 6, 7]
    with BagReader(bag) as reader:
        (topic,) = reader.topics
        assert topic.latched


TRAJECTORY_WITHOUT_DETECTIONS = """
ObjectState initial_state
float64[] times
float64[] positions
"""
"""The definition of `ObservedTrajectory` before it had detections."""


def typestore_without_detections() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    types: dict[str, Any] = {}
    for path in DEFINITIONS.glob("*.msg"):
        if path.stem not in ("Detections", "ObservedTrajectory"):
            types.update(get_types_from_msg(path.read_text(), f"{PACKAGE}/{path.stem}"))
    types.update(get_types_from_msg(TRAJECTORY_WITHOUT_DETECTIONS, f"{PACKAGE}/ObservedTrajectory"))
    store.register(types)
    return store


def test_a_bag_of_the_definition_without_detections_is_read(bag: Path) -> None:
    store = typestore_without_detections()
    seen = make_observation(3)
    # It is serialised field by field as the old definition has them.
    message = observation_to_message(seen, message_maker)
    folder = bag.parent / "old"
    with mcap_writer(folder) as writer:
        connection = writer.add_connection(TOPIC, OBSERVATION_TYPE, typestore=store)
        for stamp in (1, 2):
            writer.write(connection, stamp, store.serialize_cdr(message, OBSERVATION_TYPE))
    without = [replace(one, detections=None) for one in seen.objects]
    for got in read_observation_bag(folder):
        assert_same(got, replace(seen, objects=tuple(without)))


@pytest.mark.parametrize(
    ("name", "codes"), [("Shape", ShapeKind), ("StaticPrimitive", PrimitiveKind)]
)
def test_codes_of_the_mapping_are_those_of_the_definitions(name: str, codes: type[IntEnum]) -> None:
    message_class = suite_typestore().types[f"{PACKAGE}/{name}"]
    defined = {key: value for key, value in vars(message_class).items() if key.isupper()}
    assert {code.name: code.value for code in codes} == defined


def no_change(seen: Observation) -> Observation:
    return seen


def with_drag(seen: Observation) -> Observation:
    first, *others = seen.objects
    dragged = replace(first, object=replace(first.object, drag_coefficient=0.4))
    return replace(seen, objects=(dragged, *others))


@pytest.mark.parametrize(
    ("change", "name", "message"),
    [
        (with_drag, "a.mcap", "drag or Magnus"),
        (lambda seen: make_observation(0, start=-1.0), "a.mcap", "starts at -1 s"),
        (no_change, "no/such/folder/a.mcap", "cannot write"),
    ],
)
def test_observations_that_cannot_be_written_are_refused(
    change: Callable[[Observation], Observation], name: str, message: str, tmp_path: Path
) -> None:
    with pytest.raises(InvalidInputError, match=message):
        write_observation_bag([change(make_observation(0))], tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_observation_bags_that_cannot_be_read_are_refused(bag: Path) -> None:
    write_observation_bag([make_observation(k) for k in range(20)], bag)
    whole = bag.read_bytes()
    bag.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InvalidInputError, match="cut short or damaged"):
        read_observation_bag(bag)
    write_observation_bag([], bag)
    with pytest.raises(InvalidInputError, match="has no message of the type"):
        read_observation_bag(bag)
