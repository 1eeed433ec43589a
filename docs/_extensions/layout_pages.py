"""The tree of the sources, from what each package and folder says of itself."""

from __future__ import annotations

import ast
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from markdown_table import table


def pages(repository: Path) -> dict[str, str]:
    """Return the table, which the architecture page includes, by its name."""
    rows = []
    for manifest in sorted((repository / "src").glob("*/package.xml")):
        package = manifest.parent.name
        description = ElementTree.parse(manifest).getroot().findtext("description") or ""
        rows.append((f"**`{package}`**", "", description))
        for init in sorted((manifest.parent / package).rglob("__init__.py")):
            folder = init.parent.relative_to(manifest.parent / package).as_posix()
            if folder != ".":
                rows.append((f"`{folder}/`", _modules(init.parent), _summary(init)))
    return {"layout.inc.md": table(("folder", "modules", "what"), rows)}


def _summary(path: Path) -> str:
    text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
    return text.partition("\n\n")[0].replace("*", "\\*")


def _modules(folder: Path) -> str:
    return str(sum(1 for path in folder.glob("*.py") if path.name != "__init__.py"))
