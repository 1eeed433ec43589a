"""A search in a thread of its own."""

import threading
import time

import numpy as np
import pytest

from intuitive_physics_learner import ConvergenceCriteria, LearningCancelledError, LearningOptions
from intuitive_physics_learner.learning_job import LearningJob
from intuitive_physics_learner.learning_session import learn
from intuitive_physics_learner.store.database import default_database_path


def job_of(observed, simulator, iterations, on_change=lambda: None):
    options = LearningOptions(method="random", criteria=ConvergenceCriteria(iterations))
    return LearningJob(
        lambda on_progress, stop: learn(
            observed, simulator.stopped_by(stop), options, on_progress=on_progress
        ),
        on_change,
    )


def test_progress_and_result(glide, glides):
    changed = threading.Event()
    job = job_of([glides(np.random.default_rng(0), 0.4)], glide, 500, changed.set)
    history = []
    while not job.done:
        changed.wait(5.0)
        changed.clear()
        history += job.drain_progress().new_costs
    history += job.drain_progress().new_costs
    result = job.result()
    assert history == result.search.history.tolist()
    assert job.iteration == 500
    assert job.drain_progress().best_cost == result.search.cost
    assert job.seconds >= result.search.seconds


def test_stops_long_before_its_end(event_driven, throws):
    job = job_of(throws(12, 0), event_driven, 10**9)
    while job.iteration == 0:
        time.sleep(0.01)
    # All of it would take hours.
    assert job.stop(60.0)
    with pytest.raises(LearningCancelledError):
        job.result()


def test_job_raises_the_error_of_its_function():
    def work(on_progress, stop):
        raise ValueError("no luck")

    job = LearningJob(work, lambda: None)
    with pytest.raises(ValueError, match="no luck"):
        job.result()
    assert job.done


def test_database_path_follows_xdg(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert default_database_path() == tmp_path / "intuitive_physics" / "learner.sqlite3"
    monkeypatch.setenv("XDG_DATA_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path))
    expected = tmp_path / ".local" / "share" / "intuitive_physics" / "learner.sqlite3"
    assert default_database_path() == expected
