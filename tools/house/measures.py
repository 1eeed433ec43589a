"""The nine numbers: what each measures and how it comes from the places that were found."""

from __future__ import annotations

import inspect
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from tools.house.array_documentation import undocumented_arrays
from tools.house.functions import argument_lists, function_lengths
from tools.house.import_graph import circles, single_importer_modules
from tools.house.layout_rules import upward_imports
from tools.house.module_constants import module_constants_without_docstring
from tools.house.source_tree import Place, SourceTree


@dataclass(frozen=True)
class Measure:
    """One number about the source tree.

    Parameters
    ----------
    find : returns the places behind the number; its docstring is the number's definition
    is_largest : whether the number is the largest amount among the places, or their count
    """

    find: Callable[[SourceTree], list[Place]]
    is_largest: bool

    def places(self, tree: SourceTree) -> list[Place]:
        """Return the places behind the number, the largest first."""
        return sorted(self.find(tree), key=lambda place: (-place.amount, place.path, place.line))

    def value(self, tree: SourceTree) -> int:
        """Return the number."""
        places = self.find(tree)
        if self.is_largest:
            return max((place.amount for place in places), default=0)
        return len(places)

    @property
    def definition(self) -> str:
        """What the number is."""
        return inspect.getdoc(self.find) or ""


def folders(tree: SourceTree) -> list[Place]:
    """Every folder of `src/` with the number of modules directly in it, `__init__.py` apart."""
    counts = Counter(
        module.path.parent.as_posix() for module in tree.package_modules if not module.is_package
    )
    return [Place(folder, 1, f"has {count} modules", count) for folder, count in counts.items()]


def readme_lines(tree: SourceTree) -> list[Place]:
    """`README.md` with the number of its lines."""
    path = tree.root / "README.md"
    if not path.exists():
        return []
    count = len(path.read_text(encoding="utf-8").splitlines())
    return [Place("README.md", 1, f"has {count} lines", count)]


MEASURES: dict[str, Measure] = {
    "largest_folder": Measure(folders, is_largest=True),
    "single_importer_modules": Measure(single_importer_modules, is_largest=False),
    "largest_argument_list": Measure(argument_lists, is_largest=True),
    "longest_function": Measure(function_lengths, is_largest=True),
    "readme_lines": Measure(readme_lines, is_largest=True),
    "undocumented_arrays": Measure(undocumented_arrays, is_largest=False),
    "module_constants_without_docstring": Measure(
        module_constants_without_docstring, is_largest=False
    ),
    "upward_imports": Measure(upward_imports, is_largest=False),
    "circles": Measure(circles, is_largest=False),
}
"""All measures by name, in the order in which they are printed."""


def measure(root: Path) -> dict[str, int]:
    """Return every number for the repository below `root`."""
    tree = SourceTree(root)
    return {key: item.value(tree) for key, item in MEASURES.items()}
