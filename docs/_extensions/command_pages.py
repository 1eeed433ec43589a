"""The page of the command line, from its argument parsers."""

from __future__ import annotations

import argparse
import re
from collections.abc import Iterator
from pathlib import Path

from markdown_table import code, table

from intuitive_physics_cli import command_line

LINE_LENGTH = 76


def pages(_: Path) -> dict[str, str]:
    """Return the page by its name."""
    parser = command_line._parser()
    parts = [f"# Command line\n\n{parser.description}\n"]
    parts += [_command(name, command_parser) for name, command_parser in commands(parser)]
    return {"command_line.md": "\n".join(parts)}


def commands(
    parser: argparse.ArgumentParser, prefix: str = ""
) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    """Yield every command, and commands within commands, with its parser."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, command_parser in action.choices.items():
                yield f"{prefix}{name}", command_parser
                yield from commands(command_parser, f"{prefix}{name} ")


def _command(name: str, parser: argparse.ArgumentParser) -> str:
    usage = re.sub(r"\s+", " ", parser.format_usage().removeprefix("usage: ")).strip()
    rows = [
        (_form(action), _default(action), _help(action))
        for action in parser._actions
        if action.help is not argparse.SUPPRESS and not isinstance(action, argparse._HelpAction)
    ]
    return "\n".join(
        [
            f"## {name}\n",
            f"{_escaped(parser.description or '')}\n",
            f"```\n{_folded(usage)}\n```\n",
            table(("argument", "default", "meaning"), rows) if rows else "",
        ]
    )


def _folded(usage: str) -> str:
    """Return a usage in lines that a page has room for, no option divided."""
    parts = re.findall(r"\[[^]]*\]|\S+", usage)
    lines = [""]
    for part in parts:
        if len(lines[-1]) + len(part) > LINE_LENGTH:
            lines.append("   ")
        lines[-1] += f"{' ' if lines[-1] else ''}{part}"
    return "\n".join(lines)


def _form(action: argparse.Action) -> str:
    if isinstance(action, argparse._SubParsersAction):
        return code("COMMAND")
    values = action.metavar or (action.dest.upper() if action.option_strings else action.dest)
    if isinstance(values, tuple):
        values = " ".join(values)
    if action.nargs == 0:
        values = ""
    elif isinstance(action.nargs, int) and not isinstance(action.metavar, tuple):
        values = " ".join([values] * action.nargs)
    if not action.option_strings:
        return code(values)
    return code(f"{', '.join(action.option_strings)} {values}".strip())


def _help(action: argparse.Action) -> str:
    words = (action.help or "") % {
        **vars(action),
        "default": action.default,
        "prog": "intuitive-physics",
    }
    if action.choices and not isinstance(action, argparse._SubParsersAction):
        words += f" ({', '.join(code(choice) for choice in action.choices)})"
    if isinstance(action, argparse._SubParsersAction):
        words += ", ".join(code(choice) for choice in action.choices)
    return _escaped(re.sub(r" *\(default: [^)]*\)", "", words))


def _default(action: argparse.Action) -> str:
    value = action.default
    if value is None or value is False or value == [] or value is argparse.SUPPRESS:
        return ""
    return code(str(value).replace(str(Path.home()), "~"))


def _escaped(words: str) -> str:
    return words.replace("*", "\\*").replace("<", "\\<")
