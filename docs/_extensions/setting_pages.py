"""The page of all settings, and their values for the text of other pages."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

from library_pages import public_modules
from markdown_table import code, table

from intuitive_physics.settings import Setting, list_settings


def pages(repository: Path) -> dict[str, str]:
    """Return the page by its name."""
    parts = [
        "# Settings\n",
        "Tuned numbers, from the classes that hold them: meaning, unit, range and origin.\n",
    ]
    for name, settings in sorted(_classes(repository).items()):
        summary = " ".join((inspect.getdoc(settings) or "").partition("\n\n")[0].split())
        rows = [
            (
                code(setting.name),
                f"{code(words(setting.default))} {setting.unit}",
                _meaning(setting),
            )
            for setting in list_settings(settings)
        ]
        parts.append(f"## {name.rpartition('.')[2]}\n\n`{name}`: {summary}\n")
        parts.append(table(("setting", "default", "meaning"), rows))
    return {"settings.md": "\n".join(parts)}


def values(repository: Path) -> dict[str, dict[str, str]]:
    """Return what `{{ joint_estimation.NAME }}` and the like stand for in the pages.

    The first part is the name of the class of settings, without its last word, or of the folder
    whose modules have the constant NAME.
    """
    values_of = _constants(repository)
    for name, settings in _classes(repository).items():
        parts = re.findall("[A-Z][a-z]+", name.rpartition(".")[2])
        values_of.setdefault("_".join(parts[:-1]).lower(), {}).update(
            {setting.name: words(setting.default) for setting in list_settings(settings)}
        )
    return values_of


def _constants(repository: Path) -> dict[str, dict[str, str]]:
    """Return the constants of public modules by folder and lower-case name."""
    constants: dict[str, dict[str, str]] = {}
    for manifest in sorted((repository / "src").glob("*/setup.py")):
        for module in public_modules(manifest.parent / manifest.parent.name):
            for name, value in vars(importlib.import_module(module)).items():
                if name.isupper() and isinstance(value, int | float | tuple):
                    constants.setdefault(module.split(".")[-2], {})[name.lower()] = words(value)
    return constants


def words(value: Any) -> str:
    """Return a value as a reader wants it."""
    if isinstance(value, bool) or value is None:
        return str(value).lower()
    if isinstance(value, tuple):
        return ", ".join(words(item) for item in value)
    if is_dataclass(value):
        return code(type(value).__name__)
    return f"{value:g}" if isinstance(value, int | float) else str(value)


def _classes(repository: Path) -> dict[str, type]:
    """Return every class of settings by its full name."""
    classes = {}
    for manifest in sorted((repository / "src").glob("*/setup.py")):
        package = manifest.parent.name
        for module in public_modules(manifest.parent / package):
            path = manifest.parent.joinpath(*module.split(".")).with_suffix(".py")
            if path.exists() and _imports_settings(path):
                for name, value in vars(importlib.import_module(module)).items():
                    own = inspect.isclass(value) and value.__module__ == module
                    if own and is_dataclass(value) and list_settings(value):
                        classes[f"{module}.{name}"] = value
    return classes


def _imports_settings(path: Path) -> bool:
    return any(
        isinstance(node, ast.ImportFrom) and node.module == "intuitive_physics.settings"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    )


def _meaning(setting: Setting) -> str:
    meaning = setting.description.replace("*", "\\*")
    if setting.choices:
        return f"{meaning} (one of {', '.join(code(choice) for choice in setting.choices)})"
    if setting.range is None:
        return meaning
    return f"{meaning} ({setting.range[0]:g} to {setting.range[1]:g})"
