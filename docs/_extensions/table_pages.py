"""Tables that pages include, and the pages of the benchmarks' results with their figures."""

from __future__ import annotations

import ast
import inspect
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from markdown_table import code, table

from intuitive_physics.materials import DEFAULT_COEFFICIENTS, DEFAULT_DENSITY, PAIR_COEFFICIENTS
from intuitive_physics.parameter_space import DEFAULT_BOUNDS
from intuitive_physics_learner.search.update_rules import FURTHER_RULES, UPDATE_RULES


def pages(repository: Path) -> dict[str, str]:
    """Return tables and pages by their names."""
    results = sorted((repository / "benchmarks" / "results").glob("*.md"))
    return {
        "layout.inc.md": _layout(repository),
        "parameter_bounds.inc.md": _bounds(),
        "update_rules.inc.md": _rules(),
        **{f"benchmarks/{path.stem}.md": _benchmark(path) for path in results},
    }


def _layout(repository: Path) -> str:
    """Return the tree of the sources, from what each package and folder says of itself."""
    rows = []
    for manifest in sorted((repository / "src").glob("*/package.xml")):
        package = manifest.parent.name
        description = ElementTree.parse(manifest).getroot().findtext("description") or ""
        rows.append((f"**`{package}`**", "", description))
        for init in sorted((manifest.parent / package).rglob("__init__.py")):
            folder = init.parent.relative_to(manifest.parent / package).as_posix()
            if folder != ".":
                rows.append((f"`{folder}/`", _modules(init.parent), _summary(init)))
    return table(("folder", "modules", "what"), rows)


def _summary(path: Path) -> str:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.partition("\n\n")[0].replace("*", "\\*")


def _modules(folder: Path) -> str:
    return str(sum(1 for path in folder.glob("*.py") if path.name != "__init__.py"))


def _bounds() -> str:
    default = {"density": DEFAULT_DENSITY}
    default.update(zip(PAIR_COEFFICIENTS, DEFAULT_COEFFICIENTS, strict=True))
    rows = [
        (code(kind), f"{bounds.lower:g} to {bounds.upper:g}", bounds.scale, f"{default[kind]:g}")
        for kind, bounds in DEFAULT_BOUNDS.items()
    ]
    return table(("parameter", "bounds", "scale", "default"), rows)


def _rules() -> str:
    rows = []
    for name, rule in {**UPDATE_RULES, **FURTHER_RULES}.items():
        settings = [f"{code(key)} = {value:g}" for key, value in rule.defaults.items()]
        summary = (inspect.getdoc(rule) or "").partition("\n\n")[0]
        rows.append((code(name), summary, ", ".join(settings)))
    return table(("rule", "what it does", "settings and their defaults"), rows)


def _benchmark(path: Path) -> str:
    """Return what a run wrote, with its figure."""
    text = path.read_text(encoding="utf-8")
    figure = path.with_suffix(".svg")
    if not figure.exists():
        return text
    title = text.partition("\n")[0].lstrip("# ")
    return f"{text}\n![{title}](../../../benchmarks/results/{figure.name})\n"
