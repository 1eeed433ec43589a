"""When messages and clock ticks are played, on a clock that only the test moves."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_recordings.bag_reader import BagMessage, BagReader
from intuitive_physics_recordings.bag_writing import offered_qos
from intuitive_physics_recordings.replay import CLOCK_RATE, Replay, ReplaySettings

START = 10**18
PERIOD = 0.04
COUNT = 25


@pytest.fixture(scope="module")
def bag_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """25 messages, 40 ms apart, on /number, and one latched message on /map at the start."""
    path = tmp_path_factory.mktemp("replay") / "bag"
    typestore = get_typestore(Stores.ROS2_JAZZY)
    number = typestore.types["std_msgs/msg/Int32"]
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        numbers = writer.add_connection("/number", number.__msgtype__, typestore=typestore)
        latched = [offered_qos(1, transient_local=True)]
        maps = writer.add_connection(
            "/map", number.__msgtype__, typestore=typestore, offered_qos_profiles=latched
        )
        writer.write(maps, START, typestore.serialize_cdr(number(data=7), number.__msgtype__))
        for i in range(COUNT):
            data = typestore.serialize_cdr(number(data=i), number.__msgtype__)
            writer.write(numbers, START + i * 40_000_000, data)
    return path


class Stage:
    """A clock that waiting moves, and a record of what was played when."""

    def __init__(self) -> None:
        self.time = 100.0
        self.played: list[tuple[float, BagMessage]] = []
        self.ticks: list[tuple[float, int]] = []
        self.stop_at = float("inf")

    def now(self) -> float:
        return self.time

    def wait(self, seconds: float) -> bool:
        self.time += seconds
        return self.time >= self.stop_at

    def play(self, path: Path, how: ReplaySettings, *, clock: bool = True) -> bool:
        with BagReader(path) as bag:
            return Replay(
                bag,
                ["/number", "/map"],
                how,
                lambda message: self.played.append((self.time, message)),
                (lambda time: self.ticks.append((self.time, time))) if clock else None,
                now=self.now,
                wait=self.wait,
            ).run()

    def numbers(self) -> list[tuple[float, BagMessage]]:
        return [(time, message) for time, message in self.played if message.topic == "/number"]


@pytest.mark.parametrize("rate", [0.5, 1.0, 4.0])
def test_messages_keep_their_distances_at_any_rate(bag_path: Path, rate: float) -> None:
    stage = Stage()
    assert stage.play(bag_path, ReplaySettings(rate=rate))
    times = [time for time, _ in stage.numbers()]
    assert times == pytest.approx([100.0 + i * PERIOD / rate for i in range(COUNT)], abs=1e-6)


@pytest.mark.parametrize("rate", [0.5, 1.0, 10.0])
def test_clock_has_bag_time_at_most_a_hundred_times_a_second(bag_path: Path, rate: float) -> None:
    stage = Stage()
    stage.play(bag_path, ReplaySettings(rate=rate))
    for wall, bag in stage.ticks:
        assert (bag - START) * 1e-9 == pytest.approx((wall - 100.0) * rate, abs=1e-5)
    bag_times = [bag for _, bag in stage.ticks]
    assert bag_times == sorted(bag_times)
    length = (COUNT - 1) * PERIOD / rate
    assert 0.7 * length * CLOCK_RATE <= len(stage.ticks) <= length * CLOCK_RATE + 1


def test_without_clock_there_is_none(bag_path: Path) -> None:
    stage = Stage()
    stage.play(bag_path, ReplaySettings(), clock=False)
    assert not stage.ticks
    assert len(stage.numbers()) == COUNT


def test_the_start_offset_skips_but_what_was_latched_comes_first(bag_path: Path) -> None:
    stage = Stage()
    stage.play(bag_path, ReplaySettings(start_offset=0.5))
    assert stage.played[0][1].topic == "/map"
    assert stage.played[0][0] == 100.0
    first_time, first = stage.numbers()[0]
    assert first.time == START + 13 * 40_000_000
    assert first_time == pytest.approx(100.0 + 13 * PERIOD - 0.5, abs=1e-6)


def test_looping_plays_again_until_stopped(bag_path: Path) -> None:
    stage = Stage()
    stage.stop_at = 100.0 + 2.5 * (COUNT - 1) * PERIOD
    assert stage.play(bag_path, ReplaySettings(loop=True)) is False
    assert 2 * COUNT < len(stage.numbers()) < 3 * COUNT


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rate=st.floats(max_value=0.0) | st.just(float("nan")), offset=st.floats(max_value=-1e-9))
def test_senseless_settings_are_refused(rate: float, offset: float) -> None:
    with pytest.raises(InvalidInputError):
        ReplaySettings(rate=rate)
    with pytest.raises(InvalidInputError):
        ReplaySettings(start_offset=offset)


def test_an_offset_beyond_the_end_is_refused(bag_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="expected an offset within"):
        Stage().play(bag_path, ReplaySettings(start_offset=2.0))
