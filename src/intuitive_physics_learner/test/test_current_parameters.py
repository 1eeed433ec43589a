"""θ_s at present covers all observed materials, and follows the store."""

import numpy as np
import pytest

from intuitive_physics.learned_parameters import LearnedParameters
from intuitive_physics_learner import ObservationStore
from intuitive_physics_learner.store import CurrentParameters


@pytest.fixture
def store(tmp_path):
    with ObservationStore(tmp_path / "learner.sqlite3") as opened:
        yield opened


def test_there_are_none_while_no_material_is_known(store):
    current = CurrentParameters(store)
    assert current.extended() is None
    assert current.version == 0


def test_defaults_of_observed_materials_until_something_is_learned(store, glides):
    store.add(glides(np.random.default_rng(0), 0.5))
    current = CurrentParameters(store)
    assert current.extended().materials == ("ball", "floor")
    assert current.add_materials(("cork", "floor"))
    assert not current.add_materials(("cork",))
    assert current.extended().materials == ("ball", "floor", "cork")
    assert current.extended().version == 0


def test_only_newer_versions_are_taken_over(store):
    current = CurrentParameters(store)
    assert not current.read()
    first = store.add_parameters(LearnedParameters.defaults(("ball", "floor")))
    assert current.read()
    assert not current.read()
    assert current.version == first.version
    current.add_materials(("cork",))
    assert current.extended().materials == ("ball", "floor", "cork")
    assert current.extended().version == first.version
