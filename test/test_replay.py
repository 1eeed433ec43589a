"""A recording that is played again gives the same observations and predictions, to the bit."""

from __future__ import annotations

from pathlib import Path

import pytest

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_cli.command_line import main
from intuitive_physics_experiments.rendering.rendered_bag import RenderSettings, render_bag
from intuitive_physics_recordings.parameter_files import save_parameters


def replay(bag: Path, folder: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """Return what is observed in a bag, and what is predicted from it."""
    assert main(["perceive", str(bag), "--save", str(folder)]) == 0
    capsys.readouterr()
    observations = sorted(folder.glob("*.json"))
    parameters = folder / "parameters.json"
    save_parameters(LearnedParameters.defaults(["object", "environment"]), parameters)
    predicted = []
    for one in observations:
        assert main(["predict", str(one), str(parameters), "--seed", str(seed)]) == 0
        predicted.append(capsys.readouterr().out)
    return [*(one.read_text() for one in observations), *predicted]


def test_the_same_bag_and_seed_give_the_same(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "bag"
    render_bag(bag, RenderSettings(throws=2, seed=6, lead_in=0.7, pause=0.6))
    once, again, other = (
        replay(bag, tmp_path / name, seed, capsys)
        for name, seed in (("once", 1), ("again", 1), ("other", 2))
    )
    assert len(once) == 4
    assert once == again
    assert once[:2] == other[:2]
    assert once[2:] != other[2:]
