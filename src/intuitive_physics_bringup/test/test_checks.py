"""Launch arguments that cannot be are refused with one sentence that says what can."""

from __future__ import annotations

import pytest

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_bringup.checks import (
    BAG_SUFFIXES,
    METADATA_FILE,
    RATES,
    check_bag,
    check_names,
    check_parameter_file,
    check_rate,
)
from intuitive_physics_recordings import bag_reader
from intuitive_physics_recordings.nodes import replay_node

GOOD = "ros__parameters: {seed: 1}"


def refusal(check, *arguments) -> str:
    with pytest.raises(InvalidInputError) as error:
        check(*arguments)
    text = str(error.value)
    assert "\n" not in text
    return text


def test_bags_and_rates_are_those_of_the_replay():
    ranges = {one.name: one.range for one in replay_node.PARAMETERS}
    assert ranges["rate"] == RATES
    assert bag_reader.STORAGE_SUFFIXES == BAG_SUFFIXES
    assert bag_reader.METADATA_FILE == METADATA_FILE


@pytest.mark.parametrize("text", ["-1", "0", "nan", "inf", "-inf", "101", "1e999", "", "fast"])
def test_a_rate_that_cannot_be_is_refused(text):
    expected = f"rate is {text!r}; expected a number from 0.01 to 100"
    assert refusal(check_rate, text) == expected


@pytest.mark.parametrize("text", ["0.01", "1", "2.5", "1e2"])
def test_a_rate_that_can_be_is_taken(text):
    check_rate(text)


def test_bags_are_folders_with_metadata_or_files_that_end_as_bags_do(tmp_path):
    folder, file, other = tmp_path / "monday", tmp_path / "monday.mcap", tmp_path / "monday.txt"
    folder.mkdir()
    other.touch()
    assert "a folder without metadata.yaml; expected the folder" in refusal(check_bag, str(folder))
    for path in (file, other):
        assert "expected the path of a bag, its folder or a file" in refusal(check_bag, str(path))
    (folder / METADATA_FILE).touch()
    file.touch()
    for path in (folder, file, ""):
        check_bag(str(path))


@pytest.mark.parametrize(
    ("key", "prefix", "expected"),
    [
        ("/**/predictor_nod", "", "/**/predictor_node or /predictor_node"),
        ("/**/predictor_nod", "/left", "/**/predictor_node or /left/predictor_node"),
        ("predictor_node", "/left", "/**/predictor_node or /left/predictor_node"),
        ("/right/learner_node", "/left", "/**/learner_node or /left/learner_node"),
        ("/*/learner_node", "/left/arm", "/**/learner_node or /left/arm/learner_node"),
        ("perceptoin", "", "/**/perception_node or /perception_node"),
        ("/camera", "", "/**, or /**/ and one of perception_node, learner_node, predictor_node"),
    ],
)
def test_a_key_that_is_no_node_is_refused_with_the_nearest(tmp_path, key, prefix, expected):
    path = tmp_path / "mine.yaml"
    path.write_text(f"/**:\n  {GOOD}\n{key}:\n  {GOOD}\n")
    text = refusal(check_parameter_file, str(path), prefix)
    assert text.endswith(f"has the key {key}, which is none of the nodes; expected {expected}")


@pytest.mark.parametrize(
    ("key", "prefix"),
    [
        ("/**", ""),
        ("/**", "/left/arm"),
        ("/**/learner_node", ""),
        ("/**/learner_node", "/left/arm"),
        ("/*/learner_node", "/left"),
        ("/left/*", "/left"),
        ("learner_node", ""),
        ("/learner_node", ""),
        ("/left/arm/learner_node", "/left/arm"),
        ("left/learner_node", "/left"),
    ],
)
def test_keys_of_nodes_are_taken(tmp_path, key, prefix):
    path = tmp_path / "mine.yaml"
    path.write_text(f"{key}:\n  {GOOD}\n")
    check_parameter_file(str(path), prefix)


def test_namespaces_may_be_levels_of_the_file(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(f"left:\n  learner_node:\n    {GOOD}\n  predictor_nod:\n    {GOOD}\n")
    text = refusal(check_parameter_file, str(path), "/left")
    assert "the key left/predictor_nod, which" in text
    path.write_text(f"left:\n  learner_node:\n    {GOOD}\n")
    check_parameter_file(str(path), "/left")


@pytest.mark.parametrize(
    ("text", "complaint"),
    [("a: [1", "cannot be read"), ("just words", "expected names of nodes"), ("a: 1", "key a,")],
)
def test_invalid_parameter_file_is_refused(tmp_path, text, complaint):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    assert complaint in refusal(check_parameter_file, str(path), "")


ARGUMENTS = ("camera", "camera_info", "bag", "params_file")


@pytest.mark.parametrize(
    ("word", "expected"),
    [
        ("cammera:=zed", "expected camera;"),
        ("xyzzy:=1", "expected one of camera, camera_info"),
    ],
)
def test_an_argument_that_the_launch_file_does_not_have_is_refused(word, expected):
    words = ["/usr/bin/ros2", "launch", "intuitive_physics_bringup", "suite.launch.py"]
    with pytest.raises(InvalidInputError, match=expected):
        check_names([*words, "bag:=throws", word], "suite.launch.py", ARGUMENTS)
    check_names([*words, "bag:=a:=b", "--debug"], "suite.launch.py", ARGUMENTS)


def test_arguments_of_a_launch_file_that_includes_it_are_taken():
    words = ["/usr/bin/ros2", "launch", "/home/me/robot.launch.py", "arm:=left"]
    check_names(words, "suite.launch.py", ARGUMENTS)
