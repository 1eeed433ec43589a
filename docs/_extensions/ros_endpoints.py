"""Topics, services and actions of a node, read from its code without starting it.

The constructor of the node, and what a managed node does when it is configured and activated, are
followed statement by statement, into methods of its own and into the constructors of objects that
are given the node. Names are looked up in the modules, so that
the reference cannot differ from the code. A topic that cannot be looked up is an error.
"""

from __future__ import annotations

import ast
import importlib
import inspect
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from intuitive_physics_ros.lifecycle.managed_node import ManagedNode

CREATORS = {
    "create_publisher": "publishes",
    "create_subscription": "subscribes",
    "create_service": "service",
}
"""Methods of a node by which it offers or uses something."""

PLACED_BY = "topic_of"
"""Function that puts the name of a camera before a topic, its last argument."""

CALLED_BACK = ("create_guard_condition", "when_loaded")
"""Methods whose argument is called back once, as a part of the start."""

BEGINNING = ("__init__", "configure", "activate")
"""Methods that a node makes all of that in."""


class UnresolvedEndpointError(Exception):
    """A topic, service or type whose name only a running node knows."""


class _Unknown:
    """A value that only a running node knows."""


UNKNOWN = _Unknown()


@dataclass(frozen=True)
class Endpoint:
    """One topic, service or action.

    Parameters
    ----------
    role : "publishes", "subscribes", "service" or "action"
    name : as in the code, such as "~/environment"
    type : such as "sensor_msgs/msg/Image"
    quality : QoSProfile or depth of a topic, None otherwise
    """

    role: str
    name: str
    type: str
    quality: Any = None


def endpoints(node_class: type, *, plays_a_bag: bool = False) -> list[Endpoint]:
    """Return all endpoints of a node in the order in which they are made.

    Of a node that plays a bag, publishers whose topics are those of the bag are left out.
    """
    reader = _Reader(plays_a_bag)
    if issubclass(node_class, ManagedNode):
        reader.follow(ManagedNode, "__init__", {})
    for method in BEGINNING:
        if hasattr(node_class, method):
            reader.follow(node_class, method, {})
    unique = {(endpoint.role, endpoint.name, endpoint.type): endpoint for endpoint in reader.found}
    return list(unique.values())


class _Reader:
    def __init__(self, plays_a_bag: bool) -> None:
        self.found: list[Endpoint] = []
        self._plays_a_bag = plays_a_bag
        self._visited: set[tuple[type, str]] = set()

    def follow(self, owner: type, method: str, bindings: Mapping[str, Any]) -> None:
        function = inspect.unwrap(getattr(owner, method))
        if not inspect.isfunction(function):
            return
        tree = ast.parse(textwrap.dedent(inspect.getsource(function))).body[0]
        assert isinstance(tree, ast.FunctionDef | ast.AsyncFunctionDef)
        names = {argument.arg: UNKNOWN for argument in [*tree.args.args, *tree.args.kwonlyargs]}
        values = {**vars(inspect.getmodule(function)), **names, **bindings}
        self._body(tree.body, values, owner)

    def _body(self, statements: list[ast.stmt], values: dict[str, Any], owner: type) -> None:
        for statement in statements:
            if isinstance(statement, ast.ImportFrom):
                values.update(_imported(statement))
            elif isinstance(statement, ast.For):
                for loop_values in _loop_values(statement, values):
                    self._body(statement.body, loop_values, owner)
            else:
                self._statement(statement, values, owner)

    def _statement(self, statement: ast.stmt, values: dict[str, Any], owner: type) -> None:
        for _, field in ast.iter_fields(statement):
            parts = field if isinstance(field, list) else [field]
            for part in parts:
                if isinstance(part, ast.stmt):
                    self._body([part], values, owner)
                elif isinstance(part, ast.ExceptHandler):
                    self._body(part.body, values, owner)
                elif isinstance(part, ast.expr | ast.withitem):
                    for call in (n for n in ast.walk(part) if isinstance(n, ast.Call)):
                        self._call(call, values, owner)

    def _call(self, call: ast.Call, values: dict[str, Any], owner: type) -> None:
        if isinstance(call.func, ast.Name) and call.func.id in CREATORS:
            # Functions of `intuitive_physics_ros.qos`, whose first argument is the node.
            method = ast.Attribute(call.args[0], call.func.id, ast.Load())
            call = ast.Call(method, call.args[1:], call.keywords)
        function = call.func
        if isinstance(function, ast.Attribute) and function.attr in CREATORS:
            quality = call.args[3 if function.attr == "create_subscription" else 2 :]
            is_service = function.attr == "create_service"
            self._add(
                CREATORS[function.attr],
                call.args[0],
                call.args[1],
                None if is_service or not quality else quality[0],
                values,
            )
        elif isinstance(function, ast.Attribute) and function.attr in CALLED_BACK:
            self._call(ast.Call(call.args[0], [], []), values, owner)
        elif isinstance(function, ast.Attribute) and _is_self(function.value):
            if (owner, function.attr) not in self._visited and hasattr(owner, function.attr):
                self._visited.add((owner, function.attr))
                self.follow(owner, function.attr, {})
        elif isinstance(function, ast.Name) and function.id == "ActionServer":
            self._add("action", call.args[1], call.args[2], None, values)
        elif isinstance(function, ast.Name):
            called = values.get(function.id)
            if inspect.isclass(called) and called.__module__.startswith("intuitive_physics"):
                self._constructed(called, call, values)

    def _constructed(self, called: type, call: ast.Call, values: dict[str, Any]) -> None:
        """Follow the constructor of an object that is given a node."""
        if not any(isinstance(a, ast.Name) and a.id in ("self", "node") for a in call.args):
            return
        parameters = list(inspect.signature(called).parameters)
        given = dict(zip(parameters, call.args, strict=False))
        given.update({keyword.arg: keyword.value for keyword in call.keywords if keyword.arg})
        self.follow(called, "__init__", {name: _value(arg, values) for name, arg in given.items()})

    def _add(
        self,
        role: str,
        kind: ast.expr,
        name: ast.expr,
        quality: ast.expr | None,
        values: dict[str, Any],
    ) -> None:
        found_quality = None if quality is None else _value(quality, values)
        if isinstance(name, ast.Call) and ast.unparse(name.func) == PLACED_BY:
            name = name.args[-1]
        if isinstance(name, ast.JoinedStr):
            name = _with_known_parts(name, values)
        if self._plays_a_bag and role == "publishes" and _value(name, values) is UNKNOWN:
            return
        for message, topic in _pairs(kind, name, values):
            self.found.append(Endpoint(role, topic, _type_name(message), found_quality))


