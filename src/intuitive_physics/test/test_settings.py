"""Fields of settings say what they are; values, options and lists come from what they say."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field, fields
from math import inf

import numpy as np
import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics.settings import (
    add_options,
    check_settings,
    choice,
    list_settings,
    number,
    numbers,
    other,
    settings_from_options,
)


@dataclass(frozen=True)
class Throw:
    speed: float = number(2.0, 0.0, 30.0, "of the ball at the start, 100 % of it", unit="m/s")
    balls: int = number(3, 1, 10, "balls thrown")
    days: int = number(1, 1, inf, "on which they are thrown")
    hand: str = choice("left", ("left", "right"), "that throws")
    spins: bool = other(True, "whether the balls spin")
    thrower: str = other("Ann", "who throws")
    heights: tuple[float, ...] = numbers((0.5, 1.0), 0.0, 3.0, "of the targets", unit="m")
    path: tuple[float, ...] = other((), "where it went")
    seen: dict = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_settings(self)


def test_fields_say_what_they_are():
    said = {one.name: one for one in list_settings(Throw)}
    assert list(said) == ["speed", "balls", "days", "hand", "spins", "thrower", "heights", "path"]
    assert said["speed"].range == (0.0, 30.0)
    assert said["speed"].meaning == "of the ball at the start, 100 % of it, m/s"
    assert said["hand"].choices == ("left", "right")
    assert [one.constraint for one in said.values()] == [
        "a number from 0 to 30 m/s",
        "a whole number from 1 to 10",
        "a whole number, at least 1",
        "one of left, right",
        "true or false",
        "a name with at least one character",
        "one or more numbers from 0 to 3 m",
        "a value",
    ]
    assert [one.name for one in said.values() if not one.is_simple] == ["heights", "path"]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed", -0.1),
        ("speed", 30.1),
        ("speed", np.nan),
        ("speed", np.inf),
        ("speed", "fast"),
        ("speed", None),
        ("balls", 0),
        ("balls", 2.5),
        ("days", 0),
        ("days", np.inf),
        ("hand", "both"),
        ("hand", None),
        ("spins", 1),
        ("thrower", ""),
        ("thrower", 3),
        ("heights", ()),
        ("heights", 1.0),
        ("heights", (1.0, 3.5)),
        ("heights", (1.0, "high")),
    ],
)
def test_what_a_field_cannot_be_is_refused_by_its_name(name, value):
    with pytest.raises(InvalidInputError, match=f"{name} is .*; expected"):
        Throw(**{name: value})


def test_a_refusal_says_got_expected_and_meaning():
    with pytest.raises(InvalidInputError) as refusal:
        Throw(balls=11)
    assert str(refusal.value) == (
        "balls is 11; expected a whole number from 1 to 10 (balls thrown)"
    )


def test_limits_belong_to_the_range_and_numbers_get_their_type():
    throw = Throw(speed=30, balls=1.0)
    assert (throw.speed, throw.balls) == (30.0, 1)
    assert (type(throw.speed), type(throw.balls)) == (float, int)
    assert Throw(balls=np.int64(4)).balls == 4


def parsed(arguments):
    parser = argparse.ArgumentParser()
    add_options(parser, Throw)
    return settings_from_options(Throw, parser.parse_args(arguments))


def test_options_make_settings():
    assert parsed([]) == Throw()
    asked = "--speed 4 --balls 2 --hand right --no-spins --thrower Bob --heights 2 1"
    assert parsed(asked.split()) == Throw(4.0, 2, 1, "right", False, "Bob", (2.0, 1.0))


def test_a_program_may_give_what_the_user_does_not():
    options = argparse.Namespace(speed=4.0, unrelated=1)
    got = settings_from_options(Throw, options, speed=3.0, balls=5, path=(1.0,))
    assert got == Throw(speed=4.0, balls=5, path=(1.0,))


def test_an_option_outside_its_range_is_refused():
    with pytest.raises(InvalidInputError, match="--speed is 31"):
        parsed(["--speed", "31"])


def test_help_tells_every_option(capsys):
    with pytest.raises(SystemExit):
        parsed(["--help"])
    shown = " ".join(capsys.readouterr().out.split())
    for one in list_settings(Throw):
        if one.is_simple:
            assert f"--{one.name}" in shown
            assert one.description in shown
    assert "a number from 0 to 30 m/s (default: 2.0)" in shown
    assert "one or more numbers from 0 to 3 m (default: 0.5 1.0)" in shown


def test_a_class_of_other_fields_has_no_settings():
    @dataclass(frozen=True)
    class Plain:
        value: int = 0

    assert list_settings(Plain) == ()
    assert len(fields(Plain)) == 1
