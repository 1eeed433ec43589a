"""Pages of the benchmarks' results, made from what their runs wrote, with their figures."""

from __future__ import annotations

from pathlib import Path


def pages(repository: Path) -> dict[str, str]:
    """Return a page for each file of results by its name."""
    return {
        f"benchmarks/{path.stem}.md": _page(path)
        for path in sorted((repository / "benchmarks" / "results").glob("*.md"))
    }


def _page(path: Path) -> str:
    text = path.read_text(encoding="utf-8")
    figure = path.with_suffix(".svg")
    if not figure.exists():
        return text
    title = text.partition("\n")[0].lstrip("# ")
    return f"{text}\n![{title}](../../../benchmarks/results/{figure.name})\n"