def _pairs(kind: ast.expr, name: ast.expr, values: dict[str, Any]) -> Iterator[tuple[Any, str]]:
    """Yield type and name; every entry of a table that is looked up by the unknown type."""
    message, topic = _value(kind, values), _value(name, values)
    if message is UNKNOWN and isinstance(name, ast.Subscript):
        by_type = _value(name.value, values)
        if isinstance(by_type, dict) and ast.unparse(name.slice) == ast.unparse(kind):
            yield from by_type.items()
            return
    if message is UNKNOWN or topic is UNKNOWN:
        raise UnresolvedEndpointError(f"{ast.unparse(kind)} on {ast.unparse(name)}")
    yield message, topic


def _value(expression: ast.expr, values: dict[str, Any]) -> Any:
    try:
        result = eval(compile(ast.Expression(expression), "<node>", "eval"), values)
    except Exception:
        return UNKNOWN
    return UNKNOWN if isinstance(result, _Unknown) else result


def _with_known_parts(name: ast.JoinedStr, values: dict[str, Any]) -> ast.expr:
    """Return a name in which only known parts are left, and placeholders within it.

    A part at its start that only a running node knows, such as a prefix, is left out; within the
    name it is written as in the code, such as "~/{name}/pose".
    """
    parts = []
    for part in name.values:
        inner = part.value if isinstance(part, ast.FormattedValue) else part
        value = _value(inner, values)
        if isinstance(value, str):
            parts.append(value)
        elif parts:
            parts.append(f"{{{ast.unparse(inner)}}}")
    return ast.copy_location(ast.Constant("".join(parts)), name) if parts else name


def _loop_values(loop: ast.For, values: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the names of each round of a loop over a literal; one round of unknowns otherwise."""
    targets = loop.target.elts if isinstance(loop.target, ast.Tuple) else [loop.target]
    names = [target.id for target in targets if isinstance(target, ast.Name)]
    if not isinstance(loop.iter, ast.Tuple | ast.List):
        yield {**values, **dict.fromkeys(names, UNKNOWN)}
        return
    for element in loop.iter.elts:
        parts = element.elts if isinstance(element, ast.Tuple) else [element]
        yield {**values, **{n: _value(p, values) for n, p in zip(names, parts, strict=True)}}


def _imported(statement: ast.ImportFrom) -> dict[str, Any]:
    """Names that an import inside a function brings, also of a package that is not installed."""
    values = {}
    for alias in statement.names:
        try:
            value = getattr(importlib.import_module(statement.module or ""), alias.name)
        except ImportError:
            value = type(alias.name, (), {"__module__": f"{statement.module}.missing"})
        values[alias.asname or alias.name] = value
    return values


def _is_self(expression: ast.expr) -> bool:
    return isinstance(expression, ast.Name) and expression.id == "self"


def _type_name(message: type) -> str:
    package, kind = message.__module__.split(".")[:2]
    return f"{package}/{kind}/{message.__name__}"
