"""The suite's Python modules, parsed: what is measured."""

from __future__ import annotations

import ast
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path


@dataclass(frozen=True)
class Place:
    """One finding of a measure: where it is, what it is, and its size if it has one."""

    path: str
    line: int
    text: str
    amount: int = 1

    def __str__(self) -> str:
        return f"{self.path}:{self.line} {self.text}"


@dataclass(frozen=True)
class SourceModule:
    """One Python file of a package.

    Parameters
    ----------
    name : dotted name; that of the package for its `__init__.py`
    path : path below the root of the repository
    syntax : the parsed file
    """

    name: str
    path: Path
    syntax: ast.Module = field(repr=False, hash=False, compare=False)

    @property
    def package(self) -> str:
        """Top-level package that the module belongs to."""
        return self.name.split(".")[0]

    @property
    def is_package(self) -> bool:
        """Whether the module is the `__init__.py` of its folder."""
        return self.path.name == "__init__.py"

    @property
    def in_nodes_folder(self) -> bool:
        """Whether the module lies in a folder named `nodes` of its package."""
        return "nodes" in self.path.parent.parts

    def place(self, line: int, text: str, amount: int = 1) -> Place:
        """Return a place in this module."""
        return Place(self.path.as_posix(), line, text, amount)


@dataclass(frozen=True)
class SourceTree:
    """All packages of a repository: `src/<package>/<package>/` and `benchmarks/`.

    Tests and `setup.py` are no modules of a package. A folder that does not exist has none.
    """

    root: Path

    @cached_property
    def packages(self) -> list[str]:
        """Names of the folders in `src/` that have a manifest, messages included."""
        return sorted(path.parent.name for path in self.root.glob("src/*/package.xml"))

    @cached_property
    def python_packages(self) -> list[str]:
        """Names of the folders in `src/` that have a `setup.py`."""
        return sorted(path.parent.name for path in self.root.glob("src/*/setup.py"))

    @cached_property
    def package_modules(self) -> list[SourceModule]:
        """Modules of the Python packages in `src/`."""
        return [
            module
            for package in self.python_packages
            for module in self._modules(self.root / "src" / package, package)
        ]

    @cached_property
    def benchmark_modules(self) -> list[SourceModule]:
        """Modules of `benchmarks/`."""
        return self._modules(self.root, "benchmarks")

    @cached_property
    def entry_points(self) -> set[str]:
        """Modules that a `setup.py` names as the home of an entry point."""
        modules = set()
        for path in self.root.glob("src/*/setup.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    _, equals, target = node.value.partition("=")
                    module, colon, _ = target.partition(":")
                    if equals and colon:
                        modules.add(module.strip())
        return modules

    def _modules(self, folder: Path, package: str) -> list[SourceModule]:
        modules = []
        for path in sorted((folder / package).rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            syntax = ast.parse(path.read_text(encoding="utf-8"), filename=str(path))
            modules.append(SourceModule(name, path.relative_to(self.root), syntax))
        return modules
