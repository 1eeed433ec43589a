"""The suite's packages and the syntax of their Python files, for tests of the source itself."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parent.parent

PACKAGES = sorted(path.parent.name for path in ROOT.glob("src/*/package.xml"))
"""Names of all packages, messages included."""

PYTHON_PACKAGES = sorted(path.parent.name for path in ROOT.glob("src/*/setup.py"))
"""Names of those that are Python."""


def syntax_of(package: str) -> Iterator[tuple[Path, ast.Module]]:
    """Yield each module of a package, without its tests: path below the repository, syntax."""
    for path in sorted((ROOT / "src" / package / package).rglob("*.py")):
        yield path.relative_to(ROOT), ast.parse(path.read_text(encoding="utf-8"))


def imported_packages(syntax: ast.Module) -> set[str]:
    """Return the top-level packages that a module imports, late imports included."""
    packages = set()
    for node in ast.walk(syntax):
        if isinstance(node, ast.Import):
            packages |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            packages.add((node.module or "").partition(".")[0])
    return packages
