"""Learning from a store: versions, checkpoints, and searches that were killed on their way."""

import json
import signal
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from intuitive_physics.errors import (
    SimulationStoppedError,
    UnknownNameError,
    UnsupportedSceneError,
)
from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.processes import ChildProcess
from intuitive_physics.scene import Environment, Plane
from intuitive_physics.simulation import make_simulator
from intuitive_physics.simulation.stop_flag import StopFlag
from intuitive_physics_learner import (
    ConvergenceCriteria,
    LearningOptions,
    NoObservationsError,
    ObservationStore,
    UnknownMethodError,
    learn_from_store,
)
from intuitive_physics_learner.errors import IncompatibleEnvironmentError, SupersededError
from intuitive_physics_learner.search import parameter_search

PATIENCE = 120.0
"""s to wait for what takes a few, on a machine that is busy with other things."""

LEARNER = """
import sys
from intuitive_physics.simulation import make_simulator
from intuitive_physics_learner import ConvergenceCriteria, LearningOptions, ObservationStore
from intuitive_physics_learner import learn_from_store
from intuitive_physics_learner.search import parameter_search
parameter_search.CHECKPOINT_PERIOD = 0.0
options = LearningOptions(sys.argv[2], ConvergenceCriteria(int(sys.argv[3])), seed=5)
with ObservationStore(sys.argv[1]) as store:
    learn_from_store(
        store,
        make_simulator("event_driven"),
        options,
        on_progress=lambda progress: print(progress.iteration, flush=True),
    )
"""


def options(iterations=600, **others):
    return LearningOptions(criteria=ConvergenceCriteria(iterations), **others)


def saved_searches(store):
    return store.database.rows("SELECT COUNT(*) FROM searches")[0][0]


@pytest.mark.parametrize(("method", "kills"), [("cma_es", 3), ("hybrid_random", 1)])
def test_repeatedly_killed_search_ends_alike(path, tmp_path, event_driven, throws, method, kills):
    observed, iterations = throws(4, 0, noise=0.003), 1500
    with ObservationStore(tmp_path / "other.sqlite3") as other:
        other.add_all(observed)
        whole = learn_from_store(other, event_driven, options(iterations, method=method, seed=5))
    with ObservationStore(path) as store:
        store.add_all(observed)
    begun = []
    generator = np.random.default_rng(0)
    for life in range(kills + 1):
        learner = ChildProcess([sys.executable, "-c", LEARNER, str(path), method, str(iterations)])
        learner.wait_for("\n", PATIENCE)
        begun.append(int(learner.output.split()[0]))
        if life < kills:
            with ObservationStore(path) as store:
                while not saved_searches(store) and learner.is_running:
                    time.sleep(0.005)
            time.sleep(generator.uniform(0.0, 0.1))
            learner.send_signal(signal.SIGKILL)
        code = learner.wait(PATIENCE)
    assert code == 0, learner.output
    # It went on where it was: each time it had the iterations of the times before.
    assert begun == sorted(begun)
    assert begun[-1] > begun[0]
    with ObservationStore(path) as store:
        learned = store.newest_parameters()
        assert saved_searches(store) == 0
    assert learned.to_dict() == whole.learned.to_dict()


def test_same_search_is_resumed_and_another_restarts(store, glide, glides, monkeypatch):
    monkeypatch.setattr(parameter_search, "CHECKPOINT_PERIOD", 0.0)
    store.add(glides(np.random.default_rng(0), 0.4))
    asked = options(2000, method="random")

    def first_iteration(how, stop_at=None):
        """Iterations of the first report, which is of one batch."""
        messages, flag = [], StopFlag()

        def note(progress):
            messages.append(progress.iteration)
            if stop_at is not None and progress.iteration >= stop_at:
                flag.set()

        try:
            learn_from_store(store, glide.stopped_by(flag), how, on_progress=note)
        except SimulationStoppedError:
            assert saved_searches(store) > 0
        return messages[0]

    batch = first_iteration(asked, stop_at=300)
    assert first_iteration(replace(asked, seed=1), stop_at=300) == batch
    assert first_iteration(replace(asked, method="grid"), stop_at=300) == batch
    assert first_iteration(asked, stop_at=900) > batch
    # A version that came in between is another start.
    store.add_parameters(LearnedParameters.defaults(["ball", "floor"]))
    assert first_iteration(asked, stop_at=300) == batch
    # What has come to its end is forgotten.
    first_iteration(asked)
    assert first_iteration(asked, stop_at=300) == batch


