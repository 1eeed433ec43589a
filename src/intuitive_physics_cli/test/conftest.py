"""What the tests of the commands share."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from intuitive_physics_cli.command_line import main


@pytest.fixture
def complaint(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run the command with a mistake, and return the one line that it prints of it."""

    def run(*arguments: object) -> str:
        capsys.readouterr()
        assert main(list(map(str, arguments))) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert line.startswith("intuitive-physics: error: ")
        return line

    return run
