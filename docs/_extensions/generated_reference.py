"""Writes the pages of docs/reference from the code, before Sphinx reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import command_pages
import interface_pages
import library_pages
import node_pages
import setting_pages
import table_pages
from sphinx.application import Sphinx

MAKERS = (
    node_pages,
    interface_pages,
    command_pages,
    library_pages,
    setting_pages,
    table_pages,
)
"""Modules whose `pages` returns pages by name."""


def write_pages(app: Sphinx) -> None:
    """Write every generated page that is not up to date, and remove all other pages."""
    folder = Path(app.srcdir) / "reference"
    repository = Path(app.srcdir).parent
    pages: dict[str, str] = {}
    for maker in MAKERS:
        pages.update(maker.pages(repository))
    for name, text in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in folder.rglob("*.*"):
        if path.is_file() and path.relative_to(folder).as_posix() not in pages:
            path.unlink()


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx."""
    app.connect("builder-inited", write_pages, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
