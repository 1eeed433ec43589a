"""Improving θ_s a slice at a time, judged on the same observations."""

import time
from itertools import pairwise

import numpy as np
import pytest

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics.materials import StaticParameters
from intuitive_physics_learner import LearningCancelledError, ObservationStore, TrajectoryCost
from intuitive_physics_learner.online.improvement import OnlineOptions, OnlineSearch, SliceSettings


@pytest.fixture
def store(tmp_path):
    with ObservationStore(tmp_path / "learner.sqlite3") as opened:
        yield opened


SLICES = SliceSettings(first_slice=50, longest_slice=0.1)
"""Short, so that there are several."""

OPTIONS = OnlineOptions(seconds=10.0, iterations_without_gain=300)


def run_to_end(search):
    improvements = []
    while not search.finished:
        improvements.append(search.run_slice())
    return [one for one in improvements if one is not None]


def cost_of(learned, observed, simulator):
    cost = TrajectoryCost(observed, simulator, learned.materials)
    return cost.costs([learned.parameters])[0]


def test_every_new_version_has_a_lower_cost_on_the_same_observations(
    store, event_driven, throws, true_parameters
):
    observed = throws(6, 0, noise=0.003)
    store.add_all(observed)
    improvements = run_to_end(OnlineSearch(store, event_driven, OPTIONS, SLICES))
    assert len(improvements) >= 2
    assert [one.version for one in improvements] == list(range(1, len(improvements) + 1))
    assert [one.to_dict() for one in store.parameters_history()] == [
        one.to_dict() for one in improvements
    ]
    start = LearnedParameters.defaults(("ball", "floor"))
    costs = [cost_of(one, observed, event_driven) for one in (start, *improvements)]
    assert all(after < before for before, after in pairwise(costs))
    oracle = TrajectoryCost(observed, event_driven, ("ball", "floor")).costs([true_parameters])
    assert costs[-1] < 1.05 * oracle[0]


def test_what_is_as_good_as_it_gets_makes_no_version(store, glide, glides):
    # e is 0.37 to the digit already.
    known = LearnedParameters.defaults(("ball", "floor"))
    parameters = known.parameters.with_pair("ball", "floor", restitution=0.37)
    size = len(known.identified)
    store.add_parameters(
        LearnedParameters(parameters, np.full(size, 0.1), np.ones(size, bool), 1, 0.0, 3, "x")
    )
    store.add(glides(np.random.default_rng(0), 0.37))
    assert run_to_end(OnlineSearch(store, glide, OPTIONS)) == []
    assert store.newest_version() == 1


def test_new_observations_begin_from_what_is_known(store, glide, glides):
    generator = np.random.default_rng(0)
    store.add(glides(generator, 0.37))
    run_to_end(OnlineSearch(store, glide, OPTIONS))
    version = store.newest_version()
    assert version >= 1
    # The same ball again: nothing to gain on top of what the first observation told.
    store.add(glides(generator, 0.37))
    search = OnlineSearch(store, glide, OPTIONS)
    assert not search.finished
    told = []
    search.run_slice(on_progress=told.append)
    assert told[0].new_costs[0] < 1e-3
    # Another environment's worth of data: materials that were unknown are learned too.
    store.add(glides(generator, 0.8, materials=("cork",)))
    newest = run_to_end(OnlineSearch(store, glide, OPTIONS))[-1]
    assert newest.parameters.pair("cork", "floor")["restitution"] == pytest.approx(0.8, abs=0.01)
    assert newest.parameters.pair("ball", "floor")["restitution"] == pytest.approx(0.37, abs=0.01)


def test_notices_what_others_store(store, glide, glides):
    store.add(glides(np.random.default_rng(0), 0.37))
    search = OnlineSearch(store, glide, OPTIONS)
    assert not search.outdated
    store.add(glides(np.random.default_rng(1), 0.37))
    assert search.outdated
    search = OnlineSearch(store, glide, OPTIONS)
    given = LearnedParameters.defaults(("ball", "floor"))
    store.add_parameters(given)
    assert search.outdated
    # What it finds now was judged against what is not the newest any more.
    assert search.run_slice() is None
    assert store.newest_version() == 1


def test_goes_on_after_it_was_stopped_and_rests_when_finished(store, event_driven, throws):
    store.add_all(throws(3, 0, noise=0.003))
    first = OnlineSearch(store, event_driven, OPTIONS, SLICES)
    told = []
    first.run_slice(on_progress=told.append)
    again = OnlineSearch(store, event_driven, OPTIONS, SLICES)
    more = []
    again.run_slice(on_progress=more.append)
    assert more[0].iteration > told[-1].iteration
    run_to_end(again)
    assert OnlineSearch(store, event_driven, OPTIONS, SLICES).finished
    store.add_all(throws(1, 9))
    assert not OnlineSearch(store, event_driven, OPTIONS, SLICES).finished


def test_keeps_to_its_time(store, event_driven, throws):
    store.add_all(throws(3, 0, noise=0.003))
    options = OnlineOptions(method="random", seconds=0.5, iterations_without_gain=10**7)
    began = time.process_time()
    run_to_end(OnlineSearch(store, event_driven, options, SLICES))
    # At most the last slice is too much.
    assert 0.5 <= time.process_time() - began < 1.5
    assert OnlineSearch(store, event_driven, options, SLICES).finished


def test_stops_when_asked(store, glide, glides):
    store.add(glides(np.random.default_rng(0), 0.37))
    with pytest.raises(LearningCancelledError):
        OnlineSearch(store, glide, OPTIONS).run_slice(cancelled=lambda: True)
    assert store.newest_version() == 0


def test_defaults_are_improved_upon(store, glide, glides):
    store.add(glides(np.random.default_rng(0), 0.9))
    (first, *_) = run_to_end(OnlineSearch(store, glide, OPTIONS))
    assert first.version == 1
    defaults = StaticParameters.uniform(first.materials)
    assert first.parameters.pair("ball", "floor") != defaults.pair("ball", "floor")
