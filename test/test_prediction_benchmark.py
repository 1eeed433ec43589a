"""The benchmark of predictions: what it counts below surfaces is there to be counted."""

from __future__ import annotations

import pytest
from benchmarks.prediction.surfaces import samples_below_a_surface

from intuitive_physics_predictor import noisy_newton


def test_samples_below_a_surface_are_counted(monkeypatch: pytest.MonkeyPatch):
    assert samples_below_a_surface(3) == 0
    monkeypatch.setattr(noisy_newton, "condition_on_outside", lambda *_: None)
    # Of five balls, each as often inside what it touches as not, nearly always one is.
    assert samples_below_a_surface(3) > 50