def test_time_before_the_interruption_counts(store, glide, glides, monkeypatch):
    monkeypatch.setattr(parameter_search, "CHECKPOINT_PERIOD", 0.0)
    store.add(glides(np.random.default_rng(0), 0.4))
    asked = LearningOptions("random", ConvergenceCriteria(None, time_limit=4.5))
    flag = StopFlag()
    timer = threading.Timer(3.0, flag.set)
    timer.start()
    with pytest.raises(SimulationStoppedError):
        learn_from_store(store, glide.stopped_by(flag), asked)
    result = learn_from_store(store, glide, asked)
    assert result.search.seconds < 3.0
    assert result.learned.version == 1


def test_versions_are_stored_and_start_the_next_search(store, glide, glides):
    generator = np.random.default_rng(0)
    for _ in range(3):
        store.add(glides(generator, 0.4))
    first = learn_from_store(store, glide, options(200))
    second = learn_from_store(store, glide, options(50, method="random"))
    assert [first.learned.version, second.learned.version] == [1, 2]
    assert second.search.history[0] <= first.search.cost + 1e-9
    for version, result in ((1, first), (2, second)):
        assert store.parameters(version).to_dict() == result.learned.to_dict()
    chosen = options(50, observation_ids=[each.id for each in store.entries()][:2])
    assert learn_from_store(store, glide, chosen).learned.observation_count == 2


def test_cancelled_searches_store_no_version(store, glide, glides):
    store.add(glides(np.random.default_rng(0), 0.4))
    flag = StopFlag()
    flag.set()
    with pytest.raises(SimulationStoppedError):
        learn_from_store(store, glide.stopped_by(flag), options())
    assert store.newest_parameters() is None


def test_clear_errors(store, glide, glides):
    with pytest.raises(NoObservationsError, match="no observation is stored yet"):
        learn_from_store(store, glide, options())
    store.add(glides(np.random.default_rng(0), 0.4))
    with pytest.raises(UnknownMethodError, match="'magic'"):
        learn_from_store(store, glide, options(method="magic"))
    with pytest.raises(UnknownNameError, match="'nobody'"):
        learn_from_store(store, glide, options(observation_ids=("nobody",)))


def test_an_environment_is_distinguished_from_objects_that_cannot_be_simulated(store, glides):
    square = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    table = Environment([Plane("table", "floor", [0, 0, 1], 0.0, boundary=square)])
    observation = glides(np.random.default_rng(0), 0.4, id="on a table")
    store.add(replace(observation, environment=table))
    bullet = make_simulator("bullet")
    with pytest.raises(IncompatibleEnvironmentError, match=r"on a table .* has a boundary"):
        learn_from_store(store, bullet, options(10))
    # Static and dynamic friction differ by default, which is no fault of the environment.
    store.add(glides(np.random.default_rng(0), 0.4, id="on the floor"))
    with pytest.raises(UnsupportedSceneError) as refused:
        learn_from_store(store, bullet, options(10, observation_ids=["on the floor"]))
    assert not isinstance(refused.value, IncompatibleEnvironmentError)


def test_a_stored_search_is_plain_json(store, glide, glides, monkeypatch):
    monkeypatch.setattr(parameter_search, "CHECKPOINT_PERIOD", 0.0)
    store.add(glides(np.random.default_rng(0), 0.4))
    flag = StopFlag()
    with pytest.raises(SimulationStoppedError):
        learn_from_store(
            store, glide.stopped_by(flag), options(), on_progress=lambda progress: flag.set()
        )
    ((text,),) = store.database.rows("SELECT json FROM searches")
    assert set(json.loads(text)) == {"state", "seconds"}


def given_meanwhile(store, throws, simulator, method):
    """Learn, while another version of θ_s is stored by others, of a method or of none: given."""
    store.add_all(throws(2, 0))
    other = replace(LearnedParameters.defaults(store.materials()), method=method)
    stored = []

    def on_progress(progress):
        if not stored:
            stored.append(store.add_parameters(other))

    return learn_from_store(store, simulator, options(60, method="random"), on_progress=on_progress)


def test_a_search_never_supersedes_values_that_were_given_since_it_began(store, throws):
    with pytest.raises(SupersededError, match="version 1 of the static parameters was given"):
        given_meanwhile(store, throws, make_simulator("event_driven"), "")
    assert store.newest_version() == 1
    # Asked again, it takes account of them.
    again = learn_from_store(store, make_simulator("event_driven"), options(60, method="random"))
    assert again.learned.version == 2


def test_search_supersedes_background_versions(store, throws):
    learned = given_meanwhile(store, throws, make_simulator("event_driven"), "online")
    assert learned.learned.version == store.newest_version() == 2
