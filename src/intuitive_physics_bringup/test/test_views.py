"""Topics, types and fields of messages in the layouts of RViz and Foxglove exist."""

from __future__ import annotations

import importlib
import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import pytest
import yaml
from intuitive_physics_msgs.msg import ObjectStates, StaticParameters, TrajectoryDistribution

from intuitive_physics_bringup.connections import CAMERAS, NODES
from intuitive_physics_ros.topics import OBJECT_STATES, PREDICTIONS, STATIC_PARAMETERS

PACKAGE = Path(__file__).parent.parent

LAYOUT = json.loads((PACKAGE / "foxglove" / "intuitive_physics.json").read_text(encoding="utf-8"))
PANELS = LAYOUT["configById"]

MESSAGES = {
    f"/{OBJECT_STATES}": ObjectStates,
    f"/{PREDICTIONS}": TrajectoryDistribution,
    f"/{STATIC_PARAMETERS}": StaticParameters,
}


def published() -> set[str]:
    """What the three nodes may publish, as their policies say, which are made from the code."""
    root = ElementTree.parse(PACKAGE / "security" / "policy.xml").getroot()
    found = set()
    for profile in root.iter("profile"):
        if profile.get("node") in NODES:
            for topics in profile.iter("topics"):
                if topics.get("publish") == "ALLOW":
                    names = [(topic.text or "").strip() for topic in topics]
                    found |= {name.replace("~", f"/{profile.get('node')}", 1) for name in names}
    return {name if name.startswith("/") else f"/{name}" for name in found}


def of_cameras() -> set[str]:
    return {
        f"/{topic}"
        for camera in CAMERAS.values()
        for color in (False, True)
        for topic in camera.topics(color=color).values()
    }


def test_topics_of_the_foxglove_layout_exist():
    named = set(PANELS["3D!scene"]["topics"])
    named.add(PANELS["DiagnosticSummary!nodes"]["topicToRender"])
    named.add(PANELS["RawMessages!parameters"]["topicPath"])
    image = PANELS["Image!depth"]["imageMode"]
    named |= {image["imageTopic"], image["calibrationTopic"]}
    named |= {path.partition(".")[0] for path in plotted()}
    assert named <= published() | of_cameras(), named - published() - of_cameras()
    # All that there is to be seen is there.
    assert {"/perception_node/markers", "/predictor_node/markers"} <= named


def plotted() -> list[str]:
    return [
        path["value"]
        for name, panel in PANELS.items()
        if name.startswith("Plot!")
        for path in panel["paths"]
    ]


@pytest.mark.parametrize("path", plotted())
def test_plotted_fields_are_numbers(path):
    topic, *fields = path.split(".")
    kind = MESSAGES[topic]
    definition = ""
    for field in fields:
        name = field.partition("[")[0]
        definition = kind.get_fields_and_field_types()[name]
        item = re.sub(r"^sequence<(.+)>$", r"\1", definition)
        assert (item != definition) == ("[" in field)
        if "/" in item:
            package, _, message = item.partition("/")
            kind = getattr(importlib.import_module(f"{package}.msg"), message)
    assert definition in ("double", "float", "uint32", "uint64")


def test_every_panel_of_the_layout_is_in_its_window():
    def panels(part):
        return {part} if isinstance(part, str) else panels(part["first"]) | panels(part["second"])

    assert panels(LAYOUT["layout"]) == set(PANELS)


def test_topics_of_the_rviz_layout_exist():
    rviz = yaml.safe_load((PACKAGE / "rviz" / "intuitive_physics.rviz").read_text(encoding="utf-8"))
    displays = rviz["Visualization Manager"]["Displays"]
    kinds = [display["Class"].rpartition("/")[2] for display in displays]
    assert {"TF", "PointCloud2", "MarkerArray"} <= set(kinds)
    # The launch file gives the cloud the name of the camera's.
    inputs = {"/perception_node/points"}
    for kind, display in zip(kinds, displays, strict=True):
        if "Topic" in display:
            topic = display["Topic"]["Value"]
            # Relative, so that a namespace holds its own.
            assert not topic.startswith("/")
            known = published() if kind == "MarkerArray" else inputs
            assert f"/{topic}" in known
