"""The page of all nodes: topics, services, actions and parameters, from the nodes' code."""

from __future__ import annotations

import ast
import importlib
import inspect
import textwrap
from pathlib import Path
from typing import Any

from interface_pages import first_comment
from markdown_table import code, table
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from ros_endpoints import Endpoint, endpoints

from intuitive_physics_bringup import connections
from intuitive_physics_ros.lifecycle.managed_node import AUTOSTART, ManagedNode

BAG_TOPICS = "replay_node"
"""The node whose other topics are those of the bag that it plays."""


def pages(repository: Path) -> dict[str, str]:
    """Return the page by its name."""
    parts = [
        "# Nodes\n",
        "Generated from the code of the nodes. `~` stands for the node's name; names without it\n"
        "are relative to the namespace, in which nodes meet by them. The launch file connects a\n"
        "camera as said. `ros2 param describe /NODE NAME` shows a parameter on a running\n"
        "system. QoS *sensor data* is best effort, volatile, depth 5; *latched* is reliable,\n"
        "transient local, depth 1.\n",
    ]
    for path in node_files(repository):
        parts.append(_node(repository, path))
    return {"nodes.md": "\n".join(parts)}


def node_files(repository: Path) -> list[Path]:
    """Return the files of all nodes."""
    paths = (repository / "src").glob("*/*/nodes/*_node.py")
    return sorted(path for path in paths if path.parts[-3] == path.parts[-4])


def node_classes(repository: Path) -> dict[str, type[Node]]:
    """Return the class of each node by the name of its module."""
    classes = {}
    for path in node_files(repository):
        module = importlib.import_module(f"{path.parts[-3]}.nodes.{path.stem}")
        classes[path.stem] = next(
            value
            for value in vars(module).values()
            if inspect.isclass(value)
            and issubclass(value, Node)
            and value.__module__ == module.__name__
        )
    return classes


def parameters(node_class: type[Node]) -> list[Any]:
    """Return the declared parameters of a node."""
    managed = issubclass(node_class, ManagedNode)
    declaring = "super().__init__" if managed else "declare_parameters"
    tree = ast.parse(textwrap.dedent(inspect.getsource(node_class.__init__)))
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and ast.unparse(call.func) == declaring:
            names = vars(inspect.getmodule(node_class))
            declared = eval(compile(ast.Expression(call.args[1]), "<node>", "eval"), names)
            own = [AUTOSTART] if managed else []
            return list({parameter.name: parameter for parameter in [*own, *declared]}.values())
    raise LookupError(f"{node_class.__name__} declares no parameters")


def node_name(node_class: type[Node]) -> str:
    """Return the name that a node has unless it is started with another one."""
    tree = ast.parse(textwrap.dedent(inspect.getsource(node_class.__init__)))
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and ast.unparse(call.func) == "super().__init__":
            return str(ast.literal_eval(call.args[0]))
    raise LookupError(f"{node_class.__name__} has no name")


def _node(repository: Path, path: Path) -> str:
    node_class = node_classes(repository)[path.stem]
    name, package = node_name(node_class), path.parts[-3]
    node_endpoints = endpoints(node_class, plays_a_bag=path.stem == BAG_TOPICS)
    camera = connections.CAMERAS["realsense"].topics()
    heard = camera if path.stem == "perception_node" else {}
    doc = " ".join((inspect.getdoc(node_class) or "").split()).replace("`", "")
    parts = [
        f"## {name}\n\n{doc}\n\n`ros2 run {package} {path.stem}`\n",
        _topics(repository, "Subscriptions", "subscribes", node_endpoints, heard, path.stem),
        _topics(repository, "Publications", "publishes", node_endpoints, {}, path.stem),
        _calls(repository, node_endpoints),
        "### Parameters\n",
        table(
            ("name", "default", "description"),
            (
                (
                    f"{code(parameter.name)}{'' if parameter.read_only else ' ✎'}",
                    code(_default(parameter.default)),
                    parameter.description.replace("*", "\\*") + _range(parameter),
                )
                for parameter in parameters(node_class)
            ),
        ),
    ]
    if any(not parameter.read_only for parameter in parameters(node_class)):
        parts.append("✎ may be set while the node runs.\n")
    return "\n".join(part for part in parts if part)


def _topics(
    repository: Path,
    title: str,
    role: str,
    node_endpoints: list[Endpoint],
    heard: dict[str, str],
    module: str,
) -> str:
    chosen = [endpoint for endpoint in node_endpoints if endpoint.role == role]
    if not chosen:
        return ""
    titles = ["topic", "type", "QoS", "connected to" if role == "subscribes" else "carries"]
    rows = [
        [
            code(endpoint.name),
            _type_link(endpoint.type),
            _quality(endpoint.quality),
            code(heard.get(endpoint.name, ""))
            if role == "subscribes"
            else first_comment(repository, endpoint.type),
        ]
        for endpoint in chosen
    ]
    if role == "publishes" and module == BAG_TOPICS:
        rows.append(["every topic of the bag", "its own", "reliable", "the recorded messages"])
    return f"### {title}\n\n{table(titles, rows)}"


def _calls(repository: Path, node_endpoints: list[Endpoint]) -> str:
    chosen = [endpoint for endpoint in node_endpoints if endpoint.role in ("service", "action")]
    if not chosen:
        return ""
    rows = [
        [code(e.name), e.role, _type_link(e.type), first_comment(repository, e.type)]
        for e in chosen
    ]
    return f"### Services and actions\n\n{table(('name', 'kind', 'type', 'what it does'), rows)}"


def _type_link(name: str) -> str:
    package, _, short = name.split("/")
    if package == "intuitive_physics_msgs":
        return f"[{code(short)}](interfaces.md#{short.lower()})"
    return code(f"{package}/{short}")


def _quality(quality: Any) -> str:
    if isinstance(quality, int):
        return f"reliable, depth {quality}"
    if not isinstance(quality, QoSProfile):
        return ""
    if quality == qos_profile_sensor_data:
        return "sensor data"
    reliable = quality.reliability == ReliabilityPolicy.RELIABLE
    latched = quality.durability == DurabilityPolicy.TRANSIENT_LOCAL
    if reliable and latched and quality.depth == 1:
        return "latched"
    words = ["reliable" if reliable else "best effort", *(["transient local"] if latched else [])]
    return f"{', '.join(words)}, depth {quality.depth}"


def _default(value: Any) -> str:
    if isinstance(value, str):
        return value.replace(str(Path.home()), "~") or '""'
    return str(value).lower() if isinstance(value, bool) else str(value)


def _range(parameter: Any) -> str:
    """Return what a value may be, to follow a description; nothing where anything may be."""
    if parameter.choices:
        return f" (one of {', '.join(code(choice) for choice in parameter.choices)})"
    if parameter.range is not None:
        return f" ({_number(parameter.range[0])} to {_number(parameter.range[1])})"
    return ""


def _number(value: float) -> str:
    return f"{int(value):,}" if value == int(value) else f"{value:g}"
