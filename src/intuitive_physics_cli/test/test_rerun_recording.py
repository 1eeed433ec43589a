"""What is told to Rerun is in its file; without Rerun one sentence says what to install."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from intuitive_physics.errors import IntuitivePhysicsError
from intuitive_physics_cli.evaluation.prediction_case import PredictionCase
from intuitive_physics_cli.report.rerun_recording import RerunRecording

from .bouncing_balls import bounces


def test_without_rerun_one_sentence_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(IntuitivePhysicsError, match="pip install rerun-sdk"):
        RerunRecording(tmp_path / "out.rrd")


@pytest.mark.needs("rerun")
def test_predictions_and_what_was_seen_are_recorded(tmp_path: Path) -> None:
    (seen,) = bounces(1)
    path = seen.objects[0].trajectory
    case = PredictionCase(
        "run 1: a ball",
        seen.environment,
        0.1,
        path.times,
        np.repeat(path.positions[None], 5, axis=0),
        path.positions,
        np.zeros((len(path), 3, 3)),
    )
    file = tmp_path / "new" / "out.rrd"
    with RerunRecording(file) as recording:
        recording.environment(seen.environment)
        recording.prediction(case, 0.0)
        recording.observation(seen, 0.0)
    content = file.read_bytes()
    assert content.startswith(b"RRF")
    assert len(content) > path.positions.nbytes
    for entity in (b"predicted/run_1__a_ball", b"environment/gravity", b"seen/"):
        assert entity in content
