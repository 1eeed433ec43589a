"""Pages of the library: each package's public modules, from their docstrings."""

from __future__ import annotations

import ast
from pathlib import Path

LEFT_OUT = {"intuitive_physics_bringup", "intuitive_physics_cli", "intuitive_physics_experiments"}
"""Packages that nobody imports: what starts the nodes, the command line, and experiments."""

INTERNAL = {"nodes", "commands", "event_driven", "stepped"}
"""Folders of nodes, commands and compiled kernels, which are no interface."""


def pages(repository: Path) -> dict[str, str]:
    """Return a page for each package, and their index."""
    pages_by_name = {}
    names = []
    for manifest in sorted((repository / "src").glob("*/setup.py")):
        package = manifest.parent.name
        if package not in LEFT_OUT:
            names.append(package)
            pages_by_name[f"library/{package}.rst"] = _package(manifest.parent / package)
    entries = "\n".join(f"   {name}" for name in names)
    pages_by_name["library/index.rst"] = (
        f"{_title('Library', '=')}\nThe public modules of each package, from their docstrings.\n\n"
        f".. toctree::\n   :maxdepth: 2\n\n{entries}\n"
    )
    return pages_by_name


def public_modules(folder: Path) -> list[str]:
    """Return the names of a package's modules that document something for others."""
    names = []
    for path in sorted(folder.rglob("*.py")):
        parts = path.relative_to(folder.parent).with_suffix("").parts
        if INTERNAL.isdisjoint(parts) and parts[-1] != "__main__" and _has_members(path):
            names.append(".".join(part for part in parts if part != "__init__"))
    return names


def _has_members(path: Path) -> bool:
    """Whether a module defines a public class or function that is no compiled kernel."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            return True
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            marks = {ast.unparse(mark).split("(")[0] for mark in node.decorator_list}
            if marks <= {"property", "staticmethod", "classmethod", "cache"}:
                return True
    return False


def _package(folder: Path) -> str:
    parts = [_title(folder.name, "=")]
    for module in public_modules(folder):
        short = module.removeprefix(f"{folder.name}.")
        parts.append(f"{_title(short, '-')}\n.. automodule:: {module}\n   :members:\n")
    return "\n".join(parts)


def _title(text: str, line: str) -> str:
    escaped = text.replace("_", "\\_")
    return f"{escaped}\n{line * len(escaped)}\n"
