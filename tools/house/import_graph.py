"""Who imports whom, read from the syntax: nothing is run."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from tools.house.source_tree import Place, SourceModule, SourceTree


@dataclass(frozen=True)
class Import:
    """One name that a module imports, anywhere in it.

    Parameters
    ----------
    line : line of the statement
    module : dotted name after `import` or `from`, made absolute
    name : what `from … import` takes out of the module; None for a plain `import`
    for_types_only : whether the statement stands below `if TYPE_CHECKING:`
    """

    line: int
    module: str
    name: str | None
    for_types_only: bool


def imports_of(module: SourceModule) -> list[Import]:
    """Return what a module imports, late imports inside functions included."""
    for_types = {
        id(node)
        for branch in ast.walk(module.syntax)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.unparse(branch.test)
        for statement in branch.body
        for node in ast.walk(statement)
    }
    found = []
    for node in ast.walk(module.syntax):
        if isinstance(node, ast.Import):
            found += [
                Import(node.lineno, alias.name, None, id(node) in for_types) for alias in node.names
            ]
        elif isinstance(node, ast.ImportFrom):
            source = _absolute(module, node)
            found += [
                Import(node.lineno, source, alias.name, id(node) in for_types)
                for alias in node.names
            ]
    return found


def _absolute(module: SourceModule, node: ast.ImportFrom) -> str:
    if node.level == 0:
        return node.module or ""
    parts = module.name.split(".")
    parts = parts[: len(parts) - node.level + module.is_package]
    return ".".join([*parts, node.module] if node.module else parts)


class ImportGraph:
    """The imports among some modules.

    Parameters
    ----------
    modules : modules between which imports are looked for
    """

    def __init__(self, modules: Iterable[SourceModule]) -> None:
        self.modules = {module.name: module for module in modules}
        self._imports = {name: imports_of(module) for name, module in self.modules.items()}

    def imported_module(self, item: Import) -> str | None:
        """Return the module that Python loads for an import, or None if it is not among ours."""
        names = [item.module] if item.name is None else [f"{item.module}.{item.name}", item.module]
        for name in names:
            if name in self.modules:
                return name
        parts = item.module.split(".")
        prefixes = (".".join(parts[:count]) for count in range(len(parts), 0, -1))
        return next((prefix for prefix in prefixes if prefix in self.modules), None)

    def defining_module(self, item: Import) -> str | None:
        """Return the module that an import is meant for: packages that re-export are seen through.

        `from package import Name`, where the package's `__init__` has
        `from package.module import Name`, is meant for `package.module`.
        """
        target = self.imported_module(item)
        followed = {target}
        while target is not None and self.modules[target].is_package:
            step = next(
                (again for again in self._imports[target] if again.name == item.name is not None),
                None,
            )
            following = None if step is None else self.imported_module(step)
            if following is None or following in followed:
                break
            target = following
            followed.add(target)
        return target

    def importers(self) -> dict[str, set[str]]:
        """Return, for each module, the other modules that import something of it."""
        importers: dict[str, set[str]] = {name: set() for name in self.modules}
        for importer, items in self._imports.items():
            for item in items:
                target = self.defining_module(item)
                if target is not None and target != importer:
                    importers[target].add(importer)
        return importers

    def circles(self) -> list[list[str]]:
        """Return the groups of modules each of which reaches every other by imports.

        Imports for types only do not count, since they never run. Importing a module also runs the
        `__init__` of each package that it lies in; those that the importer lies in itself do not
        count, since they run before it.
        """
        edges = {
            importer: {
                loaded
                for item in items
                if not item.for_types_only
                for loaded in self._loaded_by(importer, item)
            }
            for importer, items in self._imports.items()
        }
        reached = {name: set(_reached(name, edges)) for name in edges}
        groups = {
            frozenset(other for other in reached[name] if name in reached[other]) for name in edges
        }
        return sorted(sorted(group) for group in groups if len(group) > 1)

    def _loaded_by(self, importer: str, item: Import) -> Iterator[str]:
        """Yield the modules that run, if they have not yet, for one import."""
        target = self.imported_module(item)
        if target is None or target == importer:
            return
        yield target
        parts = target.split(".")
        for count in range(1, len(parts)):
            package = ".".join(parts[:count])
            if package in self.modules and not f"{importer}.".startswith(f"{package}."):
                yield package


def _reached(start: str, edges: dict[str, set[str]]) -> Iterator[str]:
    """Yield the modules on a path of one or more imports from `start`."""
    seen: set[str] = set()
    ahead = list(edges[start])
    while ahead:
        name = ahead.pop()
        if name not in seen:
            seen.add(name)
            yield name
            ahead += edges[name]


def single_importer_modules(tree: SourceTree) -> list[Place]:
    """Modules below `src/` that exactly one other module imports.

    A package's `__init__` that re-exports a name counts as an importer of the module that defines
    it, and so does whoever imports that name from the package. `__init__`, `__main__` and the
    homes of entry points are left out: they are not there to be imported.
    """
    graph = ImportGraph(tree.package_modules)
    places = []
    for name, importers in graph.importers().items():
        module = graph.modules[name]
        excluded = module.is_package or name.endswith(".__main__") or name in tree.entry_points
        if len(importers) == 1 and not excluded:
            places.append(module.place(1, f"{name} is imported by {min(importers)} only"))
    return places


def circles(tree: SourceTree) -> list[Place]:
    """Groups of modules of `src/` and `benchmarks/` that import one another in a circle."""
    graph = ImportGraph([*tree.package_modules, *tree.benchmark_modules])
    return [graph.modules[group[0]].place(1, " ↔ ".join(group)) for group in graph.circles()]
