"""Foxglove's layout against the one that Foxglove publishes, as the classes of its SDK."""

from __future__ import annotations

import dataclasses
import json
import re
import types
import typing
from pathlib import Path
from typing import Any

import pytest

from foxglove import layouts

pytestmark = pytest.mark.needs("foxglove")

FILE = Path(__file__).parent.parent / "foxglove" / "intuitive_physics.json"
PANELS: dict[str, dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8"))["configById"]

TITLE = "foxglovePanelTitle"
"""A panel's title stands in its configuration in a layout file, and beside it in the SDK."""

NAMES = {"3D": "ThreeDee", "DiagnosticSummary": "DiagnosticsSummary"}
"""Kinds of panels that the SDK names otherwise than a layout file does."""


def configurations() -> dict[str, type]:
    """The class of each kind of panel's configuration, by the kind's name in the SDK."""
    found: dict[str, type] = {}
    for name, kind in vars(layouts).items():
        if name.endswith("Panel") and "config" in getattr(kind, "__dataclass_fields__", {}):
            (config,) = (one for one in dataclasses.fields(kind) if one.name == "config")
            if isinstance(config.default_factory, type):
                panel_type = kind()._to_dict().get("panelType")
                found[panel_type] = config.default_factory
    return found


def complaints(kind: Any, value: Any, place: str) -> list[str]:
    """Return what of a value is not as a type of the SDK has it."""
    parts = typing.get_args(kind)
    origin = typing.get_origin(kind)
    if dataclasses.is_dataclass(kind):
        return of_fields(kind, value, place)
    if origin in (typing.Union, types.UnionType):
        return min((complaints(part, value, place) for part in parts), key=len)
    if origin is typing.Literal:
        return [] if value in parts else [f"{place} is {value!r}, expected one of {parts}"]
    if origin is list and isinstance(value, list):
        items = (complaints(parts[0], one, f"{place}[{k}]") for k, one in enumerate(value))
        return [one for item in items for one in item]
    if origin is tuple and isinstance(value, list) and len(value) == len(parts):
        pairs = enumerate(zip(parts, value, strict=True))
        return [one for k, pair in pairs for one in complaints(*pair, f"{place}[{k}]")]
    if origin is dict and isinstance(value, dict):
        items = (complaints(parts[1], one, f"{place}.{k}") for k, one in value.items())
        return [one for item in items for one in item]
    expected = (int, float) if kind is float else origin or kind
    if kind is Any or isinstance(value, expected):
        return []
    return [f"{place} is {value!r}, expected {kind}"]


def of_fields(kind: Any, value: Any, place: str) -> list[str]:
    """Return what of a JSON object is not as a dataclass of the SDK has it."""
    if not isinstance(value, dict):
        return [f"{place} is {value!r}, expected {kind.__name__}"]
    hints = typing.get_type_hints(kind, vars(layouts))
    found = []
    for key, own in value.items():
        name = re.sub(r"(?<!^)[A-Z]", lambda letter: f"_{letter[0].lower()}", key)
        if name in hints:
            found += complaints(hints[name], own, f"{place}.{key}")
        else:
            found.append(f"{place}.{key} is no field of {kind.__name__}")
    return found


@pytest.mark.parametrize("panel", PANELS)
def test_each_panel_has_the_fields_that_are_published(panel: str) -> None:
    name = panel.partition("!")[0]
    kind = configurations()[NAMES.get(name, name)]
    config = {key: value for key, value in PANELS[panel].items() if key != TITLE}
    assert complaints(kind, config, panel) == []


@pytest.mark.parametrize(
    ("config", "complaint"),
    [
        ({"pathes": []}, "Plot.pathes is no field of PlotConfig"),
        ({"paths": [{"value": 3}]}, "Plot.paths[0].value is 3, expected"),
        ({"xAxisVal": "yesterday"}, "Plot.xAxisVal is 'yesterday', expected one of"),
        ({"followingViewWidth": "ten"}, "Plot.followingViewWidth is 'ten', expected"),
    ],
)
def test_unknown_field_of_a_panel_is_found(config: dict[str, Any], complaint: str) -> None:
    (found,) = complaints(layouts.PlotConfig, config, "Plot")
    assert found.startswith(complaint)
