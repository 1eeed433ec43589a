"""The page of all messages, services and actions, from their definitions."""

from __future__ import annotations

from pathlib import Path

KINDS = {"msg": "Messages", "srv": "Services", "action": "Actions"}


def pages(repository: Path) -> dict[str, str]:
    """Return the page by its name."""
    parts = [
        "# Messages, services, actions\n",
        "The definitions of `intuitive_physics_msgs`. Every field says its unit and frame.\n",
    ]
    folder = repository / "src" / "intuitive_physics_msgs"
    for kind, title in KINDS.items():
        parts.append(f"## {title}\n")
        for path in sorted((folder / kind).glob(f"*.{kind}")):
            place = f"../../src/intuitive_physics_msgs/{kind}/{path.name}"
            parts.append(
                f"### {path.stem}\n\n```{{literalinclude}} {place}\n:language: text\n```\n"
            )
    return {"interfaces.md": "\n".join(parts)}


def first_comment(repository: Path, type_name: str) -> str:
    """Return what a definition of ours says of itself, empty for types of others."""
    package, kind, name = type_name.split("/")
    path = repository / "src" / package / kind / f"{name}.{kind}"
    if not path.exists():
        return ""
    lines = []
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# "))
    return " ".join(lines)
