"""Makes plain text of docstrings safe for reStructuredText: |θ_s| and * are no markup there."""

from __future__ import annotations

import re
from typing import Any, TypeVar

from sphinx.application import Sphinx

CODE = re.compile(r"(`[^`]*`)")
EMPHASIS = re.compile(r"(\*[^\s*][^*]*[^\s*]\*(?!\w))")


def escape(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Escape what reStructuredText would take for a substitution, emphasis or reference."""
    for k, line in enumerate(lines):
        parts = CODE.split(line)
        parts[::2] = [_escaped(part) for part in parts[::2]]
        lines[k] = "".join(parts)


def _escaped(text: str) -> str:
    pieces = EMPHASIS.split(text)
    pieces[::2] = [piece.replace("*", "\\*") for piece in pieces[::2]]
    text = "".join(pieces).replace("|", "\\|")
    return re.sub(r"(\w)_(?=\W|$)", r"\1\\_", text)


def skip(_: Sphinx, what: str, name: str, thing: Any, skipped: bool, options: Any) -> bool | None:
    """Leave out type variables, which numpydoc takes for classes."""
    return True if isinstance(thing, TypeVar) else None


def setup(app: Sphinx) -> dict[str, Any]:
    """Register with Sphinx, before numpydoc reads the docstrings."""
    app.connect("autodoc-process-docstring", escape, priority=100)
    app.connect("autodoc-skip-member", skip)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
