"""The command `intuitive-physics`: everything that needs no ROS."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import Any

from intuitive_physics.errors import IntuitivePhysicsError, InvalidInputError
from intuitive_physics.limits import InputLimits, use_limits
from intuitive_physics.settings import list_settings
from intuitive_physics_cli.plugins import command_modules

INTERRUPTED = 130
"""Exit code of a program that Ctrl-C ended, as shells have it."""

OWN_COMMANDS = (
    "perceive",
    "learn",
    "predict",
    "suggest",
    "import",
    "export",
    "observations",
    "report",
)
"""Commands that need no package beside this one's; each is a module in the folder `commands`."""

ORDER = (
    "render",
    "perceive",
    "learn",
    "suggest",
    "predict",
    "evaluate",
    "calibrate",
    "import",
    "export",
    "observations",
    "experiment",
    "report",
)
"""Commands as the help lists them, in the order of work; those not named here come last."""

LIMITS = {setting.name: setting.default for setting in list_settings(InputLimits)}
"""Limits that can be raised, with their defaults."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one subcommand and return the exit code.

    It is 0 after success, 1 after an error, which one line on standard error explains, and 130
    after Ctrl-C.
    """
    options = _parser().parse_args(arguments)
    try:
        if options.input_limit:
            use_limits(_raised(options.input_limit))
        options.run(options)
        sys.stdout.flush()
    except IntuitivePhysicsError as error:
        print(f"intuitive-physics: error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("intuitive-physics: interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # The reader of the output has ended, as `head` does: Python must not write at its exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="intuitive-physics",
        description="Learn how things move from seeing them move, with no ROS needed.",
    )
    parser.add_argument(
        "--input-limit",
        action="append",
        default=[],
        metavar="NAME=NUMBER",
        help="another limit on what is read and stored, such as largest_database=50e9; before the "
        f"command, as often as needed: {', '.join(LIMITS)}",
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    modules = command_modules()
    for name in OWN_COMMANDS:
        modules[name] = import_module(f"intuitive_physics_cli.commands.{name}_command")
    for name in sorted(modules, key=lambda name: (*ORDER, name).index(name)):
        modules[name].add_to(commands)
    return parser


def _raised(given: Sequence[str]) -> InputLimits:
    """Return limits in which some have the numbers that were given, each as NAME=NUMBER."""
    numbers: dict[str, Any] = {}
    for entry in given:
        name, _, text = entry.partition("=")
        try:
            number = float(text)
            numbers[name] = type(LIMITS[name])(number)
        except (KeyError, ValueError, OverflowError):
            raise InvalidInputError(
                f"--input-limit is {entry!r}; expected NAME=NUMBER with one of {', '.join(LIMITS)}"
            ) from None
    return InputLimits(**numbers)


if __name__ == "__main__":
    sys.exit(main())
