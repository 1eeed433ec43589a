"""The paper's synthetic set as files that other tools and `intuitive-physics learn` read."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from intuitive_physics.errors import InvalidInputError
from intuitive_physics_experiments.paper.cells import write_whole
from intuitive_physics_experiments.paper.outcome import write_csv
from intuitive_physics_experiments.paper.paper_dataset import PaperDataset, PaperRun
from intuitive_physics_recordings.observation_files import save_observations

FORMAT = "intuitive_physics/paper_dataset/1"
TRUTH_NAME, TABLE_NAME = "ground_truth.json", "trajectories.csv"


def save_paper_dataset(dataset: PaperDataset, folder: Path) -> None:
    """Write a set into a folder, which must not exist or be empty.

    `training` and `test` get a file for each observation; `trajectories.csv` all points, seen and
    true; `ground_truth.json` the pool, the true θ_s, and the true initial states of each run.

    Raises
    ------
    InvalidInputError
        When the folder has something in it or cannot be written.
    """
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InvalidInputError(f"{folder} exists already; expected a new folder for the set")
    parts = {"training": dataset.training, "test": dataset.test}
    for name, runs in parts.items():
        if runs:
            save_observations([run.observation for run in runs], folder / name)
    truth = {
        "format": FORMAT,
        "engine": dataset.engine,
        "pool": [thing.to_dict() for thing in dataset.pool],
        "static_parameters": dataset.parameters.to_dict(),
        "runs": [_run_truth(run, name) for name, runs in parts.items() for run in runs],
    }
    write_whole(folder / TRUTH_NAME, json.dumps(truth, allow_nan=False))
    rows = [row for name, runs in parts.items() for row in _rows(runs, name)]
    write_csv(folder / TABLE_NAME, rows)


def _run_truth(run: PaperRun, part: str) -> dict[str, Any]:
    return {
        "observation": run.observation.id,
        "part": part,
        "objects": [thing.id for thing in run.scene.objects],
        "first_states": [state.to_dict() for state in run.scene.states],
    }


def _rows(runs: Sequence[PaperRun], part: str) -> list[dict[str, Any]]:
    return [
        {
            "part": part,
            "observation": run.observation.id,
            "object": seen.object.id,
            "time": float(time),
            **dict(zip(("x", "y", "z"), map(float, point), strict=True)),
            **dict(zip(("true_x", "true_y", "true_z"), map(float, true), strict=True)),
        }
        for run in runs
        for seen, positions in zip(run.observation.objects, run.positions, strict=True)
        for time, point, true in zip(
            seen.trajectory.times, seen.trajectory.positions, positions, strict=True
        )
    ]
