"""Pages of the benchmarks' results, as their runs wrote them, with command and commit."""

from __future__ import annotations

import subprocess
from pathlib import Path


def pages(repository: Path) -> dict[str, str]:
    """Return a page for each file of results by its name."""
    return {
        f"benchmarks/{path.stem}.md": _page(repository, path)
        for path in sorted((repository / "benchmarks" / "results").glob("*.md"))
    }


def _page(repository: Path, path: Path) -> str:
    title, _, rest = path.read_text(encoding="utf-8").partition("\n")
    command = f"make bench-{path.stem} options=--write"
    figure = path.with_suffix(".svg")
    picture = f"\n![{title.lstrip('# ')}](../../../benchmarks/results/{figure.name})\n"
    return (
        f"{title}\n\nMade by `{command}`{_commit(repository, path)}.\n{rest}"
        f"{picture if figure.exists() and figure.name not in rest else ''}"
    )


def _commit(repository: Path, path: Path) -> str:
    """The commit that stored the results; nothing where there is no git."""
    try:
        answer = subprocess.run(
            ["git", "log", "-1", "--format=%h of %cs", "--", str(path.relative_to(repository))],
            cwd=repository,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return ""
    found = answer.stdout.strip()
    return f", stored by commit {found}" if found else ""
