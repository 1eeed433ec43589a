"""Remapping rules of earlier names rename the topics of today; all else is left as it was."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from intuitive_physics_ros.topics import EARLIER_NAMES, with_earlier_remappings


@pytest.mark.parametrize(("earlier", "name"), EARLIER_NAMES.items())
@pytest.mark.parametrize("flag", ["-r", "--remap"])
@pytest.mark.parametrize("node", ["", "predictor_node:"])
def test_rules_of_earlier_names_rename_the_topics(flag, node, earlier, name) -> None:
    given_rule, rule = (f"{node}{one}:=/elsewhere" for one in (earlier, name))
    assert with_earlier_remappings(["node", "--ros-args", flag, given_rule]) == [
        "node",
        "--ros-args",
        flag,
        rule,
    ]


ARGUMENTS = st.sampled_from(
    [
        "--ros-args",
        "-r",
        "-p",
        "~/environment:=/x",
        "~/depth/image:=/y",
        "__ns:=/z",
        "rate:=2",
        ":=",
    ]
)


@given(st.lists(ARGUMENTS))
def test_only_rules_are_touched(arguments) -> None:
    translated = with_earlier_remappings(arguments)
    assert len(translated) == len(arguments)
    for before, argument, after in zip(["", *arguments], arguments, translated, strict=False):
        is_earlier = before == "-r" and argument == "~/environment:=/x"
        assert after == ("environment:=/x" if is_earlier else argument)
