"""Link what ROS looks up in our Python packages from an environment to `src/`.

    .venv/bin/python -m tools.link_packages

It does with each `setup.py` what `colcon build --symlink-install` does. That goes through `setup.py
develop`, which setuptools is giving up, and needs `setup.bash` to be sourced.
"""

from __future__ import annotations

import os
import runpy
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from unittest import mock

SOURCES = Path(__file__).resolve().parent.parent / "src"

EXECUTABLE = """\
#!{python}
import sys

from {module} import {function}

sys.exit({function}())
"""


def main() -> None:
    """Link all packages into the environment that runs this."""
    for setup in sorted(SOURCES.glob("*/setup.py")):
        link(setup.parent, Path(sys.prefix))


def link(folder: Path, prefix: Path) -> None:
    """Link data files and scripts of a package into a prefix, and write its executables there.

    The folder has the package's `setup.py`; `AMENT_PREFIX_PATH` names the prefix.
    """
    package = described(folder)
    programs = prefix / "lib" / package["name"]
    for place in (programs, prefix / "share" / package["name"]):
        shutil.rmtree(place, ignore_errors=True)
    for place, files in package["data_files"]:
        for file in files:
            replace_by_link(prefix / place, folder / file)
    for file in package.get("scripts", ()):
        replace_by_link(programs, folder / file)
    for name, module, function in console_scripts(package):
        programs.mkdir(parents=True, exist_ok=True)
        path = programs / name
        path.write_text(
            EXECUTABLE.format(python=sys.executable, module=module, function=function),
            encoding="utf-8",
        )
        path.chmod(0o755)


def described(folder: Path) -> Mapping[str, Any]:
    """Return what the `setup.py` of a folder calls `setuptools.setup` with."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        with mock.patch("setuptools.setup") as called:
            runpy.run_path("setup.py")
    finally:
        os.chdir(before)
    return called.call_args.kwargs


def replace_by_link(folder: Path, file: Path) -> None:
    """Make a link to a file in a folder, in place of what is there."""
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / file.name
    target.unlink(missing_ok=True)
    target.symlink_to(file)


def console_scripts(package: Mapping[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Yield name, module and function of each executable of a package."""
    for line in package.get("entry_points", {}).get("console_scripts", ()):
        name, _, target = (part.strip() for part in line.partition("="))
        module, _, function = target.partition(":")
        yield name, module, function


if __name__ == "__main__":
    main()
